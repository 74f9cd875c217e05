//! What went wrong: kept with the job, so that people see why a tile took several attempts.

use common::{job::JobId, protocol::FailureView};

use super::{Service, lock};
use crate::{error::Failure, farm::Attempt, store::Write, time::stamp};

/// Attempts that a job remembers.
const KEPT: usize = 100;

impl Service {
    /// Keep an attempt that came to nothing, and log it.
    pub(super) fn note_failure(&self, attempt: Attempt) {
        let Attempt { tile: key, pass, worker, cause, message } = attempt;
        tracing::warn!(job = %key.job, frame = key.frame, tile = key.tile, pass, %worker, cause, message, "an attempt at a unit came to nothing");
        let Some(entry) = self.entry(key.job) else { return };
        let mut record = lock(&entry.record);
        if record.failures.len() >= KEPT {
            record.failures.remove(0);
        }
        let (frame, tile) = (key.frame, key.tile);
        record.failures.push(FailureView { at: stamp(), frame, tile, pass, worker, cause: cause.into(), message });
        drop(self.store.write(Write::Job(Box::new(record.clone()))));
        lock(&self.dirty).jobs.entry(key.job).or_default();
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
