//! Scheduling decisions, one by one.

use common::{
    hash::AssetHash,
    job::{JobId, JobState, LeaseId, WorkerId},
    method::MethodChoices,
    pass::{PREPARE_PASS, Work},
    plan::Trial,
    protocol::{FailureCause, UnitId},
    tile::{Rect, TileGrid},
};

use super::{
    testing::{register, spec},
    *,
};

/// A farm whose plans are answered at once: `passes` passes of 16 samples.
struct Bench {
    farm: Farm,
    now: f64,
    passes: u32,
    asks: u64,
}

impl Bench {
    fn new(passes: u32) -> Self {
        Bench { farm: Farm::new(1), now: 0.0, passes, asks: 0 }
    }

    fn apply(&mut self, event: Event) -> Vec<Effect> {
        let mut effects = self.farm.apply(event, self.now);
        let mut at = 0;
        while at < effects.len() {
            let plans: Vec<Plan> = effects[at..].iter().filter_map(|effect| self.plan(effect)).collect();
            let measure = |effect: &Effect| match *effect {
                Effect::Measure(job, frame) => Some(Event::Measured { job, frame, again: None }),
                _ => None,
            };
            let measured: Vec<Event> = effects[at..].iter().filter_map(measure).collect();
            at = effects.len();
            for event in measured {
                effects.extend(self.farm.apply(event, self.now));
            }
            if !plans.is_empty() {
                effects.extend(self.farm.apply(Event::Planned(plans), self.now));
            }
        }
        effects
    }

    fn plan(&self, effect: &Effect) -> Option<Plan> {
        let &Effect::Plan(tile, pass) = effect else { return None };
        let share = f64::from(pass + 1) / f64::from(self.passes);
        let work = (pass < self.passes).then_some((Work::Uniform { first: 16 * pass, samples: 16 }, share));
        Some(Plan { tile, pass, work })
    }

    /// A job of `frames` frames of 8 tiles, 64 x 32 pixels each 16 pixels wide.
    fn submit(&mut self, id: u64, frames: u32, priority: u8) {
        self.submit_tiles(id, frames, priority, Rect::frame(64, 32));
    }

    fn submit_tiles(&mut self, id: u64, frames: u32, priority: u8, region: Rect) {
        let grid = TileGrid::new(region, 16);
        self.apply(Event::Submit(JobSpec { priority, ..spec(id, frames, grid) }));
    }

    fn join(&mut self, nonce: &str, threads: u32) -> WorkerId {
        let answers = self.apply(Event::Register(register(nonce, "v1", threads)));
        answers.iter().find_map(|a| if let Effect::Registered(id) = a { Some(*id) } else { None }).unwrap()
    }

    fn ask(&mut self, worker: WorkerId) -> Option<Grant> {
        self.ask_with(worker, Vec::new())
    }

    fn ask_with(&mut self, worker: WorkerId, prepared: Vec<(AssetHash, u32)>) -> Option<Grant> {
        self.asks += 1;
        let ask = self.asks;
        let answers = self.apply(Event::Ask { worker, ask, prepared });
        let granted = answers.into_iter().find_map(|a| match a {
            Effect::Grant(to, grant) if to == ask => Some(grant),
            _ => None,
        });
        if granted.is_none() {
            self.apply(Event::AskGone(ask));
        }
        granted
    }

    /// Hand in a unit that cost so many processor seconds, and store it at once.
    fn hand_in(&mut self, lease: LeaseId, unit: UnitId, cpu_seconds: f64) -> bool {
        let samples = unit.rect.area() as u64 * 16;
        let answers = self.apply(Event::Result { lease, unit, samples, cpu_seconds });
        let Some(accepted) = answers.into_iter().find_map(|a| if let Effect::Accept(a) = a { Some(a) } else { None })
        else {
            return false;
        };
        let tile = TileKey::from(&unit);
        let after = match accepted.split {
            None => self.apply(Event::Merged { tile, pass: unit.pass }),
            Some(_) => self.apply(Event::Saved(unit)),
        };
        for effect in after {
            if let Effect::Merge(accepted) = effect {
                self.apply(Event::Merged { tile, pass: accepted.unit.pass });
            }
        }
        true
    }

