//! The farm as a state machine: `apply(event, now) -> effects`, and nothing else.
//!
//! It decides who renders what: jobs, frames, tiles and their passes, units, leases, workers, retries.
//! It knows nothing of clocks, sockets, stores, pixels or async runtimes; time comes in with every event,
//! in seconds since any fixed moment. The same events give the same effects.

mod job;
mod lease;
mod life;
mod results;
mod size;
mod view;
mod worker;

#[cfg(test)]
mod simulation;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};

use common::{
    hash::AssetHash,
    job::{JobId, JobState, LeaseId, WorkerId},
    pass::Work,
    plan::Trial,
    protocol::{FailureCause, Outcome, Register, Unit, UnitId},
    tile::{Rect, TileGrid},
};

pub use job::transition;
pub use view::{FrameStatus, JobStatus, TileStatus};

use job::Job;
use lease::{Ask, Held};
use worker::Worker;

/// Wall time that a lease is cut to, seconds.
pub const LEASE_TARGET: f64 = 1.0;
/// Wall time below which leases are not shrunk near the end of a frame, seconds.
pub const LEASE_LEAST: f64 = 0.1;
/// Seconds a lease lives without being renewed.
pub const LEASE_SECONDS: f64 = common::protocol::WORKER_LOST_SECONDS;
/// Distinct workers a unit may fail on, or times where there are fewer, before it fails its job.
pub const MAX_FAILURES: u32 = 3;
/// Times a unit may be lost with its worker before it fails its job.
pub const MAX_LOST: u32 = 3;
/// Failures in a row after which a worker is given no work for [`DISABLED_SECONDS`].
pub const MAX_STRIKES: u32 = 3;
/// How long such a worker is left alone, seconds.
pub const DISABLED_SECONDS: f64 = 60.0;
/// A unit must be done within this multiple of its predicted time, and [`DEADLINE_GRACE`].
pub const DEADLINE_FACTOR: f64 = 10.0;
/// Added to every unit's deadline, seconds: loading a scene takes a while.
pub const DEADLINE_GRACE: f64 = 120.0;

/// One tile of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TileKey {
    /// Job.
    pub job: JobId,
    /// Frame number.
    pub frame: u32,
    /// Tile index in the frame.
    pub tile: u32,
}

impl From<&UnitId> for TileKey {
    fn from(unit: &UnitId) -> Self {
        TileKey { job: unit.job, frame: unit.frame, tile: unit.tile }
    }
}

/// What the farm must know of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct JobSpec {
    /// Its name.
    pub id: JobId,
    /// The scene file: workers that hold it prepared are preferred.
    pub scene: AssetHash,
    /// Frame numbers, ascending.
    pub frames: Vec<u32>,
    /// The tiles of each frame.
    pub grid: TileGrid,
    /// Samples of a batch.
    pub batch: u32,
    /// Whether a tile's next pass waits until its neighbours have finished the one before.
    pub gated: bool,
    /// 0 (last) to 100 (first).
    pub priority: u8,
    /// Tracer version it is pinned to, where a worker has begun already.
    pub tracer: Option<String>,
    /// What a worker must prepare before anything is rendered.
    pub prepare: Option<Trial>,
}

/// How far a tile had come when it was last stored.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TileProgress {
    /// Passes merged.
    pub passes: u32,
    /// Share of its work done, 0 to 1.
    pub share: f64,
    /// Whether the rule said that it is finished.
    pub finished: bool,
    /// Attempts that failed.
    pub attempts: u32,
    /// Worker of the last result.
    pub worker: Option<WorkerId>,
    /// Parts of the next pass that are stored: the split's size in pixels, and their rectangles.
    pub parts: Option<(usize, Vec<Rect>)>,
}

/// A job as it was stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Restored {
    /// The job.
    pub spec: JobSpec,
    /// Its state.
    pub state: JobState,
    /// Why it failed.
    pub message: Option<String>,
    /// Frames that are done.
    pub done: Vec<u32>,
    /// Tiles of the other frames, by frame and index; absent ones have not begun.
    pub tiles: BTreeMap<(u32, u32), TileProgress>,
}

/// What people do to a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Give it up.
    Cancel,
    /// Hold it back.
    Pause,
    /// Let it go on.
    Resume,
    /// Try a failed or canceled job again, from what it has.
    Requeue,
    /// Change its priority.
    Priority(u8),
    /// Forget it; only when it is final.
    Remove,
}

