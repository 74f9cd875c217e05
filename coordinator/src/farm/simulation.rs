//! The farm under random schedules: workers that join, vanish, hang, fail and leave; results that come
//! twice, late or never; coordinators that restart; planners that answer out of order.
//!
//! The simulation plays the service: it keeps what would be on disk, and a pixel's passes are noted in the
//! order in which they are merged. Faults are counted: a schedule in which none fired proves nothing.

use std::collections::{BTreeMap, BTreeSet};

use common::{
    job::{JobId, JobState, LeaseId, WorkerId},
    pass::Work,
    protocol::{FailureCause, Unit, UnitId},
    tile::{Rect, TileGrid},
};
use proptest::prelude::*;

use super::{
    testing::{register, spec},
    *,
};

/// SplitMix64: the schedule is a function of the seed.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }
}

/// How often each fault fired.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Faults {
    vanished: u32,
    failed: u32,
    returned: u32,
    doubled: u32,
    stale: u32,
    restarts: u32,
    undelivered: u32,
    save_failed: u32,
}

impl Faults {
    fn fired(&self) -> u32 {
        let Faults { vanished, failed, returned, doubled, stale, restarts, undelivered, save_failed } = *self;
        vanished + failed + returned + doubled + stale + restarts + undelivered + save_failed
    }
}

/// A tile as it is on disk.
#[derive(Debug, Clone, Default)]
struct Disk {
    passes: u32,
    finished: bool,
    /// Passes in the order of merging.
    merged: Vec<u32>,
    parts: Option<(u32, usize, BTreeSet<Rect>)>,
}

struct Lot {
    worker: WorkerId,
    units: Vec<Unit>,
}

struct World {
    farm: Farm,
    dice: Dice,
    now: f64,
    specs: BTreeMap<JobId, JobSpec>,
    passes: u32,
    disk: BTreeMap<TileKey, Disk>,
    done: BTreeSet<(JobId, u32)>,
    states: BTreeMap<JobId, JobState>,
    /// Leases that workers hold.
    lots: BTreeMap<LeaseId, Lot>,
    /// Workers that are alive; others will never be heard of again.
    alive: BTreeSet<WorkerId>,
    plans: Vec<(TileKey, u32)>,
    measuring: Vec<(JobId, u32)>,
    /// Frames that were gone over again, and from which pass on.
    again: BTreeMap<(JobId, u32), u32>,
    saving: Vec<Accepted>,
    merging: Vec<Accepted>,
    /// Results handed in before, for handing in once more.
    old: Vec<(LeaseId, UnitId)>,
    faults: Faults,
    troubled: bool,
    epoch: u64,
    nonce: u64,
    asks: u64,
    /// The request of each worker that waits.
    waiting: BTreeMap<WorkerId, u64>,
    /// Parts of split passes that were stored, and what the farms counted.
    parts: u32,
    doubled_by_farm: u64,
    lost: u64,
    /// How often each part of a pass was taken in.
    taken: BTreeMap<UnitId, u32>,
}

impl World {
    fn new(seed: u64, gated: bool, troubled: bool) -> World {
        let mut world = World {
            farm: Farm::new(1),
            dice: Dice(seed),
            now: 0.0,
            specs: BTreeMap::new(),
            passes: 1 + (seed % 4) as u32,
            disk: BTreeMap::new(),
            done: BTreeSet::new(),
            states: BTreeMap::new(),
            lots: BTreeMap::new(),
            alive: BTreeSet::new(),
            plans: Vec::new(),
            measuring: Vec::new(),
            again: BTreeMap::new(),
            saving: Vec::new(),
            merging: Vec::new(),
            old: Vec::new(),
            faults: Faults::default(),
            troubled,
            epoch: 1,
            nonce: 0,
            asks: 0,
            waiting: BTreeMap::new(),
            parts: 0,
            doubled_by_farm: 0,
            lost: 0,
            taken: BTreeMap::new(),
        };
        for id in 1..=1 + world.dice.next() % 3 {
            let (w, h) = (20 + world.dice.below(90) as u32, 20 + world.dice.below(90) as u32);
            let frames = 1 + world.dice.below(3) as u32;
            let spec = JobSpec { gated, ..spec(id, frames, TileGrid::new(Rect::frame(w, h), 32)) };
            world.specs.insert(spec.id, spec.clone());
            world.states.insert(spec.id, JobState::Queued);
            world.apply(Event::Submit(spec));
        }
        world.join();
        world
    }

