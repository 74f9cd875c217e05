//! Workers: who is there, how fast, and who may be given work.

use std::collections::BTreeSet;

use common::{
    hash::AssetHash,
    job::{JobId, LeaseId, WorkerId},
    protocol::{Register, WORKER_LOST_SECONDS},
};

use super::{
    Ask, DISABLED_SECONDS, Effect, Farm, LEASE_SECONDS, MAX_STRIKES, WorkerCommand, WorkerHistory, job::Rate,
    lease::Release,
};

#[derive(Debug)]
pub(super) struct Worker {
    pub(super) register: Register,
    pub(super) history: WorkerHistory,
    pub(super) last_seen: f64,
    pub(super) lost: bool,
    pub(super) draining: bool,
    /// Failures in a row.
    pub(super) strikes: u32,
    /// Given no work before this moment, after failures in a row.
    pub(super) disabled_until: f64,
    pub(super) prepared: BTreeSet<(AssetHash, u32)>,
    pub(super) leases: BTreeSet<LeaseId>,
    /// When it will have worked off what it holds, as predicted.
    pub(super) busy_until: f64,
    /// When it finished its last lease.
    pub(super) free_since: f64,
    /// Processor seconds it delivers in a second, measured over its leases.
    pub(super) speed: Option<f64>,
    /// Jobs that it has handed in results of.
    pub(super) jobs: BTreeSet<JobId>,
    pub(super) samples: Rate,
    /// The same over ten minutes.
    pub(super) samples_before: Rate<600>,
    /// When it came.
    pub(super) since: f64,
}

impl Worker {
    fn new(register: Register, history: WorkerHistory, now: f64) -> Self {
        Worker {
            register,
            history,
            last_seen: now,
            lost: false,
            draining: false,
            strikes: 0,
            disabled_until: f64::NEG_INFINITY,
            prepared: BTreeSet::new(),
            leases: BTreeSet::new(),
            busy_until: now,
            free_since: now,
            speed: None,
            jobs: BTreeSet::new(),
            samples: Rate::default(),
            samples_before: Rate::default(),
            since: now,
        }
    }

    /// Whether it may be given work.
    pub(super) fn available(&self, now: f64) -> bool {
        !self.lost && !self.draining && !self.history.disabled && now >= self.disabled_until
    }

    /// Processor seconds it delivers in a second; its threads until that is measured.
    pub(super) fn capacity(&self) -> f64 {
        let threads = f64::from(self.register.threads.max(1));
        self.speed.unwrap_or(threads).clamp(threads * 0.02, threads * 4.0)
    }

    /// A lease is worked off: learn from it how fast the worker is.
    pub(super) fn finished_lease(&mut self, cpu_seconds: f64, granted_at: f64, now: f64) {
        let began = granted_at.max(self.free_since);
        self.free_since = now;
        let wall = now - began;
        if wall > 1e-3 && cpu_seconds > 0.0 {
            let measured = cpu_seconds / wall;
            self.speed = Some(self.speed.map_or(measured, |known| 0.7 * known + 0.3 * measured));
        }
        if self.leases.is_empty() {
            self.busy_until = now;
        }
    }

    pub(super) fn state(&self, now: f64) -> &'static str {
        if self.lost {
            "lost"
        } else if self.history.disabled || now < self.disabled_until {
            "disabled"
        } else if self.draining {
            "draining"
        } else if self.leases.is_empty() {
            "idle"
        } else {
            "busy"
        }
    }
}

impl Farm {
    /// A worker process starts, or asks again because it did not hear the answer.
    pub(super) fn register(&mut self, register: Register, now: f64, out: &mut Vec<Effect>) {
        let known = self.workers.iter().find(|(_, worker)| worker.register.nonce == register.nonce).map(|(&id, _)| id);
        let id = known.unwrap_or(WorkerId(self.next_worker));
        self.next_worker = self.next_worker.max(id.0 + 1);
        let worker =
            self.workers.entry(id).or_insert_with(|| Worker::new(register.clone(), WorkerHistory::default(), now));
        worker.register = register;
        worker.last_seen = now;
        worker.lost = false;
        worker.draining = false;
        out.push(Effect::WorkerChanged(id));
        out.push(Effect::Registered(id));
    }

    pub(super) fn restore_worker(&mut self, id: WorkerId, register: Register, history: WorkerHistory, now: f64) {
        self.next_worker = self.next_worker.max(id.0 + 1);
        let mut worker = Worker::new(register, history, now);
        worker.lost = true;
        self.workers.insert(id, worker);
    }

    pub(super) fn ask(
        &mut self,
        id: WorkerId,
        ask: u64,
        prepared: Vec<(AssetHash, u32)>,
        now: f64,
        out: &mut Vec<Effect>,
    ) {
        let Some(worker) = self.seen(id, now, out) else { return };
        worker.prepared = prepared.into_iter().collect();
        self.asks.push_back(Ask { ask, worker: id });
        self.stirred = true;
    }

