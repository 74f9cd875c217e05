//! Workers: they register, ask for leases, say that they are there, and hand back what they cannot do.

use std::{sync::Arc, time::Duration};

use common::{
    job::{LeaseId, WorkerId},
    protocol::{
        HEARTBEAT_SECONDS, Heartbeat, HeartbeatReply, LEASE_POLL_SECONDS, Lease, LeaseFailure, LeaseRequest, Register,
        Registered, WorkerView,
    },
};
use tokio::sync::oneshot;

use super::{Service, lock, refusal};
use crate::{
    error::Failure,
    farm::{Effect, Event, WorkerCommand},
    store::{WorkerRecord, Write},
    time::stamp,
};

impl Service {
    /// A worker process starts.
    ///
    /// # Errors
    /// What it says of itself is too long, or it could not be stored.
    pub async fn register(self: &Arc<Self>, register: Register) -> Result<Registered, Failure> {
        let texts = [&register.machine, &register.tracer, &register.nonce];
        let long = |text: &String| text.chars().count() > 256;
        if texts.into_iter().chain(&register.cpu_features).any(long)
            || register.cpu_features.len() > 64
            || register.nonce.is_empty()
        {
            return Err(Failure::Refused(
                "a worker's texts are at most 256 letters long, its nonce at least one, its features at most 64".into(),
            ));
        }
        let answers = self.apply(Event::Register(register));
        let worker = answers.into_iter().find_map(|answer| match answer {
            Effect::Registered(worker) => Some(worker),
            _ => None,
        });
        let worker = worker.ok_or_else(|| Failure::Internal("the farm did not register a worker".into()))?;
        self.save_worker(worker);
        self.settle().await?;
        tracing::info!(%worker, "a worker registered");
        Ok(Registered { worker, heartbeat_seconds: HEARTBEAT_SECONDS })
    }

    /// A worker wants work. `None` when there was none for as long as it wanted to wait.
    ///
    /// # Errors
    /// There is no such worker.
    pub async fn lease(self: &Arc<Self>, worker: WorkerId, request: LeaseRequest) -> Result<Option<Lease>, Failure> {
        let wait = if request.wait_seconds.is_finite() { request.wait_seconds } else { 0.0 };
        let wait = Duration::from_secs_f64(wait.clamp(0.0, LEASE_POLL_SECONDS));
        let (sender, mut answer) = oneshot::channel();
        let ask = Asking { service: Arc::clone(self), ask: self.next_ask() };
        lock(&self.asks).insert(ask.ask, sender);
        refusal(&self.apply(Event::Ask { worker, ask: ask.ask, prepared: request.prepared }))?;
        let lease = tokio::select! {
            biased;
            lease = &mut answer => lease.ok(),
            () = tokio::time::sleep(wait) => None,
            () = self.leaving.cancelled() => None,
        };
        // From here on no lease can be sent; one that was sent in this very moment is taken.
        drop(ask);
        Ok(lease.or_else(|| answer.try_recv().ok()))
    }

    /// A worker is there.
    ///
    /// # Errors
    /// There is no such worker: it must register.
    pub fn heartbeat(self: &Arc<Self>, worker: WorkerId, heartbeat: Heartbeat) -> Result<HeartbeatReply, Failure> {
        let Heartbeat { leases, draining, prepared } = heartbeat;
        let answers = self.apply(Event::Heartbeat { worker, leases, draining, prepared });
        refusal(&answers)?;
        lock(&self.dirty).workers.insert(worker);
        let reply = answers.into_iter().find_map(|answer| match answer {
            Effect::Heartbeat { cancelled, drain } => Some(HeartbeatReply { cancelled, drain }),
            _ => None,
        });
        Ok(reply.unwrap_or_default())
    }

    /// Units come back unrendered.
    pub fn lease_failed(self: &Arc<Self>, lease: LeaseId, failure: LeaseFailure) {
        let LeaseFailure { worker, units, cause, message } = failure;
        let message: String = message.chars().take(1000).collect();
        tracing::warn!(%lease, %worker, units = units.len(), ?cause, message, "units came back unrendered");
        self.apply(Event::Failed { lease, worker, units, cause, message });
    }

    /// Carry out a person's wish for a worker.
    ///
    /// # Errors
    /// There is no such worker.
    pub async fn worker_command(self: &Arc<Self>, id: WorkerId, command: WorkerCommand) -> Result<WorkerView, Failure> {
        refusal(&self.apply(Event::WorkerCommand(id, command)))?;
        self.save_worker(id);
        self.settle().await?;
        let view = self.farm().worker(id, self.now());
        view.ok_or_else(|| Failure::NotFound(format!("worker {id}")))
    }

    /// All workers, oldest first.
    #[must_use]
    pub fn worker_views(&self) -> Vec<WorkerView> {
        self.farm().workers(self.now())
    }

    /// Queue what is known of the workers that are there for the disk.
    pub(super) fn save_workers(&self) {
        for worker in self.worker_views().into_iter().filter(|worker| worker.state != "lost") {
            self.save_worker(worker.id);
        }
    }

    /// Queue what is known of a worker for the disk.
    pub(super) fn save_worker(&self, id: WorkerId) {
        let Some((register, history)) = self.farm().worker_history(id) else { return };
        let record = WorkerRecord {
            register,
            units: history.units,
            failures: history.failures,
            disabled: history.disabled,
            seen_at: stamp(),
        };
        drop(self.store.write(Write::Worker(id, Box::new(record))));
    }
}

/// A request that waits; when it goes away, the farm is told.
struct Asking {
    service: Arc<Service>,
    ask: u64,
}

impl Drop for Asking {
    fn drop(&mut self) {
        if lock(&self.service.asks).remove(&self.ask).is_some() {
            self.service.apply(Event::AskGone(self.ask));
        }
    }
}