    /// Every other frame is gone over again, once: its tiles then stand at the same pass.
    fn go_over_again(&mut self, job: JobId, frame: u32) -> Option<u32> {
        let first = frame % 2 == 1 && !self.again.contains_key(&(job, frame));
        let tiles = || self.specs[&job].grid.count();
        let keys: Vec<TileKey> = (0..tiles()).map(|tile| TileKey { job, frame, tile }).collect();
        let passes = keys.iter().map(|key| self.disk[key].passes).max().filter(|_| first)?;
        self.again.insert((job, frame), passes);
        for key in keys {
            let disk = self.disk.get_mut(&key).expect("it was finished");
            (disk.passes, disk.finished) = (passes, false);
        }
        Some(passes)
    }

    /// The rule of the simulated jobs: tiles differ in their number of passes.
    fn plan(&self, tile: TileKey, pass: u32) -> Option<(Work, f64)> {
        if self.again.get(&(tile.job, tile.frame)).is_some_and(|&again| pass >= again) {
            let once = self.again[&(tile.job, tile.frame)] == pass && tile.tile.is_multiple_of(2);
            return once.then_some((Work::Uniform { first: 16 * pass, samples: 16 }, 1.0));
        }
        let passes = 1 + (tile.tile + tile.frame) % self.passes;
        let share = f64::from(pass + 1) / f64::from(passes);
        (pass < passes).then_some((Work::Uniform { first: 16 * pass, samples: 16 }, share))
    }

    fn join(&mut self) {
        self.nonce += 1;
        let answers = self.apply(Event::Register(register(&format!("n{}", self.nonce), "v1", 2)));
        for answer in answers {
            if let Effect::Registered(id) = answer {
                self.alive.insert(id);
            }
        }
    }

    fn apply(&mut self, event: Event) -> Vec<Effect> {
        let effects = self.farm.apply(event, self.now);
        let mut answers = Vec::new();
        for effect in effects {
            match effect {
                Effect::Plan(tile, pass) => {
                    self.check_gate(tile, pass);
                    self.plans.push((tile, pass));
                }
                Effect::Grant(_, grant) => {
                    if self.troubled && self.dice.one_in(40) {
                        self.faults.undelivered += 1;
                        answers.extend(self.apply(Event::Undelivered(grant.lease)));
                        continue;
                    }
                    assert!(!grant.units.is_empty(), "an empty lease");
                    for unit in &grant.units {
                        assert_eq!((unit.id.job, unit.id.frame), (grant.job, grant.frame));
                    }
                    self.lots.insert(grant.lease, Lot { worker: grant.worker, units: grant.units });
                }
                Effect::Accept(accepted) => {
                    *self.taken.entry(accepted.unit).or_default() += 1;
                    self.saving.push(accepted);
                }
                Effect::Merge(accepted) => self.merging.push(accepted),
                Effect::TileFinished(tile) => self.disk.entry(tile).or_default().finished = true,
                Effect::Measure(job, frame) => {
                    let spec = &self.specs[&job];
                    let key = |tile| TileKey { job, frame, tile };
                    let finished = |tile| self.disk.get(&key(tile)).is_some_and(|disk| disk.finished);
                    assert!((0..spec.grid.count()).all(finished), "a frame is measured when its tiles are finished");
                    self.measuring.push((job, frame));
                }
                Effect::FrameDone(job, frame) => {
                    assert!(self.done.insert((job, frame)), "frame {frame} of {job} was done twice");
                }
                Effect::JobChanged(job) => {
                    if let Some(state) = self.farm.job_state(job) {
                        self.states.insert(job, state);
                    }
                }
                other => answers.push(other),
            }
        }
        answers
    }

