//! Leases: which units a worker gets, how many, and what becomes of them when it does not hand them in.

use common::{
    job::{JobId, JobState, LeaseId, WorkerId},
    pass::{PREPARE_PASS, Work},
    protocol::{Outcome, Unit, UnitId},
    tile::Rect,
};

use super::{
    Attempt, DEADLINE_FACTOR, DEADLINE_GRACE, Effect, Farm, Grant, LEASE_SECONDS, LEASE_TARGET,
    job::{Phase, Piece, PieceState, Running, Stage},
};

/// Leases a worker holds at most: one it renders, one it has fetched ahead, one on its way.
const MAX_LEASES: usize = 3;

/// A worker that waits for work.
#[derive(Debug)]
pub(super) struct Ask {
    pub(super) ask: u64,
    pub(super) worker: WorkerId,
}

/// A lease that is out.
#[derive(Debug)]
pub(super) struct Held {
    pub(super) worker: WorkerId,
    pub(super) job: JobId,
    pub(super) frame: u32,
    pub(super) units: Vec<HeldUnit>,
    pub(super) granted_at: f64,
    /// It ends here unless it is renewed.
    pub(super) expires: f64,
    /// Units still out by then have hung.
    pub(super) deadline: f64,
    /// Processor seconds of the units handed in so far.
    pub(super) cpu_seconds: f64,
}

#[derive(Debug)]
pub(super) struct HeldUnit {
    pub(super) unit: UnitRef,
    /// Predicted processor seconds.
    cost: f64,
    /// When it is predicted to be done.
    due: f64,
}

/// A unit by its place in the farm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct UnitRef {
    pub(super) tile: u32,
    pub(super) pass: u32,
    pub(super) piece: u32,
}

/// Why a lease ends before its units are done.
#[derive(Debug, Clone)]
pub(super) enum Release {
    /// Nobody's fault.
    Returned,
    /// The worker vanished.
    Lost,
    /// Its time is over.
    Hung,
}

/// A unit that is out and might be given to a second worker.
struct Straggler {
    /// Seconds until it is done, as predicted; an overdue one is thought to need twice what it is late.
    remaining: f64,
    job: JobId,
    frame: u32,
    unit: UnitRef,
    cost: f64,
    holder: WorkerId,
}

/// What a job has for a worker.
enum Cut {
    /// Units of this frame, with their predicted processor seconds.
    Units(u32, Vec<(UnitRef, f64)>),
    /// A frame was begun, and is being planned.
    Begun,
    Nothing,
}

impl Farm {
    /// Answer the requests that wait, oldest first, as far as there is work.
    pub(super) fn serve(&mut self, now: f64, out: &mut Vec<Effect>) {
        let mut stragglers = None;
        let mut waiting = std::mem::take(&mut self.asks);
        waiting.retain(|ask| {
            let Some(lease) = self.find_lease(ask.worker, &mut stragglers, now, out) else { return true };
            out.push(Effect::Grant(ask.ask, lease));
            false
        });
        // Nothing asks while requests are being answered.
        self.asks = waiting;
    }

    fn find_lease(
        &mut self,
        id: WorkerId,
        stragglers: &mut Option<Vec<Straggler>>,
        now: f64,
        out: &mut Vec<Effect>,
    ) -> Option<Grant> {
        let worker = self.workers.get(&id)?;
        if !worker.available(now) || worker.leases.len() >= MAX_LEASES {
            return None;
        }
        let order = self.job_order(id);
        for &job in &order {
            match self.cut(job, id, now, out) {
                Cut::Units(frame, units) => return self.grant(id, job, frame, units, now, out),
                // Its units come in a moment, and are not to be overtaken by those of a lesser job.
                Cut::Begun => return None,
                Cut::Nothing => {}
            }
        }
        let worker = self.workers.get(&id)?;
        if !worker.leases.is_empty() {
            return None;
        }
        let stragglers = stragglers.get_or_insert_with(|| self.stragglers(now));
        let at = stragglers
            .iter()
            .position(|s| s.holder != id && order.contains(&s.job) && s.remaining > s.cost / worker.capacity() + 0.2)?;
        let straggler = stragglers.swap_remove(at);
        self.counters.duplicated += 1;
        self.grant(id, straggler.job, straggler.frame, vec![(straggler.unit, straggler.cost)], now, out)
    }

