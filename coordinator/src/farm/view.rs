//! The farm as people see it: read-only.

use common::{
    job::{JobId, JobState, LeaseId, WorkerId},
    pass::PREPARE_PASS,
    protocol::{LeaseView, WorkerView},
};

use super::{
    Farm, WorkerHistory,
    job::{Job, Open, Phase, PieceState, Stage, Tile},
    worker::Worker,
};

/// A job's state and how far it is.
#[derive(Debug, Clone, PartialEq)]
pub struct JobStatus {
    /// Where it is in its life.
    pub state: JobState,
    /// Why it failed.
    pub message: Option<String>,
    /// 0 to 100.
    pub priority: u8,
    /// Version of the tracer it is pinned to.
    pub tracer: Option<String>,
    /// Share of the work done, 0 to 1.
    pub progress: f64,
    /// Samples per second over the last seconds.
    pub samples_per_second: f64,
    /// Seconds to the end, if it can be told from the progress of the last seconds.
    pub eta_seconds: Option<f64>,
    /// Processor seconds that it is served in a second, if any worker could serve it.
    pub cpu_rate: Option<f64>,
    /// Units handed back, failed or lost, and tried again.
    pub retries: u64,
    /// Workers that hold units of it.
    pub workers: u32,
    /// Its frames.
    pub frames: Vec<FrameStatus>,
}

/// How far a frame is.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameStatus {
    /// Frame number.
    pub frame: u32,
    /// Share of its work done, 0 to 1.
    pub progress: f64,
    /// Whether it is done.
    pub done: bool,
}

/// A tile of a frame that is being rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct TileStatus {
    /// `waiting`, `pending`, `leased` or `done`.
    pub state: &'static str,
    /// Passes finished.
    pub passes: u32,
    /// Attempts that failed.
    pub attempts: u32,
    /// Worker that has it, or had it last.
    pub worker: Option<WorkerId>,
}

