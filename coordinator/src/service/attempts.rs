//! What became of each attempt at a unit: kept with the job, so that people see who had a tile, for how long, and why it
//! took several attempts.

use std::sync::{Arc, atomic::Ordering};

use common::{
    job::{JobId, LeaseId},
    protocol::{AttemptList, AttemptView, FailureView, Outcome, UnitId},
};

use super::{Service, lock};
use crate::{
    error::Failure,
    farm::{Accepted, Attempt},
    store::{AttemptQuery, Write},
    time::stamp,
};

/// Attempts that came to nothing and that a job's record holds.
const KEPT: usize = 100;

impl Service {
    /// Keep a result that counts.
    pub(super) fn note_done(&self, lease: LeaseId, accepted: &Accepted, cpu_seconds: f64, samples: u64) {
        self.log_attempt(AttemptView {
            at: stamp(),
            unit: accepted.unit,
            lease,
            worker: accepted.worker,
            outcome: Outcome::Done,
            seconds: accepted.seconds,
            cpu_seconds,
            samples,
            message: None,
        });
    }

    /// Keep that a result came after another's.
    pub(super) fn note_late(&self, lease: LeaseId, unit: UnitId) {
        let worker = self.farm().holder(lease);
        self.log_attempt(AttemptView {
            at: stamp(),
            unit,
            lease,
            worker,
            outcome: Outcome::Late,
            seconds: None,
            cpu_seconds: 0.0,
            samples: 0,
            message: None,
        });
    }

    /// Keep an attempt that came to nothing.
    pub(super) fn note_failure(&self, attempt: Attempt) {
        let Attempt { unit, lease, worker, outcome, seconds, message } = attempt;
        let UnitId { job, frame, tile, pass, .. } = unit;
        let at = stamp();
        self.log_attempt(AttemptView {
            at: at.clone(),
            unit,
            lease,
            worker: Some(worker),
            outcome,
            seconds: Some(seconds),
            cpu_seconds: 0.0,
            samples: 0,
            message: Some(message.clone()),
        });
        // What counts against the unit stands with the job, however many attempts follow.
        if outcome == Outcome::Returned {
            return;
        }
        let Some(entry) = self.entry(job) else { return };
        let mut record = lock(&entry.record);
        if record.failures.len() >= KEPT {
            record.failures.remove(0);
        }
        record.failures.push(FailureView { at, frame, tile, pass, worker, cause: outcome.name().into(), message });
        drop(self.store.write(Write::Job(Box::new(record.clone()))));
        lock(&self.dirty).jobs.entry(job).or_default();
    }

    /// Log an attempt, and keep it. A worker's request is in the span where it brought this about.
    fn log_attempt(&self, attempt: AttemptView) {
        let AttemptView { unit, lease, worker, outcome, seconds, cpu_seconds, samples, ref message, .. } = attempt;
        let (worker, outcome) = (worker.map(tracing::field::display), outcome.name());
        if let (Some(message), "failed" | "hung" | "lost") = (message, outcome) {
            tracing::warn!(%unit, %lease, worker, outcome, seconds, message, "an attempt at a unit came to nothing");
        } else {
            tracing::debug!(%unit, %lease, worker, outcome, seconds, cpu_seconds, samples, message, "an attempt at a unit ended");
        }
        let number = self.next_attempt.fetch_add(1, Ordering::Relaxed);
        drop(self.store.write(Write::Attempt(number, Box::new(attempt))));
    }

    /// Attempts at units of a job, newest first, and where the next page begins.
    ///
    /// # Errors
    /// There is no such job.
    pub async fn attempts(self: &Arc<Self>, query: AttemptQuery) -> Result<AttemptList, Failure> {
        self.entry(query.job).ok_or_else(|| Failure::NotFound(format!("job {}", query.job)))?;
        // What was noted is in the queue of the store, if it is not on disk.
        self.settle().await?;
        let mut found = self.store.attempts(AttemptQuery { limit: query.limit + 1, ..query }).await?;
        let more = found.len() > query.limit;
        found.truncate(query.limit);
        let next = found.last().filter(|_| more).map(|(number, _)| number.to_string());
        Ok(AttemptList { attempts: found.into_iter().map(|(_, attempt)| attempt).collect(), next })
    }

    /// The last attempts at units of a job that came to nothing, oldest first.
    ///
    /// # Errors
    /// There is no such job.
    pub fn failures(&self, id: JobId) -> Result<Vec<FailureView>, Failure> {
        let entry = self.entry(id).ok_or_else(|| Failure::NotFound(format!("job {id}")))?;
        Ok(lock(&entry.record).failures.clone())
    }
}