    /// Jobs that this worker may serve: priority first; among equals the one served least, but a scene that
    /// it holds prepared is worth some seconds.
    fn job_order(&self, id: WorkerId) -> Vec<JobId> {
        let Some(worker) = self.workers.get(&id) else { return Vec::new() };
        let mut order: Vec<(std::cmp::Reverse<u8>, f64, JobId)> = Vec::new();
        for (&job_id, job) in &self.jobs {
            let fits = job.spec.tracer.as_ref().is_none_or(|tracer| *tracer == worker.register.tracer);
            if !job.runnable() || !fits {
                continue;
            }
            let prepared = worker.prepared.iter().any(|(scene, _)| *scene == job.spec.scene);
            let bonus = if prepared { 2.0 * LEASE_TARGET * worker.capacity() } else { 0.0 };
            order.push((std::cmp::Reverse(job.spec.priority), job.served - bonus, job_id));
        }
        order.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        order.into_iter().map(|(_, _, job)| job).collect()
    }

    /// Choose units of one frame of a job for a worker. May begin a frame, whose units come a moment later.
    fn cut(&mut self, id: JobId, worker: WorkerId, now: f64, out: &mut Vec<Effect>) -> Cut {
        let eligible: Vec<WorkerId> = self.eligible(id, now);
        let Some(capacity) = self.workers.get(&worker).map(|worker| worker.capacity()) else { return Cut::Nothing };
        let all: f64 = eligible.iter().filter_map(|w| self.workers.get(w)).map(|w| w.capacity()).sum();
        let Some(job) = self.jobs.get_mut(&id) else { return Cut::Nothing };
        let target = job.lease_seconds(all.max(capacity)) * capacity;
        let mut planning = false;
        let mut open_frames = 0;
        let mut waiting = None;
        for index in job.first..job.frames.len() {
            match &job.frames[index].stage {
                Stage::Done => {}
                Stage::Waiting(_) => {
                    waiting = Some(index);
                    break;
                }
                Stage::Open(open) => {
                    open_frames += 1;
                    planning |= open.planning > 0;
                    if open.pending.is_empty() {
                        continue;
                    }
                    let units = job.take(index, worker, &eligible, target);
                    if !units.is_empty() {
                        return Cut::Units(job.frames[index].number, units);
                    }
                }
            }
        }
        let preparing = job.spec.prepare.is_some() && open_frames > 0;
        if let Some(index) = waiting
            && !planning
            && !preparing
            && open_frames <= eligible.len() + 1
        {
            job.open(index, out);
            if job.spec.prepare.is_some() {
                // Nothing is to be planned: its unit is there.
                let units = job.take(index, worker, &eligible, target);
                return if units.is_empty() { Cut::Nothing } else { Cut::Units(job.frames[index].number, units) };
            }
            return Cut::Begun;
        }
        Cut::Nothing
    }

    /// Workers that could take units of a job now.
    pub(super) fn eligible(&self, id: JobId, now: f64) -> Vec<WorkerId> {
        let tracer = self.jobs.get(&id).and_then(|job| job.spec.tracer.as_ref());
        let fits = |tracer_of: &String| tracer.is_none_or(|tracer| tracer == tracer_of);
        let available = self.workers.iter().filter(|(_, w)| w.available(now) && fits(&w.register.tracer));
        available.map(|(&id, _)| id).collect()
    }

    fn grant(
        &mut self,
        id: WorkerId,
        job_id: JobId,
        frame: u32,
        units: Vec<(UnitRef, f64)>,
        now: f64,
        out: &mut Vec<Effect>,
    ) -> Option<Grant> {
        let worker = self.workers.get_mut(&id)?;
        let job = self.jobs.get_mut(&job_id)?;
        let lease = LeaseId(self.next_lease);
        self.next_lease += 1;
        if job.spec.tracer.is_none() {
            job.spec.tracer = Some(worker.register.tracer.clone());
            out.push(Effect::JobChanged(job_id));
        }
        if job.state == JobState::Queued {
            job.state = JobState::Active;
            out.push(Effect::JobChanged(job_id));
        }
        let mut held = Vec::with_capacity(units.len());
        let mut sent = Vec::with_capacity(units.len());
        let mut due = worker.busy_until.max(now);
        for (unit, cost) in units {
            due += cost / worker.capacity();
            job.served += cost;
            let open = job.open_mut(frame)?;
            let tile = &mut open.tiles[unit.tile as usize];
            let rect = tile.rect;
            let Phase::Running(running) = &mut tile.phase else { continue };
            let Running { work, pieces, .. } = running;
            let piece = &mut pieces[unit.piece as usize];
            piece.state = PieceState::Leased;
            piece.holders.push(lease);
            sent.push(unit_of(job_id, frame, unit, rect, piece.rect, work));
            held.push(HeldUnit { unit, cost, due });
        }
        worker.busy_until = due;
        worker.leases.insert(lease);
        self.counters.leases += 1;
        self.counters.units_leased += sent.len() as u64;
        let deadline = now + DEADLINE_GRACE + DEADLINE_FACTOR * (due - now).max(LEASE_TARGET);
        self.leases.insert(
            lease,
            Held {
                worker: id,
                job: job_id,
                frame,
                units: held,
                granted_at: now,
                expires: now + LEASE_SECONDS,
                deadline,
                cpu_seconds: 0.0,
            },
        );
        out.push(Effect::WorkerChanged(id));
        Some(Grant { lease, worker: id, job: job_id, frame, units: sent })
    }

