//! Jobs as people see them: how far they are, what they cost, and what is foreseen.

use std::collections::BTreeMap;

use common::{
    job::{JobId, JobState, Quality},
    protocol::{Forecast, FrameView, JobView, TileView},
};

use super::{Service, lock, measure, measure::Measure};
use crate::{
    error::Failure,
    store::{JobRecord, Write},
    time::unix,
};

/// Shares of the work at which a forecast is kept: as soon as there is one, and further on.
const FORECASTS: [f64; 3] = [0.0, 0.25, 0.5];

impl Service {
    /// A job as people see it.
    ///
    /// # Errors
    /// There is no such job.
    pub fn job_view(&self, id: JobId) -> Result<JobView, Failure> {
        let gone = || Failure::NotFound(format!("job {id}"));
        let entry = self.entry(id).ok_or_else(gone)?;
        let status = self.farm().job(id, self.now()).ok_or_else(gone)?;
        let record = lock(&entry.record).clone();
        let measure = lock(&entry.measure);
        let region = record.region.area() as f64;
        let target = measure::target(&record.quality);
        let running = status.state == JobState::Active;
        let foreseen = if running { foreseen(&record, &measure) } else { None };
        let spent = measure.work.cpu_seconds;
        let left = foreseen.zip(status.cpu_rate).map(|(all, rate)| (all.cpu_seconds - spent) / rate);
        let progress = match record.quality {
            // What is spent, not what is rendered, brings it to its end.
            Quality::Time { cpu_seconds, .. } if !status.state.is_final() => (spent / cpu_seconds).min(1.0),
            _ => status.progress,
        };
        let wall_seconds = record.began.map(|began| record.ended.unwrap_or_else(unix) - began);
        let frames = status
            .frames
            .iter()
            .map(|frame| {
                let measured = measure.frames.get(&frame.frame);
                FrameView {
                    frame: frame.frame,
                    progress: frame.progress,
                    done: frame.done,
                    mean_samples: measured.map_or(0.0, |m| m.samples as f64 / region),
                    max_samples: measured.map_or(0, |m| m.max_samples),
                    pixels_missed: measured.filter(|_| target.is_some()).map(|m| m.pixels - m.within),
                    within_target: measured
                        .filter(|m| target.is_some() && m.pixels > 0)
                        .map(|m| m.within as f64 / m.pixels as f64),
                }
            })
            .collect();
        Ok(JobView {
            id,
            name: record.name,
            state: status.state,
            message: status.message,
            progress,
            samples: measure.work.samples,
            samples_per_second: status.samples_per_second,
            error: measure.error(target),
            eta_seconds: left.or(status.eta_seconds),
            frames,
            scene: record.scene,
            resolution: record.resolution,
            region: record.region,
            tile: record.tile,
            quality: record.quality,
            method: record.method,
            plan: record.plan,
            priority: status.priority,
            tags: record.tags,
            seed: record.seed,
            tracer: status.tracer,
            created_at: record.created_at,
            finished_at: record.finished_at,
            wall_seconds,
            forecasts: record.forecasts,
            statistics: measure.statistics(status.retries),
            workers_now: status.workers,
            request: record.request,
        })
    }

    /// Forecast a job that goes on, and keep that at the marks of [`FORECASTS`].
    pub(super) fn note_forecast(&self, id: JobId) {
        let Some(entry) = self.entry(id) else { return };
        if lock(&entry.record).forecasts.len() == FORECASTS.len() {
            return;
        }
        let Some(status) = self.farm().job(id, self.now()) else { return };
        let mut record = lock(&entry.record);
        let next = FORECASTS.get(record.forecasts.len());
        let (Some(&mark), Some(rate), Some(began)) = (next, status.cpu_rate, record.began) else { return };
        if status.state != JobState::Active {
            return;
        }
        let measure = lock(&entry.measure);
        let Some(all) = foreseen(&record, &measure) else { return };
        let progress = measure.work.cpu_seconds / all.cpu_seconds;
        if progress < mark || progress >= 1.0 {
            return;
        }
        let made_at_seconds = unix() - began;
        let wall_seconds = made_at_seconds + (all.cpu_seconds - measure.work.cpu_seconds) / rate;
        let forecast =
            Forecast { progress, made_at_seconds, samples: all.samples, cpu_seconds: all.cpu_seconds, wall_seconds };
        record.forecasts.push(forecast);
        drop(self.store.write(Write::Job(Box::new(record.clone()))));
    }