    /// A gated tile is planned only when its neighbours have finished the pass before.
    fn check_gate(&self, tile: TileKey, pass: u32) {
        let spec = &self.specs[&tile.job];
        if !spec.gated || pass == 0 {
            return;
        }
        for neighbour in spec.grid.neighbours(tile.tile) {
            let other = self.disk.get(&TileKey { tile: neighbour, ..tile }).cloned().unwrap_or_default();
            assert!(other.passes >= pass || other.finished, "{tile:?} pass {pass} did not wait for tile {neighbour}");
            assert!(other.passes <= pass + 1 || other.finished, "tile {neighbour} is more than one pass ahead");
        }
    }

    /// Bring one accepted result to the disk, as the service does.
    fn save(&mut self) {
        let at = self.dice.below(self.saving.len());
        let accepted = self.saving.swap_remove(at);
        let unit = accepted.unit;
        if self.troubled && self.dice.one_in(50) {
            self.faults.save_failed += 1;
            self.apply(Event::SaveFailed(unit));
            return;
        }
        match accepted.split {
            None => self.merge_into_disk(&accepted),
            Some(split) => {
                self.parts += 1;
                let disk = self.disk.entry(TileKey::from(&unit)).or_default();
                if disk.passes == unit.pass {
                    let parts = disk.parts.get_or_insert_with(|| (unit.pass, split, BTreeSet::new()));
                    assert_eq!((parts.0, parts.1), (unit.pass, split), "a pass is split in one way");
                    parts.2.insert(unit.rect);
                }
                self.apply(Event::Saved(unit));
            }
        }
    }

    fn merge(&mut self) {
        let at = self.dice.below(self.merging.len());
        let accepted = self.merging.swap_remove(at);
        let disk = self.disk.entry(TileKey::from(&accepted.unit)).or_default();
        if disk.passes == accepted.unit.pass {
            let (_, split, parts) = disk.parts.as_ref().expect("parts to merge");
            let all: BTreeSet<Rect> = accepted.unit.rect.split(*split).into_iter().collect();
            assert_eq!(parts, &all, "all parts are there");
        }
        self.merge_into_disk(&accepted);
    }

    fn merge_into_disk(&mut self, accepted: &Accepted) {
        let (tile, pass) = (TileKey::from(&accepted.unit), accepted.unit.pass);
        let disk = self.disk.entry(tile).or_default();
        if disk.passes == pass {
            disk.merged.push(pass);
            disk.passes += 1;
            disk.parts = None;
        }
        self.apply(Event::Merged { tile, pass });
    }

    /// Kill the coordinator: what is not on disk is gone, and workers do not notice at once.
    fn restart(&mut self) {
        self.faults.restarts += 1;
        self.epoch += 1;
        self.note_counters();
        self.farm = Farm::new(self.epoch);
        (self.plans, self.measuring, self.saving, self.merging) = Default::default();
        for id in self.alive.clone() {
            self.apply(Event::RestoreWorker(id, register(&format!("r{id}"), "v1", 2), WorkerHistory::default()));
        }
        for (id, spec) in self.specs.clone() {
            let tiles = self.disk.iter().filter(|(key, _)| key.job == id).map(|(key, disk)| {
                let parts = disk.parts.clone().map(|(_, split, rects)| (split, rects.into_iter().collect()));
                let progress =
                    TileProgress { passes: disk.passes, finished: disk.finished, parts, ..TileProgress::default() };
                ((key.frame, key.tile), progress)
            });
            let done = self.done.iter().filter(|(job, _)| *job == id).map(|&(_, frame)| frame).collect();
            let restored = Restored { spec, state: self.states[&id], message: None, done, tiles: tiles.collect() };
            self.apply(Event::Restore(Box::new(restored)));
        }
    }

    fn note_counters(&mut self) {
        self.doubled_by_farm += self.farm.counters().duplicated;
        self.lost += self.farm.counters().lost;
    }

    fn hand_in(&mut self, lease: LeaseId, unit: UnitId) {
        // Dear enough that tiles are split.
        let samples = unit.rect.area() as u64 * 16;
        let answers = self.apply(Event::Result { lease, unit, samples, cpu_seconds: samples as f64 * 1e-4 });
        assert!(answers.iter().filter(|answer| **answer == Effect::Closed).count() <= 1);
        self.old.push((lease, unit));
    }