    /// Units that are out with one worker, those done last first.
    fn stragglers(&self, now: f64) -> Vec<Straggler> {
        let mut found = Vec::new();
        for held in self.leases.values() {
            let Some(open) = self.jobs.get(&held.job).and_then(|job| job.open_ref(held.frame)) else { continue };
            for unit in &held.units {
                let Phase::Running(running) = &open.tiles[unit.unit.tile as usize].phase else { continue };
                let piece = &running.pieces[unit.unit.piece as usize];
                if piece.state == PieceState::Leased && piece.holders.len() == 1 && !piece.suspicious() {
                    found.push(Straggler {
                        remaining: if unit.due >= now { unit.due - now } else { 2.0 * (now - unit.due) },
                        job: held.job,
                        frame: held.frame,
                        unit: unit.unit,
                        cost: unit.cost,
                        holder: held.worker,
                    });
                }
            }
        }
        found.sort_by(|a, b| b.remaining.total_cmp(&a.remaining).then(a.unit.cmp(&b.unit)));
        found
    }

    /// A unit is no longer this lease's concern.
    pub(super) fn strike_out(&mut self, lease: LeaseId, unit: UnitRef, now: f64) {
        let Some(held) = self.leases.get_mut(&lease) else { return };
        held.units.retain(|held| held.unit != unit);
        if held.units.is_empty() {
            let (id, cpu_seconds, granted_at) = (held.worker, held.cpu_seconds, held.granted_at);
            self.leases.remove(&lease);
            if let Some(worker) = self.workers.get_mut(&id) {
                worker.leases.remove(&lease);
                worker.finished_lease(cpu_seconds, granted_at, now);
            }
            self.stirred = true;
        }
    }

    /// End a lease; its units go back.
    pub(super) fn release(&mut self, lease: LeaseId, why: Release, now: f64, out: &mut Vec<Effect>) {
        let Some(held) = self.leases.remove(&lease) else { return };
        if let Some(worker) = self.workers.get_mut(&held.worker) {
            worker.leases.remove(&lease);
            if worker.leases.is_empty() {
                worker.busy_until = now;
                worker.free_since = now;
            }
            out.push(Effect::WorkerChanged(held.worker));
        }
        let units: Vec<UnitRef> = held.units.iter().map(|held| held.unit).collect();
        match why {
            Release::Returned => {
                let why = (Outcome::Returned, "handed back unrendered");
                self.attempts_failed((lease, &held), &units, why, now, out);
                self.give_back(lease, &held, &units, |_| {});
                self.counters.returned += units.len() as u64;
            }
            Release::Lost => {
                let why = (Outcome::Lost, "the worker fell silent while it held the unit");
                self.attempts_failed((lease, &held), &units, why, now, out);
                let worst = self.give_back(lease, &held, &units, |piece| piece.lost += 1);
                self.counters.lost += units.len() as u64;
                if worst.lost >= super::MAX_LOST {
                    let unit = worst.describe(held.frame);
                    let message = format!("{unit}: the workers that rendered it were lost {} times", worst.lost);
                    self.fail_job(held.job, message, out);
                }
            }
            Release::Hung => {
                let seconds = now - held.granted_at;
                let message = format!("not done within {seconds:.0} s");
                self.units_failed(lease, &held, &units, (Outcome::Hung, &message), now, out);
            }
        }
    }

    /// What is told of attempts at units of a lease that came to nothing.
    pub(super) fn attempts_failed(
        &self,
        (lease, held): (LeaseId, &Held),
        units: &[UnitRef],
        (outcome, message): (Outcome, &str),
        now: f64,
        out: &mut Vec<Effect>,
    ) {
        let open = self.jobs.get(&held.job).and_then(|job| job.open_ref(held.frame));
        out.extend(units.iter().filter_map(|unit| {
            let tile = open?.tiles.get(unit.tile as usize)?;
            let rect = match &tile.phase {
                Phase::Running(running) if tile.passes == unit.pass => running.pieces.get(unit.piece as usize)?.rect,
                _ => tile.rect,
            };
            Some(Effect::AttemptFailed(Attempt {
                unit: UnitId { job: held.job, frame: held.frame, tile: unit.tile, pass: unit.pass, rect },
                lease,
                worker: held.worker,
                outcome,
                seconds: now - held.granted_at,
                message: message.into(),
            }))
        }));
    }