    /// Jobs, newest first: those in `state` (all if absent) older than `before`, at most `limit`; and where
    /// the next page begins.
    #[must_use]
    pub fn list_jobs(
        &self,
        state: Option<JobState>,
        before: Option<JobId>,
        limit: usize,
    ) -> (Vec<JobView>, Option<JobId>) {
        let mut chosen: Vec<JobId> = {
            let farm = self.farm();
            let wanted = |id: &JobId| {
                before.is_none_or(|before| *id < before) && state.is_none_or(|state| farm.job_state(*id) == Some(state))
            };
            farm.jobs().rev().filter(wanted).take(limit + 1).collect()
        };
        let more = chosen.len() > limit;
        chosen.truncate(limit);
        let next = chosen.last().copied().filter(|_| more);
        (chosen.into_iter().filter_map(|id| self.job_view(id).ok()).collect(), next)
    }

    /// The tiles of a frame.
    ///
    /// # Errors
    /// There is no such job or frame.
    pub async fn tile_views(&self, id: JobId, frame: u32) -> Result<Vec<TileView>, Failure> {
        let record = self.record_with_frame(id, frame)?;
        let done = record.done.as_ref().is_some_and(|done| done.numbers().binary_search(&frame).is_ok());
        let live = self.farm().tiles(id, frame);
        let stored: BTreeMap<u32, _> = self
            .store
            .tiles(id)
            .await?
            .into_iter()
            .filter(|tile| tile.key.frame == frame)
            .map(|tile| (tile.key.tile, tile.record))
            .collect();
        let grid = record.grid();
        let failures = record.failures.iter().filter(|failure| failure.frame == frame);
        let failed: BTreeMap<u32, String> = failures.map(|failure| (failure.tile, failure.message.clone())).collect();
        let view = |tile| {
            let known = stored.get(&tile);
            let now = live.as_ref().and_then(|tiles| tiles.get(tile as usize));
            Some(TileView {
                tile,
                rect: grid.rect(tile)?,
                state: now.map_or(if done { "done" } else { "waiting" }, |now| now.state).into(),
                passes: known.map_or(0, |known| known.passes),
                attempts: now.map(|now| now.attempts).or(known.map(|known| known.attempts)).unwrap_or(0),
                worker: now.and_then(|now| now.worker).or(known.and_then(|known| known.worker)),
                milliseconds: known.map_or(0.0, |known| known.work.cpu_seconds * 1e3),
                samples: known.map_or(0, |known| known.work.samples),
                message: failed.get(&tile).cloned(),
            })
        };
        Ok((0..grid.count()).filter_map(view).collect())
    }

    /// A job's record, if it has that frame.
    pub(super) fn record_with_frame(&self, id: JobId, frame: u32) -> Result<JobRecord, Failure> {
        let entry = self.entry(id).ok_or_else(|| Failure::NotFound(format!("job {id}")))?;
        let record = lock(&entry.record);
        if record.frames.numbers().binary_search(&frame).is_err() {
            return Err(Failure::NotFound(format!("frame {frame} of job {id}")));
        }
        Ok(record.clone())
    }
}

/// What a job is to have cost in the end.
pub(super) fn foreseen(record: &JobRecord, measure: &Measure) -> Option<measure::Cost> {
    let tiles = record.grid().count() as usize;
    measure.forecast(&record.rule, record.frames.numbers().len(), tiles, record.region.area() as f64)
}
