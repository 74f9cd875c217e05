//! Jobs: submitted, changed, looked at, deleted.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError, atomic::Ordering},
};

use common::{
    hash::AssetHash,
    job::{FieldError, Frames, JobId, JobRequest, JobState, Quality, SceneRef, check_resolution},
    method::Direct,
    plan::{LEAST_PIXELS, Trial},
    protocol::{Forecast, FrameView, JobPatch, JobView, TileView},
    scene::{SceneError, SceneFile},
    tile::TileGrid,
};
use serde::Serialize;

use super::{JobEntry, Service, lock, measure, measure::Measure, refusal};
use crate::{
    error::Failure,
    farm::{Command, Event, Farm, JobSpec, Restored, TileKey, TileProgress},
    plan::Rule,
    store::{JobRecord, Once, Write},
    time::{stamp, unix},
};

/// Shares of the work at which a forecast is kept: as soon as there is one, and further on.
const FORECASTS: [f64; 3] = [0.0, 0.25, 0.5];
/// Most tiles of a frame.
const MAX_TILES: u64 = 1 << 18;
/// Most bytes of a scene file.
pub(crate) const MAX_SCENE: u64 = 256 << 20;

/// A tile that was merged or finished.
#[derive(Serialize)]
struct TileNotice {
    job: JobId,
    frame: u32,
    tile: u32,
    done: bool,
}

/// Where a job comes from.
#[derive(Debug, Default)]
pub(super) struct Origin {
    /// Id of the request.
    pub(super) request: Option<String>,
    /// How it is known when it comes again.
    pub(super) once: Option<Once>,
}

impl Service {
    /// Take in a job, unless the client has submitted it before under the same key. When this returns, it is on
    /// disk. Whether it is new.
    ///
    /// # Errors
    /// A field that is wrong, files that are missing, or a key that was used for another job.
    pub async fn submit_once(
        self: &Arc<Self>,
        request: JobRequest,
        key: Option<String>,
        request_id: Option<String>,
    ) -> Result<(JobView, bool), Failure> {
        let origin = Origin { request: request_id, once: None };
        let Some(key) = key else { return Ok((self.submit(request, origin).await?, true)) };
        // One at a time: of two that come together, the second must find the first.
        let _turn = self.submitting.lock().await;
        let text = serde_json::to_vec(&request).map_err(|error| Failure::Internal(error.to_string()))?;
        let once = Once { key, request: AssetHash::of(&text) };
        let known = {
            let jobs = self.jobs.read().unwrap_or_else(PoisonError::into_inner);
            let same = |(id, entry): (&JobId, &Arc<JobEntry>)| {
                let record = lock(&entry.record);
                let known = record.once.as_ref().filter(|known| known.key == once.key)?;
                Some((*id, known.request == once.request))
            };
            jobs.iter().rev().find_map(same)
        };
        match known {
            Some((id, true)) => Ok((self.job_view(id)?, false)),
            Some((id, false)) => {
                let message = format!("this key has been used for another request, which made job {id}");
                Err(FieldError::new("Idempotency-Key", message).into())
            }
            None => Ok((self.submit(request, Origin { once: Some(once), ..origin }).await?, true)),
        }
    }