    fn finish(&mut self, grant: &Grant, cpu_seconds: f64) {
        for unit in &grant.units {
            self.hand_in(grant.lease, unit.id, cpu_seconds);
        }
    }

    fn beat(&mut self, worker: WorkerId, leases: Vec<LeaseId>) -> Vec<LeaseId> {
        let answers = self.apply(Event::Heartbeat { worker, leases, draining: false, prepared: Vec::new() });
        answers
            .into_iter()
            .find_map(|a| if let Effect::Heartbeat { cancelled, .. } = a { Some(cancelled) } else { None })
            .unwrap()
    }

    fn fail(&mut self, grant: &Grant, cause: FailureCause) {
        let units = grant.units.iter().map(|unit| unit.id).collect();
        let (lease, worker) = (grant.lease, grant.worker);
        self.apply(Event::Failed { lease, worker, units, cause, message: "it is on fire".into() });
    }

    /// The first unit fails, the others are handed back.
    fn fail_first(&mut self, grant: &Grant) {
        let (first, rest) = grant.units.split_first().unwrap();
        self.fail(&Grant { units: vec![first.clone()], ..grant.clone() }, FailureCause::Failed);
        self.fail(&Grant { units: rest.to_vec(), ..grant.clone() }, FailureCause::Returned);
    }

    fn state(&self, id: u64) -> JobState {
        self.farm.job_state(JobId(id)).unwrap()
    }

    /// Let time pass; these workers stay in touch and renew their leases.
    fn wait(&mut self, seconds: f64, alive: &[(WorkerId, Vec<LeaseId>)]) {
        let end = self.now + seconds;
        while self.now < end {
            self.now = (self.now + 1.0).min(end);
            for (worker, leases) in alive {
                self.beat(*worker, leases.clone());
            }
            self.apply(Event::Tick);
        }
    }
}

#[test]
fn states_change_only_as_the_table_says() {
    use JobState::{Active, Canceled, Completed, Failed, Paused, Queued};
    let all = [Queued, Active, Paused, Completed, Failed, Canceled];
    for from in all {
        let to: Vec<JobState> = all.into_iter().filter(|&to| transition(from, to).is_ok()).collect();
        let expected: &[JobState] = match from {
            Queued => &[Active, Paused, Completed, Failed, Canceled],
            Active => &[Paused, Completed, Failed, Canceled],
            Paused => &[Queued, Completed, Failed, Canceled],
            Completed | Failed | Canceled => &[Queued],
        };
        assert_eq!(to, expected, "from {from}");
    }
    assert_eq!(transition(Canceled, Active).unwrap_err(), "the job is canceled and cannot become active");
}

#[test]
fn priority_comes_first_then_a_fair_share_then_frames_in_order() {
    let mut bench = Bench::new(1);
    bench.submit(1, 2, 50);
    bench.submit(2, 2, 50);
    bench.submit(3, 1, 60);
    let worker = bench.join("a", 1);
    let mut order = Vec::new();
    while let Some(grant) = bench.ask(worker) {
        order.push((grant.job.0, grant.frame));
        bench.finish(&grant, 0.5);
    }
    let first_of = |job| order.iter().position(|&(j, _)| j == job).unwrap();
    assert!(first_of(3) < first_of(1) && order[..first_of(1)].iter().all(|&(j, _)| j == 3), "{order:?}");
    // Jobs of equal priority take turns.
    let equals: Vec<u64> = order.iter().filter(|&&(j, _)| j != 3).map(|&(j, _)| j).collect();
    let half = equals.len() / 2;
    let ones = equals[..half].iter().filter(|&&j| j == 1).count();
    assert!((2 * ones).abs_diff(half) <= 2, "{equals:?}");
    for job in [1, 2] {
        let frames: Vec<u32> = order.iter().filter(|&&(j, _)| j == job).map(|&(_, frame)| frame).collect();
        assert!(frames.is_sorted(), "{frames:?}");
        assert_eq!(bench.state(job), JobState::Completed);
    }
}