impl Farm {
    /// The jobs' names, oldest first.
    pub fn jobs(&self) -> impl DoubleEndedIterator<Item = JobId> + '_ {
        self.jobs.keys().copied()
    }

    /// A job's state, without the rest.
    #[must_use]
    pub fn job_state(&self, id: JobId) -> Option<JobState> {
        self.jobs.get(&id).map(|job| job.state)
    }

    /// Version of the tracer that a job is pinned to.
    #[must_use]
    pub fn tracer(&self, id: JobId) -> Option<String> {
        self.jobs.get(&id)?.spec.tracer.clone()
    }

    /// What is stored of a job beside its frames: state, message, priority.
    #[must_use]
    pub fn brief(&self, id: JobId) -> Option<(JobState, Option<String>, u8)> {
        self.jobs.get(&id).map(|job| (job.state, job.message.clone(), job.spec.priority))
    }

    /// Who holds a lease.
    #[must_use]
    pub fn holder(&self, lease: LeaseId) -> Option<WorkerId> {
        self.leases.get(&lease).map(|held| held.worker)
    }

    /// Frames of a job that are done, ascending.
    #[must_use]
    pub fn frames_done(&self, id: JobId) -> Vec<u32> {
        let frames = self.jobs.get(&id).map(|job| job.frames.as_slice()).unwrap_or_default();
        frames.iter().filter(|frame| matches!(frame.stage, Stage::Done)).map(|frame| frame.number).collect()
    }

    /// A job's state and how far it is.
    #[must_use]
    pub fn job(&self, id: JobId, now: f64) -> Option<JobStatus> {
        let job = self.jobs.get(&id)?;
        let frames: Vec<FrameStatus> = job
            .frames
            .iter()
            .map(|frame| FrameStatus {
                frame: frame.number,
                progress: job.frame_progress(frame),
                done: matches!(frame.stage, Stage::Done),
            })
            .collect();
        Some(JobStatus {
            state: job.state,
            message: job.message.clone(),
            priority: job.spec.priority,
            tracer: job.spec.tracer.clone(),
            progress: frames.iter().map(|frame| frame.progress).sum::<f64>() / frames.len().max(1) as f64,
            samples_per_second: if job.state.is_final() { 0.0 } else { job.samples.get(now) },
            eta_seconds: eta(job, now),
            cpu_rate: self.cpu_rate(id, job, now),
            retries: job.retries,
            workers: {
                let held = self.leases.values().filter(|held| held.job == id);
                held.map(|held| held.worker).collect::<std::collections::BTreeSet<_>>().len() as u32
            },
            frames,
        })
    }

    /// As measured over the last seconds; what its workers could do where that is not known yet.
    fn cpu_rate(&self, id: JobId, job: &Job, now: f64) -> Option<f64> {
        let measured = job.history.front().and_then(|&(then, _, before)| {
            let (wall, delivered) = (now - then, job.delivered - before);
            (job.state == JobState::Active && wall >= 2.0 && delivered > 0.0).then(|| delivered / wall)
        });
        let capacity = || self.eligible(id, now).iter().filter_map(|w| self.workers.get(w)).map(Worker::capacity).sum();
        measured.or_else(|| Some(capacity()).filter(|&rate: &f64| rate > 0.0))
    }

    /// The tiles of a frame that is being rendered, in index order; `None` for one that is not.
    #[must_use]
    pub fn tiles(&self, id: JobId, frame: u32) -> Option<Vec<TileStatus>> {
        let open = self.jobs.get(&id)?.open_ref(frame)?;
        Some(open.tiles.iter().map(|tile| self.tile_status(open, tile)).collect())
    }

    fn tile_status(&self, _open: &Open, tile: &Tile) -> TileStatus {
        let mut worker = tile.worker;
        let state = match &tile.phase {
            Phase::Finished => "done",
            Phase::Waiting | Phase::Planning => "waiting",
            Phase::Running(running) => {
                let holder = running.pieces.iter().flat_map(|piece| &piece.holders).next();
                worker = holder.and_then(|lease| self.leases.get(lease)).map(|held| held.worker).or(worker);
                let begun = |state| matches!(state, PieceState::Leased | PieceState::Saving);
                if running.pieces.iter().any(|piece| begun(piece.state)) { "leased" } else { "pending" }
            }
        };
        let passes = if tile.passes == PREPARE_PASS { 0 } else { tile.passes };
        TileStatus { state, passes, attempts: tile.attempts, worker }
    }

    /// All workers, oldest first.
    #[must_use]
    pub fn workers(&self, now: f64) -> Vec<WorkerView> {
        self.workers.keys().filter_map(|&id| self.worker(id, now)).collect()
    }

    /// One worker.
    #[must_use]
    pub fn worker(&self, id: WorkerId, now: f64) -> Option<WorkerView> {
        let worker = self.workers.get(&id)?;
        let leases = || worker.leases.iter().filter_map(|lease| Some((*lease, self.leases.get(lease)?)));
        let lease = leases().next().map(|(id, held)| LeaseView {
            id,
            job: held.job,
            frame: held.frame,
            units: held.units.len() as u64,
            seconds: (now - held.granted_at).max(0.0),
        });
        Some(WorkerView {
            id,
            machine: worker.register.machine.clone(),
            state: worker.state(now).into(),
            threads: worker.register.threads,
            cpu_features: worker.register.cpu_features.clone(),
            tracer: worker.register.tracer.clone(),
            samples_per_second: worker.samples.get(now),
            units: worker.history.units,
            failures: worker.history.failures,
            last_seen_seconds: (now - worker.last_seen).max(0.0),
            leased: leases().map(|(_, held)| held.units.len() as u64).sum(),
            samples_per_second_before: worker.samples_before.since(worker.since, now),
            lease,
            prepared: worker.prepared.iter().copied().collect(),
        })
    }

    /// What is to be remembered of a worker across restarts.
    #[must_use]
    pub fn worker_history(&self, id: WorkerId) -> Option<(common::protocol::Register, WorkerHistory)> {
        self.workers.get(&id).map(|worker| (worker.register.clone(), worker.history))
    }

    /// Units waiting to be leased, and units that are out.
    #[must_use]
    pub fn queue(&self) -> (u64, u64) {
        let frames = self.jobs.values().filter(|job| job.runnable()).flat_map(|job| &job.frames);
        let pending = frames.map(|frame| match &frame.stage {
            Stage::Open(open) => open.pending.len() as u64,
            _ => 0,
        });
        (pending.sum(), self.leases.values().map(|held| held.units.len() as u64).sum())
    }
}

/// Seconds to the end, from the progress of the last seconds.
fn eta(job: &Job, now: f64) -> Option<f64> {
    let &(then, before, _) = job.history.front()?;
    let progress = job.progress();
    let rate = (progress - before) / (now - then);
    (job.state == JobState::Active && now - then >= 1.0 && rate > 0.0).then(|| (1.0 - progress) / rate)
}