    /// Take in a job. When this returns, it is on disk.
    ///
    /// # Errors
    /// A field that is wrong, or files that are missing.
    pub(super) async fn submit(self: &Arc<Self>, request: JobRequest, origin: Origin) -> Result<JobView, Failure> {
        request.validate()?;
        let (scene, hash) = self.scene_of(&request).await?;
        self.check_assets(&scene).await?;
        let resolution = request.resolution.unwrap_or([scene.film.width, scene.film.height]);
        check_resolution("resolution", resolution[0], resolution[1])?;
        let region = request.region(resolution)?;
        let grid = TileGrid::new(region, request.tile);
        let tiles = u64::from(grid.columns()) * u64::from(grid.rows());
        if tiles > MAX_TILES {
            let message = format!("{} pixels make {tiles} tiles, more than {MAX_TILES}", request.tile);
            return Err(FieldError::new("tile", message).into());
        }
        let quality = request.quality.or(scene.settings.quality).unwrap_or_default();
        let named = request.method.or(&scene.settings.method);
        let method = named.clone().resolve();
        // A method that is named needs no trial, and a frame that is small is not worth one.
        let open = method.direct == Direct::Auto && region.area() >= LEAST_PIXELS;
        let prepare = open.then_some(Trial { region, named });
        let rule = Rule::of(&quality, &method)?;
        let name = request.name.filter(|name| !name.is_empty()).unwrap_or(scene.name);
        let record = JobRecord {
            id: JobId(self.next_job.fetch_add(1, Ordering::Relaxed)),
            name: if name.is_empty() { "untitled".into() } else { name },
            scene: hash,
            frames: request.frames.or(scene.settings.frames).unwrap_or_default(),
            resolution,
            region,
            tile: request.tile,
            quality,
            method,
            prepare,
            plan: None,
            rule,
            priority: request.priority,
            tags: request.tags,
            seed: request.seed,
            state: JobState::Queued,
            message: None,
            tracer: None,
            created_at: stamp(),
            finished_at: None,
            done: None,
            rounds: BTreeMap::new(),
            began: None,
            ended: None,
            forecasts: Vec::new(),
            curve: Vec::new(),
            failures: Vec::new(),
            request: origin.request,
            once: origin.once,
        };
        let id = record.id;
        tracing::info!(job = %id, name = record.name, "a job was submitted");
        let stored = self.store.write(Write::Job(Box::new(record.clone())));
        let spec = spec_of(&record);
        self.add_entry(record, Measure::default());
        stored.await?;
        self.apply(Event::Submit(spec));
        self.settle().await?;
        self.job_view(id)
    }

    /// The scene a request names, and the hash it is stored under.
    async fn scene_of(&self, request: &JobRequest) -> Result<(SceneFile, AssetHash), Failure> {
        match &request.scene {
            SceneRef::Asset { asset } => {
                let Some(bytes) = self.blobs.read(*asset, MAX_SCENE).await? else {
                    return Err(Failure::MissingAssets(vec![*asset]));
                };
                let parsed = crate::bridge::blocking("reading a scene", move || SceneFile::parse(&bytes)).await?;
                let scene = parsed.map_err(|error| match error {
                    SceneError::Field(e) => FieldError::new(inside_scene(&e.field), e.message),
                    SceneError::Syntax(message) => FieldError::new("scene", format!("not valid JSON: {message}")),
                })?;
                Ok((scene, *asset))
            }
            SceneRef::Inline(scene) => {
                scene.check().map_err(|error| match error {
                    SceneError::Field(e) => FieldError::new(inside_scene(&e.field), e.message),
                    SceneError::Syntax(message) => FieldError::new("scene", message),
                })?;
                let bytes = serde_json::to_vec(scene).map_err(|error| Failure::Internal(error.to_string()))?;
                let hash = AssetHash::of(&bytes);
                let once = futures::stream::iter([Ok::<_, String>(bytes.into())]);
                self.blobs.put(hash, once, MAX_SCENE).await?;
                Ok(((**scene).clone(), hash))
            }
        }
    }

    /// Every file that the scene names must have a hash, and every hash must be stored.
    async fn check_assets(&self, scene: &SceneFile) -> Result<(), Failure> {
        for (field, file) in scene.files() {
            if !scene.assets.contains_key(&file) {
                let message = format!("scene.assets has no hash for \"{file}\"");
                return Err(FieldError::new(inside_scene(&field), message).into());
            }
        }
        let mut missing = Vec::new();
        for hash in scene.assets.values() {
            if !missing.contains(hash) && self.blobs.size(*hash).await?.is_none() {
                missing.push(*hash);
            }
        }
        if missing.is_empty() { Ok(()) } else { Err(Failure::MissingAssets(missing)) }
    }

    fn add_entry(&self, record: JobRecord, measure: Measure) {
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

    pub(super) fn tell_tile(&self, key: TileKey, done: bool) {
        if self.notices.receiver_count() > 0 {
            let TileKey { job, frame, tile } = key;
            self.notify("tile", Some(job), &TileNotice { job, frame, tile, done });
        }
    }
}

/// What a job is to have cost in the end.
pub(super) fn foreseen(record: &JobRecord, measure: &Measure) -> Option<measure::Cost> {
    let tiles = record.grid().count() as usize;
    measure.forecast(&record.rule, record.frames.numbers().len(), tiles, record.region.area() as f64)
}

fn spec_of(record: &JobRecord) -> JobSpec {
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

/// Where a field of the scene is in the request.
fn inside_scene(field: &str) -> String {
    if field.starts_with('(') { "scene".into() } else { format!("scene.{field}") }
}