#[test]
fn a_prepared_scene_is_preferred_among_equals() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    bench.submit(2, 1, 50);
    let worker = bench.join("a", 2);
    let prepared = vec![(AssetHash::of(&2u64.to_le_bytes()), 1)];
    assert_eq!(bench.ask_with(worker, prepared).unwrap().job, JobId(2));
    bench.submit(3, 1, 51);
    let prepared = vec![(AssetHash::of(&2u64.to_le_bytes()), 1)];
    assert_eq!(bench.ask_with(worker, prepared).unwrap().job, JobId(3), "but priority comes first");
}

#[test]
fn cheap_units_are_grouped_and_dear_ones_split_to_the_target() {
    let mut bench = Bench::new(1);
    bench.submit(1, 40, 50);
    let worker = bench.join("a", 2);
    let first = bench.ask(worker).unwrap();
    // 0.1 processor seconds a tile on two threads: 20 tiles make a second, but a frame has only 8.
    assert_eq!(first.units.len(), 8);
    bench.now += 0.4;
    bench.finish(&first, 0.1);
    let whole = bench.ask(worker).unwrap();
    assert_eq!(whole.units.len(), 8, "a lease is of one frame");
    // Ten times as dear: 20 processor seconds a tile, so pieces of a tenth of it.
    bench.now += 80.0;
    bench.beat(worker, vec![whole.lease]);
    bench.finish(&whole, 20.0);
    let dear = bench.ask(worker).unwrap();
    let area: usize = dear.units.iter().map(|unit| unit.id.rect.area()).sum();
    assert!((16..=128).contains(&area), "{area} pixels");
    assert!(dear.units[0].id.rect.area() < 256);
}

#[test]
fn a_silent_worker_is_lost_and_its_units_return_at_once() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    let (silent, other) = (bench.join("a", 1), bench.join("b", 1));
    let held = bench.ask(silent).unwrap();
    bench.wait(14.0, &[(other, Vec::new())]);
    assert_eq!(bench.farm.worker(silent, bench.now).unwrap().state, "busy");
    bench.wait(2.0, &[(other, Vec::new())]);
    assert_eq!(bench.farm.worker(silent, bench.now).unwrap().state, "lost");
    // A lost unit is tried alone, so that it takes no other with it.
    let again = bench.ask(other).unwrap();
    assert_eq!(again.units.iter().map(|u| u.id).collect::<Vec<_>>(), [held.units[0].id]);
    // It was only asleep: its result counts if it comes first, and its lease is cancelled.
    assert_eq!(bench.beat(silent, vec![held.lease]), [held.lease]);
    assert!(bench.hand_in(held.lease, held.units[0].id, 0.1));
    assert!(!bench.hand_in(again.lease, again.units[0].id, 0.1));
}

#[test]
fn a_unit_that_loses_three_workers_fails_its_job() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    for round in 0..3 {
        assert_ne!(bench.state(1), JobState::Failed, "round {round}");
        let worker = bench.join(&format!("n{round}"), 1);
        bench.ask(worker).unwrap();
        bench.wait(20.0, &[]);
    }
    assert_eq!(bench.state(1), JobState::Failed);
    let message = bench.farm.job(JobId(1), bench.now).unwrap().message.unwrap();
    assert_eq!(message, "frame 1, tile 0, pass 0: the workers that rendered it were lost 3 times");
}