/// What people do to a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorkerCommand {
    /// Finish what is begun, then no more.
    Drain,
    /// Give it work again.
    Enable,
    /// Give it no work; what it holds goes to others.
    Disable,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A new job.
    Submit(JobSpec),
    /// A stored job comes back, after a restart or with a finer target. Replaces one of the same name.
    Restore(Box<Restored>),
    /// A person's wish for a job.
    Command(JobId, Command),
    /// Answers to [`Effect::Plan`]. Those that are ready together come together, so that leases are cut from
    /// all of them.
    Planned(Vec<Plan>),
    /// A worker process starts.
    Register(Register),
    /// A worker known from before a restart; lost until it is heard of.
    RestoreWorker(WorkerId, Register, WorkerHistory),
    /// A worker wants work; the request is named by `ask`.
    Ask {
        /// The worker.
        worker: WorkerId,
        /// Names the request.
        ask: u64,
        /// Scenes it holds prepared, by frame.
        prepared: Vec<(AssetHash, u32)>,
    },
    /// A request for work went away unanswered.
    AskGone(u64),
    /// A lease could not be delivered.
    Undelivered(LeaseId),
    /// A worker is there.
    Heartbeat {
        /// The worker.
        worker: WorkerId,
        /// Leases to renew.
        leases: Vec<LeaseId>,
        /// Whether it leaves.
        draining: bool,
        /// Scenes it holds prepared, by frame.
        prepared: Vec<(AssetHash, u32)>,
    },
    /// A person's wish for a worker.
    WorkerCommand(WorkerId, WorkerCommand),
    /// A valid result arrived; it is not stored yet.
    Result {
        /// The lease it was rendered under, maybe long gone.
        lease: LeaseId,
        /// The unit.
        unit: UnitId,
        /// Samples taken.
        samples: u64,
        /// Processor seconds spent.
        cpu_seconds: f64,
    },
    /// What a job must have prepared is on disk: its units may be rendered.
    Prepared(JobId),
    /// An accepted part of a split pass is on disk.
    Saved(UnitId),
    /// The whole pass of a tile is merged and on disk.
    Merged {
        /// The tile.
        tile: TileKey,
        /// The pass.
        pass: u32,
    },
    /// An accepted result could not be stored.
    SaveFailed(UnitId),
    /// The parts of a pass could not be merged: the store is broken for this job.
    MergeFailed(TileKey, String),
    /// Units come back unrendered.
    Failed {
        /// The lease.
        lease: LeaseId,
        /// The worker.
        worker: WorkerId,
        /// The units.
        units: Vec<UnitId>,
        /// Whose fault it is.
        cause: FailureCause,
        /// One sentence for people.
        message: String,
    },
    /// The answer to [`Effect::Measure`].
    Measured {
        /// The job.
        job: JobId,
        /// The frame.
        frame: u32,
        /// It must be gone over again: its tiles count as having this many passes, and none is finished.
        again: Option<u32>,
    },
    /// Time passes.
    Tick,
}

/// The work of one pass of a tile.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The tile.
    pub tile: TileKey,
    /// The pass.
    pub pass: u32,
    /// What to render, and the share of the tile that is done after it; `None` finishes the tile.
    pub work: Option<(Work, f64)>,
}

/// What must be done about it.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Plan this pass and answer with [`Event::Planned`].
    Plan(TileKey, u32),
    /// Answer request `ask` with a lease.
    Grant(u64, Grant),
    /// Store this result: as the whole pass of its tile, then [`Event::Merged`]; as a part, then
    /// [`Event::Saved`]; or as what was to be prepared, then [`Event::Prepared`].
    Accept(Accepted),
    /// The result's unit is closed, unknown, or being stored: nothing to do.
    Closed,
    /// All parts of the pass are stored: merge them, then [`Event::Merged`].
    Merge(Accepted),
    /// The tile is finished: no pass will follow under this target.
    TileFinished(TileKey),
    /// All tiles of a frame are finished: measure what was reached, then [`Event::Measured`].
    Measure(JobId, u32),
    /// A frame is done.
    FrameDone(JobId, u32),
    /// The job's state, message, tracer or priority changed.
    JobChanged(JobId),
    /// The worker came, went, or changed its state.
    WorkerChanged(WorkerId),
    /// The worker's name, in answer to [`Event::Register`].
    Registered(WorkerId),
    /// An attempt at a unit came to nothing.
    AttemptFailed(Attempt),
    /// The answer to [`Event::Heartbeat`].
    Heartbeat {
        /// Leases to stop.
        cancelled: Vec<LeaseId>,
        /// Whether to ask for no more.
        drain: bool,
    },
    /// No such job.
    UnknownJob(JobId),
    /// No such worker: it must register.
    UnknownWorker(WorkerId),
    /// The command cannot be carried out in this state, one sentence.
    Conflict(String),
}

/// A result to be stored, or parts to be merged.
#[derive(Debug, Clone, PartialEq)]
pub struct Accepted {
    /// The unit, with the tile's whole rectangle in [`Effect::Merge`].
    pub unit: UnitId,
    /// Size of the split in pixels, where the unit is a part of its tile.
    pub split: Option<usize>,
    /// Share of the tile's work done after this pass.
    pub share: f64,
    /// Attempts that failed in this tile so far.
    pub attempts: u32,
    /// Who rendered it, where known.
    pub worker: Option<WorkerId>,
    /// Seconds since its lease was given, where known.
    pub seconds: Option<f64>,
}