    /// Put units of a lease back to be leased again, and note why. Returns the worst that happened to one.
    pub(super) fn give_back(
        &mut self,
        lease: LeaseId,
        held: &Held,
        units: &[UnitRef],
        mut note: impl FnMut(&mut Piece),
    ) -> Worst {
        let mut worst = Worst::default();
        let Some(job) = self.jobs.get_mut(&held.job) else { return worst };
        job.retries += units.len() as u64;
        let Some(open) = job.open_mut(held.frame) else { return worst };
        for unit in units {
            let tile = &mut open.tiles[unit.tile as usize];
            let Phase::Running(running) = &mut tile.phase else { continue };
            if tile.passes != unit.pass {
                continue;
            }
            let Some(piece) = running.pieces.get_mut(unit.piece as usize) else { continue };
            piece.holders.retain(|&holder| holder != lease);
            let before = (piece.failures, piece.lost);
            note(piece);
            if (piece.failures, piece.lost) != before {
                tile.attempts += 1;
            }
            if piece.state == PieceState::Leased && piece.holders.is_empty() {
                piece.state = PieceState::Pending;
                open.pending.insert((unit.pass, unit.tile, unit.piece));
            }
            worst.see(unit, piece);
        }
        self.stirred = true;
        worst
    }

    /// End leases that nobody renews, and those whose units have hung.
    pub(super) fn expire_leases(&mut self, now: f64, out: &mut Vec<Effect>) {
        let over: Vec<(LeaseId, Release)> = self
            .leases
            .iter()
            .filter_map(|(&id, held)| match held {
                held if now > held.deadline => Some((id, Release::Hung)),
                held if now > held.expires && self.leaves(held.worker) => Some((id, Release::Returned)),
                held if now > held.expires => Some((id, Release::Lost)),
                _ => None,
            })
            .collect();
        for (id, why) in over {
            self.release(id, why, now, out);
        }
    }

    /// Whether a worker said that it leaves.
    fn leaves(&self, id: WorkerId) -> bool {
        self.workers.get(&id).is_none_or(|worker| worker.draining)
    }

    /// Forget the leases of a job that is over.
    pub(super) fn drop_leases(&mut self, id: JobId) {
        let over: Vec<LeaseId> = self.leases.iter().filter(|(_, held)| held.job == id).map(|(&id, _)| id).collect();
        for lease in over {
            let Some(held) = self.leases.remove(&lease) else { continue };
            if let Some(worker) = self.workers.get_mut(&held.worker) {
                worker.leases.remove(&lease);
            }
            let units: Vec<UnitRef> = held.units.iter().map(|held| held.unit).collect();
            self.give_back(lease, &held, &units, |_| {});
        }
    }
}

/// The worst that happened to a unit of a group.
#[derive(Debug, Default)]
pub(super) struct Worst {
    unit: Option<UnitRef>,
    pub(super) failures: u32,
    pub(super) lost: u32,
    pub(super) failed_on: Vec<WorkerId>,
}

impl Worst {
    fn see(&mut self, unit: &UnitRef, piece: &Piece) {
        if self.unit.is_none()
            || (piece.failures, piece.lost, piece.failed_on.len()) > (self.failures, self.lost, self.failed_on.len())
        {
            *self = Worst {
                unit: Some(*unit),
                failures: piece.failures,
                lost: piece.lost,
                failed_on: piece.failed_on.clone(),
            };
        }
    }

    /// The unit in words.
    pub(super) fn describe(&self, frame: u32) -> String {
        match self.unit {
            Some(UnitRef { pass: PREPARE_PASS, .. }) => "the choice of the method".to_owned(),
            Some(UnitRef { tile, pass, .. }) => format!("frame {frame}, tile {tile}, pass {pass}"),
            None => format!("frame {frame}"),
        }
    }
}

/// A unit as the worker gets it.
pub(super) fn unit_of(job: JobId, frame: u32, unit: UnitRef, tile: Rect, piece: Rect, work: &Work) -> Unit {
    let id = UnitId { job, frame, tile: unit.tile, pass: unit.pass, rect: piece };
    let work = match work {
        Work::PerPixel { .. } if piece != tile => {
            let index = |(x, y): (u32, u32)| ((y - tile.y) * tile.w + (x - tile.x)) as usize;
            work.select(piece.pixels().map(index))
        }
        _ => work.clone(),
    };
    Unit { id, work, features: unit.pass == 0 }
}