#[test]
fn a_unit_that_fails_on_three_workers_fails_its_job_with_the_message() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    let workers: Vec<WorkerId> = (0..4).map(|i| bench.join(&format!("n{i}"), 1)).collect();
    for (i, &worker) in workers[..3].iter().enumerate() {
        assert_ne!(bench.state(1), JobState::Failed, "after {i} workers");
        let grant = bench.ask(worker).unwrap();
        assert_eq!(grant.units[0].id.tile, 0);
        bench.fail_first(&grant);
        // It is tried elsewhere first: the one it failed on gets another tile.
        if let Some(other) = bench.ask(worker) {
            assert_ne!(other.units[0].id.tile, 0);
            bench.fail(&other, FailureCause::Returned);
        }
    }
    assert_eq!(bench.state(1), JobState::Failed);
    let message = bench.farm.job(JobId(1), bench.now).unwrap().message.unwrap();
    assert_eq!(message, "frame 1, tile 0, pass 0: it is on fire");
}

#[test]
fn a_drain_costs_nothing() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    for round in 0..20 {
        let worker = bench.join(&format!("n{round}"), 1);
        let grant = bench.ask(worker).unwrap();
        bench.fail(&grant, FailureCause::Returned);
        // Others say that they leave, and fall silent with what they hold.
        let held = bench.ask(worker).unwrap();
        bench.apply(Event::Heartbeat { worker, leases: vec![held.lease], draining: true, prepared: Vec::new() });
        assert!(bench.ask(worker).is_none());
        bench.wait(16.0, &[]);
    }
    assert_eq!(bench.state(1), JobState::Active);
    assert!(bench.farm.tiles(JobId(1), 1).unwrap().iter().all(|tile| tile.attempts == 0));
}

#[test]
fn a_worker_that_fails_in_a_row_is_left_alone_for_a_while() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    let (bad, good) = (bench.join("bad", 1), bench.join("good", 1));
    for _ in 0..3 {
        let grant = bench.ask(bad).unwrap();
        bench.fail_first(&grant);
    }
    assert_eq!(bench.farm.worker(bad, bench.now).unwrap().state, "disabled");
    assert!(bench.ask(bad).is_none());
    while let Some(grant) = bench.ask(good) {
        bench.finish(&grant, 0.1);
    }
    assert_eq!(bench.state(1), JobState::Completed, "the units were good");
    bench.wait(61.0, &[(bad, Vec::new()), (good, Vec::new())]);
    assert_eq!(bench.farm.worker(bad, bench.now).unwrap().state, "idle");
}

#[test]
fn a_hung_unit_is_found_by_its_deadline_though_its_worker_is_in_touch() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    let worker = bench.join("a", 1);
    let grant = bench.ask(worker).unwrap();
    bench.wait(DEADLINE_GRACE, &[(worker, vec![grant.lease])]);
    assert_eq!(bench.farm.counters().failed, 0);
    bench.wait(2.0 * DEADLINE_FACTOR, &[(worker, vec![grant.lease])]);
    assert_eq!(bench.farm.counters().failed as usize, grant.units.len());
    assert_eq!(bench.beat(worker, vec![grant.lease]), [grant.lease]);
}

#[test]
fn a_lease_that_is_not_renewed_ends() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    let worker = bench.join("a", 1);
    let grant = bench.ask(worker).unwrap();
    bench.wait(LEASE_SECONDS + 1.0, &[(worker, Vec::new())]);
    assert_eq!(bench.farm.counters().lost as usize, grant.units.len());
    assert_eq!(bench.farm.worker(worker, bench.now).unwrap().state, "idle");
}

#[test]
fn near_the_end_leases_shrink_and_then_idle_workers_double_what_is_out() {
    let mut bench = Bench::new(1);
    bench.submit_tiles(1, 1, 50, Rect::frame(128, 96));
    let (a, b) = (bench.join("a", 1), bench.join("b", 1));
    let first = bench.ask(a).unwrap();
    bench.finish(&first, 0.3);
    // Two workers that hand nothing in: the leases of what is left get smaller.
    let held: Vec<Grant> = [a, b, a, b, a, b].into_iter().filter_map(|worker| bench.ask(worker)).collect();
    let sizes: Vec<usize> = held.iter().map(|g| g.units.iter().map(|unit| unit.id.rect.area()).sum()).collect();
    assert!(sizes[0] >= 2 * sizes[sizes.len() - 1], "{sizes:?}");
    let (mine, theirs): (Vec<_>, Vec<_>) = held.into_iter().partition(|grant| grant.worker == b);
    for grant in &mine {
        bench.finish(grant, 0.3);
    }
    let leases: Vec<LeaseId> = theirs.iter().map(|grant| grant.lease).collect();
    for _ in 0..200 {
        bench.wait(0.5, &[(a, leases.clone()), (b, Vec::new())]);
        while let Some(grant) = bench.ask(b) {
            bench.finish(&grant, 0.3);
        }
    }
    assert!(bench.farm.counters().duplicated > 0);
    assert_eq!(bench.state(1), JobState::Completed, "nothing waits for the one that never answers");
    assert_eq!(bench.beat(a, leases.clone()), leases, "and that one is told to stop");
    assert_eq!(bench.farm.counters().failed + bench.farm.counters().lost, 0);
}

