//! Jobs in their lives: restored, changed, continued, deleted.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

use common::{
    job::{FieldError, Frames, JobId, JobState, Quality},
    protocol::{JobPatch, JobView},
};
use serde::Serialize;

use super::{JobEntry, Service, lock, measure::Measure, refusal};
use crate::{
    error::Failure,
    farm::{Command, Event, Farm, JobSpec, Restored, TileKey, TileProgress},
    plan::Rule,
    store::{JobRecord, Write},
    time::{stamp, unix},
};

/// A tile that was merged or finished.
#[derive(Serialize)]
struct TileNotice {
    job: JobId,
    frame: u32,
    tile: u32,
    done: bool,
}

impl Service {
    pub(super) fn add_entry(&self, record: JobRecord, measure: Measure) {
        let entry = JobEntry { record: Mutex::new(record), measure: Mutex::new(measure) };
        let id = lock(&entry.record).id;
        self.jobs.write().unwrap_or_else(PoisonError::into_inner).insert(id, Arc::new(entry));
    }

    /// Take up a stored job.
    pub(super) async fn restore(self: &Arc<Self>, record: JobRecord) -> anyhow::Result<()> {
        let tiles = self.store.tiles(record.id).await?;
        let mut measure = Measure::default();
        for tile in &tiles {
            measure.replace(tile.key.frame, None, &tile.record);
        }
        let id = record.id;
        self.add_entry(record, measure);
        self.restore_to_farm(id).await.map_err(|failure| anyhow::anyhow!("job {id}: {failure}"))
    }

    /// Give a job to the farm as it is stored.
    async fn restore_to_farm(self: &Arc<Self>, id: JobId) -> Result<(), Failure> {
        let Some(entry) = self.entry(id) else { return Ok(()) };
        let record = lock(&entry.record).clone();
        let mut tiles: BTreeMap<(u32, u32), TileProgress> = BTreeMap::new();
        if record.state != JobState::Completed {
            for tile in self.store.tiles(id).await? {
                let progress = TileProgress {
                    passes: tile.record.passes,
                    share: record.rule.share(tile.record.passes).unwrap_or(tile.record.share),
                    finished: tile.record.finished,
                    attempts: tile.record.attempts,
                    worker: tile.record.worker,
                    parts: None,
                };
                tiles.insert((tile.key.frame, tile.key.tile), progress);
            }
            for part in self.store.parts(id).await? {
                let progress = tiles.entry((part.key.frame, part.key.tile)).or_default();
                if part.pass == progress.passes {
                    let (split, rects) = progress.parts.get_or_insert_with(|| (part.split, Vec::new()));
                    if *split == part.split {
                        rects.push(part.rect);
                    }
                }
            }
        }
        let done = record.done.as_ref().map(|done| done.numbers().to_vec()).unwrap_or_default();
        let restored = Restored { spec: spec_of(&record), state: record.state, message: record.message, done, tiles };
        self.apply(Event::Restore(Box::new(restored)));
        Ok(())
    }

    /// Carry out a person's wish for a job. When this returns, it is on disk.
    ///
    /// # Errors
    /// There is no such job, or it is in a state that does not allow it.
    pub async fn command(self: &Arc<Self>, id: JobId, command: Command) -> Result<JobView, Failure> {
        refusal(&self.apply(Event::Command(id, command)))?;
        self.settle().await?;
        self.job_view(id)
    }

    /// Change a job. When this returns, it is on disk.
    ///
    /// # Errors
    /// There is no such job, or a field that is wrong.
    pub async fn patch(self: &Arc<Self>, id: JobId, patch: JobPatch) -> Result<JobView, Failure> {
        let entry = self.entry(id).ok_or_else(|| Failure::NotFound(format!("job {id}")))?;
        let rule = match &patch.quality {
            None => None,
            Some(quality) => {
                quality.validate()?;
                let record = lock(&entry.record);
                let rule = Rule::of(quality, &record.method)?;
                record.rule.continued(&rule)?;
                Some(rule)
            }
        };
        if patch.priority.is_some_and(|priority| priority > 100) {
            return Err(FieldError::new("priority", "is not within 0 to 100").into());
        }
        if let Some(name) = patch.name {
            lock(&entry.record).name = name;
        }
        if let Some(priority) = patch.priority {
            refusal(&self.apply(Event::Command(id, Command::Priority(priority))))?;
        }
        if let (Some(rule), Some(quality)) = (rule, patch.quality) {
            self.continue_to(&entry, id, rule, quality).await?;
        }
        drop(self.store.write(Write::Job(Box::new(lock(&entry.record).clone()))));
        self.settle().await?;
        self.job_view(id)
    }