/// An attempt at a unit that came to nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Attempt {
    /// The unit.
    pub unit: UnitId,
    /// The lease it was given under.
    pub lease: LeaseId,
    /// Who had it.
    pub worker: WorkerId,
    /// Why; all but `Returned` count against it.
    pub outcome: Outcome,
    /// Seconds since its lease was given.
    pub seconds: f64,
    /// One sentence.
    pub message: String,
}

/// Units for one worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Grant {
    /// Names the lease.
    pub lease: LeaseId,
    /// Who gets it.
    pub worker: WorkerId,
    /// The job.
    pub job: JobId,
    /// Frame number.
    pub frame: u32,
    /// The units, all of this job and frame.
    pub units: Vec<Unit>,
}

/// What is remembered of a worker.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WorkerHistory {
    /// Units handed in.
    pub units: u64,
    /// Units failed.
    pub failures: u64,
    /// Whether a person disabled it.
    pub disabled: bool,
}

/// Whether a result for a unit is still wanted.
#[derive(Debug, Clone, PartialEq)]
pub enum Wanted {
    /// Yes; this is what it must hold.
    Open(Unit),
    /// No: it is done, or its job is over.
    Closed,
    /// There is no such unit.
    Unknown,
}

/// Counts since the start, for the metrics.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Leases given.
    pub leases: u64,
    /// Units given, duplicates among them.
    pub units_leased: u64,
    /// Units given a second time while the first worker still held them.
    pub duplicated: u64,
    /// Results accepted.
    pub accepted: u64,
    /// Results that came too late or twice.
    pub closed: u64,
    /// Units that failed on a worker.
    pub failed: u64,
    /// Units that were lost with a worker or an expired lease.
    pub lost: u64,
    /// Units handed back.
    pub returned: u64,
    /// Workers lost.
    pub workers_lost: u64,
}

/// The state of the whole farm. See the module's documentation.
#[derive(Debug, Default)]
pub struct Farm {
    jobs: BTreeMap<JobId, Job>,
    workers: BTreeMap<WorkerId, Worker>,
    leases: BTreeMap<LeaseId, Held>,
    asks: VecDeque<Ask>,
    next_lease: u64,
    next_worker: u64,
    counters: Counters,
    /// Whether work may have appeared for requests that wait.
    stirred: bool,
}

impl Farm {
    /// An empty farm. `epoch` counts the starts of the coordinator, so that no lease has the name of one
    /// given before a restart.
    #[must_use]
    pub fn new(epoch: u64) -> Self {
        Farm { next_lease: (epoch << 32) + 1, next_worker: 1, ..Farm::default() }
    }

    /// Take in one event at time `now`, seconds, and say what must be done. Time never runs backwards.
    pub fn apply(&mut self, event: Event, now: f64) -> Vec<Effect> {
        let mut out = Vec::new();
        match event {
            Event::Submit(spec) => self.submit(spec, now, &mut out),
            Event::Restore(restored) => self.restore(*restored, now, &mut out),
            Event::Command(job, command) => self.command(job, command, now, &mut out),
            Event::Planned(plans) => plans.into_iter().for_each(|plan| self.planned(plan, &mut out)),
            Event::Register(register) => self.register(register, now, &mut out),
            Event::RestoreWorker(id, register, history) => self.restore_worker(id, register, history, now),
            Event::Ask { worker, ask, prepared } => self.ask(worker, ask, prepared, now, &mut out),
            Event::AskGone(ask) => self.asks.retain(|waiting| waiting.ask != ask),
            Event::Undelivered(lease) => self.release(lease, lease::Release::Returned, now, &mut out),
            Event::Heartbeat { worker, leases, draining, prepared } => {
                self.heartbeat(worker, leases, draining, prepared, now, &mut out);
            }
            Event::WorkerCommand(worker, command) => self.worker_command(worker, command, now, &mut out),
            Event::Result { lease, unit, samples, cpu_seconds } => {
                self.result(lease, unit, samples, cpu_seconds, now, &mut out);
            }
            Event::Prepared(job) => self.prepared(job, now, &mut out),
            Event::Saved(unit) => self.saved(unit, &mut out),
            Event::Merged { tile, pass } => self.merged(tile, pass, now, &mut out),
            Event::SaveFailed(unit) => self.save_failed(unit),
            Event::MergeFailed(tile, message) => self.fail_job(tile.job, message, &mut out),
            Event::Failed { lease, worker, units, cause, message } => {
                self.failed(lease, worker, &units, cause, &message, now, &mut out);
            }
            Event::Measured { job, frame, again } => self.measured(job, frame, again, &mut out),
            Event::Tick => self.tick(now, &mut out),
        }
        if std::mem::take(&mut self.stirred) {
            self.serve(now, &mut out);
        }
        out
    }

    /// Counts since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    fn tick(&mut self, now: f64, out: &mut Vec<Effect>) {
        // Workers first: what a lost one held is returned for that reason.
        self.watch_workers(now, out);
        self.expire_leases(now, out);
        for job in self.jobs.values_mut() {
            job.meter(now);
        }
        self.stirred = true;
    }
}