#[test]
fn workers_of_another_build_get_no_lease_of_a_pinned_job() {
    let mut bench = Bench::new(1);
    bench.submit(1, 1, 50);
    let first = bench.join("a", 1);
    bench.ask(first).unwrap();
    let mut register = bench.farm.worker_history(first).unwrap().0;
    (register.tracer, register.nonce) = ("v2".into(), "b".into());
    let answers = bench.apply(Event::Register(register));
    let Some(Effect::Registered(other)) = answers.last().cloned() else { panic!("{answers:?}") };
    assert!(bench.ask(other).is_none());
    bench.submit(2, 1, 1);
    assert_eq!(bench.ask(other).unwrap().job, JobId(2));
}

#[test]
fn a_job_is_prepared_before_anything_is_rendered_whoever_is_lost_at_it() {
    let mut bench = Bench::new(1);
    let prepare = Some(Trial { region: Rect::frame(64, 32), named: MethodChoices::default(), quality: None });
    let spec = spec(1, 2, TileGrid::new(Rect::frame(64, 32), 16));
    bench.apply(Event::Submit(JobSpec { gated: true, prepare, ..spec }));
    let (a, b) = (bench.join("a", 1), bench.join("b", 1));
    let is_preparation = |grant: &Grant| {
        let [unit] = &grant.units[..] else { return false };
        unit.id.pass == PREPARE_PASS && matches!(unit.work, Work::Prepare { .. }) && !unit.features
    };
    let first = bench.ask(a).unwrap();
    assert!(is_preparation(&first), "{first:?}");
    assert!(bench.ask(b).is_none(), "nothing else can be done, in no frame");
    // The worker is killed: another takes its place.
    bench.wait(20.0, &[(b, Vec::new())]);
    let second = bench.ask(b).unwrap();
    assert!(is_preparation(&second) && second.units == first.units, "{second:?}");
    let result = |lease, unit| Event::Result { lease, unit, samples: 0, cpu_seconds: 0.1 };
    let unit = second.units[0].id;
    let answers = bench.apply(result(second.lease, unit));
    assert!(answers.iter().any(|answer| matches!(answer, Effect::Accept(_))), "{answers:?}");
    assert!(bench.ask(b).is_none(), "what was prepared is not on disk yet");
    bench.apply(Event::Prepared(JobId(1)));
    assert_eq!(bench.apply(result(first.lease, unit)), [Effect::Closed], "the first comes back too late");
    while let Some(grant) = bench.ask(b) {
        assert!(grant.units.iter().all(|unit| unit.id.pass != PREPARE_PASS), "{grant:?}");
        bench.finish(&grant, 0.1);
    }
    assert_eq!(bench.state(1), JobState::Completed);
}

#[test]
fn a_job_that_cannot_be_prepared_fails_and_says_so() {
    let mut bench = Bench::new(1);
    let prepare = Some(Trial { region: Rect::frame(64, 32), named: MethodChoices::default(), quality: None });
    bench.submit(1, 1, 50);
    bench.farm.jobs.get_mut(&JobId(1)).unwrap().spec.prepare = prepare;
    let worker = bench.join("a", 1);
    for _ in 0..MAX_FAILURES {
        bench.now += DISABLED_SECONDS;
        bench.beat(worker, Vec::new());
        let grant = bench.ask(worker).unwrap();
        bench.fail(&grant, FailureCause::Failed);
    }
    assert_eq!(bench.state(1), JobState::Failed);
    let (_, message, _) = bench.farm.brief(JobId(1)).unwrap();
    assert!(message.unwrap().contains("the choice of the method"));
}

