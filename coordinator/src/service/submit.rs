//! A job that is submitted: its scene found, its fields checked, its record made.

use std::{
    collections::BTreeMap,
    sync::{Arc, PoisonError, atomic::Ordering},
};

use common::{
    hash::AssetHash,
    job::{FieldError, JobId, JobRequest, JobState, SceneRef, check_resolution},
    method::Direct,
    plan::{LEAST_PIXELS, Trial},
    protocol::JobView,
    scene::{SceneError, Source},
    tile::TileGrid,
};

use super::{JobEntry, Service, jobs::spec_of, lock, measure::Measure};
use crate::{
    error::Failure,
    farm::Event,
    plan::Rule,
    store::{JobRecord, Once, Write},
    time::stamp,
};

/// Most tiles of a frame.
const MAX_TILES: u64 = 1 << 18;
/// Most bytes of a scene file.
pub(crate) const MAX_SCENE: u64 = 256 << 20;

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
        let settings = scene.settings();
        let resolution = request.resolution.unwrap_or(scene.resolution());
        check_resolution("resolution", resolution[0], resolution[1])?;
        let region = request.region(resolution)?;
        let grid = TileGrid::new(region, request.tile);
        let tiles = u64::from(grid.columns()) * u64::from(grid.rows());
        if tiles > MAX_TILES {
            let message = format!("{} pixels make {tiles} tiles, more than {MAX_TILES}", request.tile);
            return Err(FieldError::new("tile", message).into());
        }
        let quality = request.quality.or(settings.quality).unwrap_or_default();
        let named = request.method.or(&settings.method);
        let method = named.clone().resolve();
        // A method that is named needs no trial, and a frame that is small is not worth one.
        let open = method.direct == Direct::Auto && region.area() >= LEAST_PIXELS;
        let prepare = open.then(|| Trial { region, named, quality: Some(quality.clone()) });
        let rule = Rule::of(&quality, &method)?;
        let name = request.name.filter(|name| !name.is_empty()).unwrap_or(scene.name().into());
        let record = JobRecord {
            id: JobId(self.next_job.fetch_add(1, Ordering::Relaxed)),
            name: if name.is_empty() { "untitled".into() } else { name },
            scene: hash,
            frames: request.frames.or(settings.frames).unwrap_or_default(),
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
    async fn scene_of(&self, request: &JobRequest) -> Result<(Source, AssetHash), Failure> {
        match &request.scene {
            SceneRef::Asset { asset } => {
                let Some(bytes) = self.blobs.read(*asset, MAX_SCENE).await? else {
                    return Err(Failure::MissingAssets(vec![*asset]));
                };
                let parsed = crate::bridge::blocking("reading a scene", move || Source::parse(&bytes)).await?;
                let scene = parsed.map_err(|error| match error {
                    SceneError::Field(e) => FieldError::new(inside_scene(&e.field), e.message),
                    SceneError::Syntax(message) => FieldError::new("scene", format!("not valid JSON: {message}")),
                })?;
                Ok((scene, *asset))
            }
            SceneRef::Import(import) => {
                import.check().map_err(|e| FieldError::new(inside_scene(&e.field), e.message))?;
                Ok((Source::Import(import.clone()), self.keep_scene(import).await?))
            }
            SceneRef::Inline(scene) => {
                scene.check().map_err(|error| match error {
                    SceneError::Field(e) => FieldError::new(inside_scene(&e.field), e.message),
                    SceneError::Syntax(message) => FieldError::new("scene", message),
                })?;
                Ok((Source::Native(scene.clone()), self.keep_scene(scene).await?))
            }
        }
    }

    /// Store what a request says of its scene, as an asset.
    async fn keep_scene(&self, scene: &impl serde::Serialize) -> Result<AssetHash, Failure> {
        self.keep(serde_json::to_vec(scene).map_err(|error| Failure::Internal(error.to_string()))?).await
    }

    /// Every file that the scene names must have a hash, and every hash must be stored.
    async fn check_assets(&self, scene: &Source) -> Result<(), Failure> {
        if let Source::Native(scene) = scene {
            for (field, file) in scene.files() {
                if !scene.assets.contains_key(&file) {
                    let message = format!("scene.assets has no hash for \"{file}\"");
                    return Err(FieldError::new(inside_scene(&field), message).into());
                }
            }
        }
        let mut missing = Vec::new();
        for hash in scene.assets().values() {
            if !missing.contains(hash) && self.blobs.size(*hash).await?.is_none() {
                missing.push(*hash);
            }
        }
        if missing.is_empty() { Ok(()) } else { Err(Failure::MissingAssets(missing)) }
    }
}

/// Where a field of the scene is in the request.
fn inside_scene(field: &str) -> String {
    if field.starts_with('(') { "scene".into() } else { format!("scene.{field}") }
}