    fn step(&mut self) {
        self.now += 0.02 * self.dice.below(10) as f64;
        let troubled = self.troubled;
        match self.dice.below(if troubled { 24 } else { 12 }) {
            0 | 1 => {
                for id in self.alive.clone() {
                    self.asks += 1;
                    if let Some(before) = self.waiting.insert(id, self.asks) {
                        self.apply(Event::AskGone(before));
                    }
                    self.apply(Event::Ask { worker: id, ask: self.asks, prepared: Vec::new() });
                    let leases =
                        self.lots.iter().filter(|(_, lot)| lot.worker == id).map(|(&lease, _)| lease).collect();
                    let beat = Event::Heartbeat { worker: id, leases, draining: false, prepared: Vec::new() };
                    for answer in self.apply(beat) {
                        if let Effect::Heartbeat { cancelled, .. } = answer {
                            // Cancelled work may still come in, as from a worker that did not hear of it.
                            let keep = self.dice.one_in(3);
                            cancelled.iter().filter(|_| !keep).for_each(|lease| drop(self.lots.remove(lease)));
                        }
                    }
                }
            }
            2 if !self.measuring.is_empty() => {
                let (job, frame) = self.measuring.swap_remove(0);
                let again = self.go_over_again(job, frame);
                self.apply(Event::Measured { job, frame, again });
            }
            2 | 3 if !self.plans.is_empty() => {
                let at = self.dice.below(self.plans.len());
                let (tile, pass) = self.plans.swap_remove(at);
                let work = self.plan(tile, pass);
                self.apply(Event::Planned(vec![Plan { tile, pass, work }]));
            }
            4 | 5 if !self.saving.is_empty() => self.save(),
            6 if !self.merging.is_empty() => self.merge(),
            7..=10 if !self.lots.is_empty() => {
                let at = self.dice.below(self.lots.len());
                let lease = *self.lots.keys().nth(at).expect("in range");
                let lot = self.lots.get_mut(&lease).expect("just found");
                match lot.units.pop() {
                    Some(unit) if self.alive.contains(&lot.worker) => self.hand_in(lease, unit.id),
                    _ => drop(self.lots.remove(&lease)),
                }
            }
            11 => drop(self.apply(Event::Tick)),
            12 if self.alive.len() > 1 => {
                let at = self.dice.below(self.alive.len());
                let gone = *self.alive.iter().nth(at).expect("in range");
                self.alive.remove(&gone);
                self.faults.vanished += u32::from(self.lots.values().any(|lot| lot.worker == gone));
                self.lots.retain(|_, lot| lot.worker != gone);
                self.now += 0.5 * self.dice.below(40) as f64;
            }
            13 if self.alive.len() < 5 => self.join(),
            14 if !self.lots.is_empty() && self.dice.one_in(4) => {
                let at = self.dice.below(self.lots.len());
                let lease = *self.lots.keys().nth(at).expect("in range");
                let lot = self.lots.remove(&lease).expect("just found");
                let units = lot.units.iter().map(|unit| unit.id).collect();
                let failed = self.dice.one_in(3);
                let cause = if failed { FailureCause::Failed } else { FailureCause::Returned };
                self.faults.failed += u32::from(failed);
                self.faults.returned += u32::from(!failed);
                self.apply(Event::Failed { lease, worker: lot.worker, units, cause, message: "no luck".into() });
            }
            15 if !self.old.is_empty() => {
                let at = self.dice.below(self.old.len());
                let (lease, unit) = self.old[at];
                self.faults.doubled += 1;
                self.apply(Event::Result { lease, unit, samples: 1, cpu_seconds: 0.0 });
            }
            16 if !self.lots.is_empty() => {
                // Handed in under a lease that nobody knows.
                let at = self.dice.below(self.lots.len());
                let lot = self.lots.values().nth(at).expect("in range");
                if let Some(unit) = lot.units.first().map(|unit| unit.id) {
                    self.faults.stale += 1;
                    self.hand_in(LeaseId(7), unit);
                }
            }
            17 if self.dice.one_in(12) => self.restart(),
            18 if self.dice.one_in(8) => {
                let job = JobId(1 + self.dice.next() % self.specs.len() as u64);
                self.apply(Event::Command(job, Command::Pause));
                self.now += 1.0;
                self.apply(Event::Command(job, Command::Resume));
            }
            _ => {}
        }
    }