#[test]
fn a_gated_tile_waits_for_its_neighbours_and_others_do_not() {
    for gated in [false, true] {
        let mut farm = Farm::new(1);
        let grid = TileGrid::new(Rect::frame(64, 16), 16);
        farm.apply(Event::Submit(JobSpec { gated, ..spec(1, 1, grid) }), 0.0);
        farm.apply(Event::Register(register("n", "v", 1)), 0.0);
        let ask = Event::Ask { worker: WorkerId(1), ask: 1, prepared: Vec::new() };
        let plans = |effects: Vec<Effect>| -> Vec<(u32, u32)> {
            effects
                .into_iter()
                .filter_map(|e| if let Effect::Plan(key, pass) = e { Some((key.tile, pass)) } else { None })
                .collect()
        };
        assert_eq!(plans(farm.apply(ask, 0.0)), [(0, 0), (1, 0), (2, 0), (3, 0)]);
        let key = |tile| TileKey { job: JobId(1), frame: 1, tile };
        for tile in 0..4 {
            let work = Some((Work::Uniform { first: 0, samples: 16 }, 0.5));
            farm.apply(Event::Planned(vec![Plan { tile: key(tile), pass: 0, work }]), 0.0);
        }
        let mut merged = |tile| plans(farm.apply(Event::Merged { tile: key(tile), pass: 0 }, 0.0));
        let expected: [&[(u32, u32)]; 4] = if gated {
            [&[], &[], &[(3, 1)], &[(0, 1), (1, 1), (2, 1)]]
        } else {
            [&[(0, 1)], &[(3, 1)], &[(2, 1)], &[(1, 1)]]
        };
        for (tile, expected) in [0, 3, 2, 1].into_iter().zip(expected) {
            let mut found = merged(tile);
            found.sort_unstable();
            assert_eq!(found, expected, "gated {gated}, tile {tile}");
        }
        if gated {
            // A finished neighbour holds nobody back.
            let done = Event::Planned(vec![Plan { tile: key(0), pass: 1, work: None }]);
            assert!(plans(farm.apply(done, 0.0)).is_empty());
            let work = Some((Work::Uniform { first: 16, samples: 16 }, 1.0));
            for tile in 1..4 {
                farm.apply(Event::Planned(vec![Plan { tile: key(tile), pass: 1, work: work.clone() }]), 0.0);
            }
            assert!(plans(farm.apply(Event::Merged { tile: key(1), pass: 1 }, 0.0)).is_empty());
            assert_eq!(plans(farm.apply(Event::Merged { tile: key(2), pass: 1 }, 0.0)), [(1, 2)]);
        }
    }
}

#[test]
fn parts_that_were_stored_before_a_restart_are_not_rendered_again() {
    let mut bench = Bench::new(1);
    let grid = TileGrid::new(Rect::frame(16, 16), 16);
    let spec = spec(1, 1, grid);
    let all = Rect::frame(16, 16).split(64);
    let parts = Some((64, all[..3].to_vec()));
    let tiles = BTreeMap::from([((1, 0), TileProgress { parts, ..TileProgress::default() })]);
    let state = JobState::Active;
    bench.apply(Event::Restore(Box::new(Restored { spec, state, message: None, done: Vec::new(), tiles })));
    let worker = bench.join("a", 1);
    let grant = bench.ask(worker).unwrap();
    assert_eq!(grant.units.iter().map(|unit| unit.id.rect).collect::<Vec<_>>(), all[3..]);
    bench.finish(&grant, 0.1);
    assert_eq!(bench.state(1), JobState::Completed);
}