    /// Let a job go on to a finer target, from the samples it has.
    async fn continue_to(
        self: &Arc<Self>,
        entry: &JobEntry,
        id: JobId,
        rule: Rule,
        quality: Quality,
    ) -> Result<(), Failure> {
        let (old, state) = {
            let record = lock(&entry.record);
            (record.rule.clone(), record.state)
        };
        if old == rule {
            lock(&entry.record).quality = quality;
            return Ok(());
        }
        let raised = matches!((&old, &rule), (Rule::Uniform { .. }, Rule::Uniform { .. }));
        if !raised {
            if state != JobState::Completed {
                return Err(Failure::Conflict(format!(
                    "the job is {state}; a target can be made finer when the job is completed"
                )));
            }
            self.judge_anew(entry, id).await?;
        }
        {
            let mut record = lock(&entry.record);
            record.rule = rule;
            record.quality = quality;
            record.done = None;
            record.rounds.clear();
            record.ended = None;
            if record.state == JobState::Completed {
                record.state = JobState::Queued;
                record.finished_at = None;
            }
            if raised {
                drop(self.store.write(Write::Reopen(id)));
            }
            drop(self.store.write(Write::Job(Box::new(record.clone()))));
        }
        self.settle().await?;
        self.restore_to_farm(id).await
    }

    /// Delete a job that is over, and its pictures. When this returns, that is on disk.
    ///
    /// # Errors
    /// There is no such job, or it is not over.
    pub async fn delete(self: &Arc<Self>, id: JobId) -> Result<(), Failure> {
        refusal(&self.apply(Event::Command(id, Command::Remove)))?;
        self.jobs.write().unwrap_or_else(PoisonError::into_inner).remove(&id);
        self.films.forget(|key| key.job == id);
        self.store.write(Write::DeleteJob(id)).await?;
        self.notify("removed", Some(id), &id);
        Ok(())
    }

    /// Note what the farm says of a job: queued for the disk, in order.
    pub(super) fn job_changed(&self, id: JobId, farm: &Farm, frame_done: bool) {
        let (Some(entry), Some((state, message, priority))) = (self.entry(id), farm.brief(id)) else { return };
        let mut record = lock(&entry.record);
        if frame_done {
            record.done = Frames::of(farm.frames_done(id));
            let done = record.done.clone();
            record.rounds.retain(|frame, _| done.as_ref().is_none_or(|done| !done.numbers().contains(frame)));
        }
        let before = record.clone();
        if state.is_final() && record.finished_at.is_none() {
            record.finished_at = Some(stamp());
            record.ended = Some(unix());
        } else if !state.is_final() {
            (record.finished_at, record.ended) = (None, None);
        }
        if state == JobState::Active && record.began.is_none() {
            record.began = Some(unix());
        }
        record.state = state;
        record.message = message;
        record.priority = priority;
        record.tracer = farm.tracer(id);
        if before.state != state {
            tracing::info!(job = %id, from = %before.state, to = %state, message = record.message, "a job changed its state");
        }
        if before != *record || frame_done {
            drop(self.store.write(Write::Job(Box::new(record.clone()))));
        }
        lock(&self.dirty).jobs.insert(id, true);
    }

    pub(super) fn tell_tile(&self, key: TileKey, done: bool) {
        if self.notices.receiver_count() > 0 {
            let TileKey { job, frame, tile } = key;
            self.notify("tile", Some(job), &TileNotice { job, frame, tile, done });
        }
    }
}

pub(super) fn spec_of(record: &JobRecord) -> JobSpec {
    JobSpec {
        id: record.id,
        scene: record.scene,
        frames: record.frames.numbers().to_vec(),
        grid: record.grid(),
        batch: record.rule.batch(),
        gated: record.rule.looks_around(),
        priority: record.priority,
        tracer: record.tracer.clone(),
        prepare: record.prepare.clone(),
    }
}