    /// Failed jobs are tried again: in these schedules nothing is really wrong with them.
    fn requeue_failed(&mut self) {
        let failed: Vec<JobId> =
            self.states.iter().filter(|(_, state)| **state == JobState::Failed).map(|(&id, _)| id).collect();
        for id in failed {
            self.apply(Event::Command(id, Command::Requeue));
        }
    }

    fn run(&mut self) {
        for step in 0..400_000 {
            if self.states.values().all(|state| *state == JobState::Completed) {
                self.note_counters();
                return;
            }
            if step == 20_000 {
                self.troubled = false; // Faults end at last; every job must now end too.
            }
            self.requeue_failed();
            self.step();
            if self.alive.is_empty() {
                self.join();
            }
        }
        panic!("the jobs hang: {:?}, {:?}", self.states, self.farm.queue());
    }

    /// Every tile has each of its passes exactly once, in order.
    fn check(&self) {
        for (id, spec) in &self.specs {
            for (&frame, tile) in spec.frames.iter().flat_map(|f| (0..spec.grid.count()).map(move |t| (f, t))) {
                let key = TileKey { job: *id, frame, tile };
                let passes = 1 + (tile + frame) % self.passes;
                let mut expected: Vec<u32> = (0..passes).collect();
                let again = self.again.get(&(*id, frame));
                assert_eq!(again.is_some(), frame % 2 == 1, "odd frames are gone over again");
                expected.extend(again.filter(|_| tile.is_multiple_of(2)));
                assert_eq!(self.disk[&key].merged, expected, "{key:?}");
            }
            assert_eq!(self.farm.frames_done(*id), spec.frames);
        }
        assert_eq!(self.farm.queue(), (0, 0));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn every_unit_counts_once_and_every_job_ends(seed in any::<u64>(), gated in any::<bool>()) {
        let mut world = World::new(seed, gated, true);
        world.run();
        world.check();
    }

    #[test]
    fn a_quiet_farm_takes_every_unit_in_exactly_once(seed in any::<u64>(), gated in any::<bool>()) {
        let mut world = World::new(seed, gated, false);
        world.run();
        world.check();
        prop_assert_eq!(world.faults.fired(), 0);
        prop_assert!(world.taken.values().all(|&n| n == 1));
        prop_assert_eq!(world.farm.counters().failed + world.farm.counters().lost, 0);
    }
}

#[test]
fn the_schedules_hold_every_kind_of_fault() {
    let mut sum = Faults::default();
    let (mut parts, mut doubled_by_farm, mut lost) = (0, 0, 0);
    for seed in 0..60 {
        let mut world = World::new(seed, seed % 2 == 0, true);
        world.run();
        world.check();
        parts += world.parts;
        doubled_by_farm += world.doubled_by_farm;
        lost += world.lost;
        let f = world.faults;
        sum.vanished += f.vanished;
        sum.failed += f.failed;
        sum.returned += f.returned;
        sum.doubled += f.doubled;
        sum.stale += f.stale;
        sum.restarts += f.restarts;
        sum.undelivered += f.undelivered;
        sum.save_failed += f.save_failed;
    }
    let Faults { vanished, failed, returned, doubled, stale, restarts, undelivered, save_failed } = sum;
    let least = [vanished, failed, returned, doubled, stale, restarts, undelivered, save_failed];
    assert!(least.iter().all(|&n| n >= 5), "some fault hardly fired: {sum:?}");
    assert!(parts > 100 && doubled_by_farm > 5 && lost > 20, "{parts} parts, {doubled_by_farm} doubled, {lost} lost");
}

#[test]
fn the_same_events_give_the_same_effects() {
    let run = || {
        let mut world = World::new(11, true, true);
        world.run();
        (world.now.to_bits(), world.farm.counters(), world.asks, world.faults)
    };
    assert_eq!(run(), run());
}