    pub(super) fn heartbeat(
        &mut self,
        id: WorkerId,
        leases: Vec<LeaseId>,
        draining: bool,
        prepared: Vec<(AssetHash, u32)>,
        now: f64,
        out: &mut Vec<Effect>,
    ) {
        let Some(worker) = self.seen(id, now, out) else { return };
        worker.prepared = prepared.into_iter().collect();
        if draining && !worker.draining {
            worker.draining = true;
            out.push(Effect::WorkerChanged(id));
        }
        let drain = worker.draining;
        let mut cancelled = Vec::new();
        for lease in leases {
            match self.leases.get_mut(&lease) {
                Some(held) if held.worker == id => held.expires = now + LEASE_SECONDS,
                _ => cancelled.push(lease),
            }
        }
        out.push(Effect::Heartbeat { cancelled, drain });
    }

    /// Note that a worker was heard of.
    fn seen(&mut self, id: WorkerId, now: f64, out: &mut Vec<Effect>) -> Option<&mut Worker> {
        let Some(worker) = self.workers.get_mut(&id) else {
            out.push(Effect::UnknownWorker(id));
            return None;
        };
        worker.last_seen = now;
        if std::mem::take(&mut worker.lost) {
            self.stirred = true;
            out.push(Effect::WorkerChanged(id));
        }
        Some(worker)
    }

    pub(super) fn worker_command(&mut self, id: WorkerId, command: WorkerCommand, now: f64, out: &mut Vec<Effect>) {
        let Some(worker) = self.workers.get_mut(&id) else {
            out.push(Effect::UnknownWorker(id));
            return;
        };
        match command {
            WorkerCommand::Drain => worker.draining = true,
            WorkerCommand::Disable => worker.history.disabled = true,
            WorkerCommand::Enable => {
                worker.draining = false;
                worker.history.disabled = false;
                worker.disabled_until = f64::NEG_INFINITY;
                worker.strikes = 0;
            }
        }
        out.push(Effect::WorkerChanged(id));
        if command == WorkerCommand::Disable {
            self.release_all(id, Release::Returned, now, out);
        }
        self.stirred = true;
    }

    /// Give up on workers that are silent, and forgive those that failed a while ago.
    pub(super) fn watch_workers(&mut self, now: f64, out: &mut Vec<Effect>) {
        let silent: Vec<WorkerId> = self
            .workers
            .iter()
            .filter(|(_, worker)| !worker.lost && now - worker.last_seen > WORKER_LOST_SECONDS)
            .map(|(&id, _)| id)
            .collect();
        for id in silent {
            let Some(worker) = self.workers.get_mut(&id) else { continue };
            worker.lost = true;
            // One that said it was leaving has left: that is no fault of its units.
            let release = if worker.draining { Release::Returned } else { Release::Lost };
            self.counters.workers_lost += 1;
            self.asks.retain(|ask| ask.worker != id);
            out.push(Effect::WorkerChanged(id));
            self.release_all(id, release, now, out);
        }
        for (&id, worker) in &mut self.workers {
            if worker.disabled_until.is_finite() && now >= worker.disabled_until {
                worker.disabled_until = f64::NEG_INFINITY;
                worker.strikes = 0;
                out.push(Effect::WorkerChanged(id));
            }
        }
    }

    fn release_all(&mut self, id: WorkerId, release: Release, now: f64, out: &mut Vec<Effect>) {
        let leases: Vec<LeaseId> =
            self.workers.get(&id).map(|worker| worker.leases.iter().copied().collect()).unwrap_or_default();
        for lease in leases {
            self.release(lease, release.clone(), now, out);
        }
    }

    /// A worker failed: after some in a row it is left alone for a while.
    pub(super) fn strike(&mut self, id: WorkerId, units: u64, now: f64, out: &mut Vec<Effect>) {
        let Some(worker) = self.workers.get_mut(&id) else { return };
        worker.history.failures += units;
        worker.strikes += 1;
        if worker.strikes >= MAX_STRIKES {
            worker.disabled_until = now + DISABLED_SECONDS;
            out.push(Effect::WorkerChanged(id));
        }
    }

    /// The unit was at fault, not the workers that it failed on.
    pub(super) fn exonerate(&mut self, workers: &[WorkerId], out: &mut Vec<Effect>) {
        for id in workers {
            let Some(worker) = self.workers.get_mut(id) else { continue };
            worker.strikes = 0;
            if worker.disabled_until.is_finite() {
                worker.disabled_until = f64::NEG_INFINITY;
                out.push(Effect::WorkerChanged(*id));
            }
        }
    }
}
