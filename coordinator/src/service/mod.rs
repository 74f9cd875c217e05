//! The farm, its store and its files, put together: events go in, effects are carried out.
//!
//! This is where time comes in and where async begins. It decides nothing: what happens next is the farm's
//! business, which samples come next is the plan's.

mod attempts;
mod convergence;
pub mod films;
mod frames;
mod history;
pub mod images;
mod jobs;
mod measure;
mod results;
mod shipped;
mod submit;
mod view;
mod workers;

use std::{
    collections::{BTreeMap, BTreeSet, HashMap, VecDeque},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError, RwLock,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use common::{
    job::{JobId, WorkerId},
    protocol::{Lease, RenderSettings},
};
use tokio::sync::{broadcast, oneshot};
use tokio_util::sync::CancellationToken;

use crate::{
    blobs::Blobs,
    config::Config,
    error::Failure,
    farm::{self, Effect, Event, Farm, Grant, Plan, TileKey},
    plan::Step,
    store::{JobRecord, SqliteStore, Store, StoreError, Write},
    time::Clock,
};

use films::FilmCache;
use history::History;
use images::Thumbnails;
use measure::Measure;
pub use results::Receipt;

/// Everything the routes need.
pub struct Service {
    /// Settings.
    pub config: Config,
    /// Files.
    pub blobs: Blobs,
    /// Ends long polls and streams.
    pub leaving: CancellationToken,
    store: Arc<dyn Store>,
    clock: Clock,
    farm: Mutex<Farm>,
    jobs: RwLock<BTreeMap<JobId, Arc<JobEntry>>>,
    asks: Mutex<HashMap<u64, oneshot::Sender<Lease>>>,
    films: FilmCache,
    notices: broadcast::Sender<Arc<Notice>>,
    dirty: Mutex<Dirty>,
    /// Held by a submission that may have been made before.
    submitting: tokio::sync::Mutex<()>,
    history: Mutex<History>,
    thumbnails: Thumbnails,
    next_request: AtomicU64,
    next_ask: AtomicU64,
    next_job: AtomicU64,
    next_attempt: AtomicU64,
    epoch: u64,
    tallies: Tallies,
    /// Locked while this coordinator lives: two of them must not share a folder.
    _folder: Option<std::fs::File>,
}

/// A job's record and what was measured of it.
#[derive(Debug)]
struct JobEntry {
    record: Mutex<JobRecord>,
    measure: Mutex<Measure>,
}

/// Something that listeners are told.
#[derive(Debug, Clone)]
pub struct Notice {
    /// `state`, `progress`, `tile`, `worker` or `removed`.
    pub name: &'static str,
    /// The job it is about.
    pub job: Option<JobId>,
    /// JSON.
    pub data: String,
}

/// What listeners have not been told yet.
#[derive(Debug, Default)]
struct Dirty {
    /// Jobs that went on; whether their state changed too.
    jobs: BTreeMap<JobId, bool>,
    workers: BTreeSet<WorkerId>,
}

/// Counts for the metrics.
#[derive(Debug, Default)]
pub(crate) struct Tallies {
    pub(crate) result_bytes: AtomicU64,
    pub(crate) refused_results: AtomicU64,
    pub(crate) samples: AtomicU64,
    pub(crate) cpu_microseconds: AtomicU64,
}

/// How often time passes for the farm, and listeners are told.
const TICK: Duration = Duration::from_millis(250);
/// Ticks between two times that the workers' counts and the farm's past are stored.
const SAVE_WORKERS: u32 = 240;
/// Notices that a slow listener may fall behind before it is told the whole state again.
const NOTICES: usize = 1024;

impl Service {
    /// Open the files in the data folder and take up what is in them.
    ///
    /// # Errors
    /// The folder cannot be used, or what is in it cannot be read.
    pub async fn open(config: Config) -> anyhow::Result<Arc<Self>> {
        std::fs::create_dir_all(&config.data)?;
        let folder = std::fs::File::create(config.data.join("lock"))?;
        folder.try_lock().map_err(|error| match error {
            std::fs::TryLockError::WouldBlock => {
                anyhow::anyhow!("the data folder {} is in use by another coordinator", config.data.display())
            }
            std::fs::TryLockError::Error(error) => error.into(),
        })?;
        let store = SqliteStore::open(&config.data.join(crate::STORE)).await?;
        let blobs = Blobs::folder(&config.data.join("assets"))?;
        Self::start(config, Arc::new(store), blobs, Some(folder)).await
    }

    /// Take up what is in a store.
    ///
    /// # Errors
    /// The store cannot be read.
    async fn start(
        config: Config,
        store: Arc<dyn Store>,
        blobs: Blobs,
        folder: Option<std::fs::File>,
    ) -> anyhow::Result<Arc<Self>> {
        let snapshot = store.begin().await?;
        let films = FilmCache::new(config.film_cache);
        let service = Arc::new(Service {
            config,
            blobs,
            leaving: CancellationToken::new(),
            store,
            clock: Clock::start(),
            farm: Mutex::new(Farm::new(snapshot.epoch)),
            jobs: RwLock::default(),
            asks: Mutex::default(),
            films,
            notices: broadcast::channel(NOTICES).0,
            dirty: Mutex::default(),
            submitting: tokio::sync::Mutex::default(),
            history: Mutex::new(History::from(snapshot.moments)),
            thumbnails: Thumbnails::default(),
            next_request: AtomicU64::new(1),
            next_ask: AtomicU64::new(1),
            next_job: AtomicU64::new(snapshot.next_job.max(1)),
            // Above those of the start before, without looking at them.
            next_attempt: AtomicU64::new((snapshot.epoch << 32) + 1),
            epoch: snapshot.epoch,
            tallies: Tallies::default(),
            _folder: folder,
        });
        for (id, record) in snapshot.workers {
            let history =
                farm::WorkerHistory { units: record.units, failures: record.failures, disabled: record.disabled };
            service.apply(Event::RestoreWorker(id, record.register, history));
        }
        for record in snapshot.jobs {
            service.restore(record).await?;
        }
        let ticking = Arc::downgrade(&service);
        let leaving = service.leaving.clone();
        tokio::spawn(async move {
            let mut ticks = tokio::time::interval(TICK);
            ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
            let mut since_saved = 0;
            loop {
                tokio::select! {
                    () = leaving.cancelled() => break,
                    _ = ticks.tick() => {}
                }
                let Some(service) = ticking.upgrade() else { break };
                service.apply(Event::Tick);
                service.tell();
                service.note_moment();
                since_saved += 1;
                if since_saved >= SAVE_WORKERS {
                    since_saved = 0;
                    service.save_workers();
                    service.save_moments();
                }
            }
        });
        Ok(service)
    }

    /// Stop: nothing new is begun, and what was taken in reaches the disk.
    pub async fn close(&self) {
        self.leaving.cancel();
        self.save_workers();
        self.save_moments();
        if let Err(error) = self.store.close().await {
            tracing::error!(%error, "the store could not be closed");
        }
    }

    /// The farm, for looking at it. Held for moments only, and never across an await.
    pub(crate) fn farm(&self) -> MutexGuard<'_, Farm> {
        lock(&self.farm)
    }

    /// Seconds since the start.
    #[must_use]
    pub fn now(&self) -> f64 {
        self.clock.now()
    }

    /// How often the store was begun.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    pub(crate) fn tallies(&self) -> &Tallies {
        &self.tallies
    }

    /// Hear what happens from now on.
    #[must_use]
    pub fn listen(&self) -> broadcast::Receiver<Arc<Notice>> {
        self.notices.subscribe()
    }

    fn entry(&self, id: JobId) -> Option<Arc<JobEntry>> {
        self.jobs.read().unwrap_or_else(PoisonError::into_inner).get(&id).cloned()
    }

    /// Wait until everything written so far is on disk.
    async fn settle(&self) -> Result<(), StoreError> {
        self.store.write(Write::Barrier).await
    }

    /// Give the farm an event and carry out what follows from it. Returns what is left to the caller: the
    /// answers to its event.
    fn apply(self: &Arc<Self>, event: Event) -> Vec<Effect> {
        let mut farm = self.farm();
        let now = self.clock.now();
        let mut events = VecDeque::from([event]);
        let mut answers = Vec::new();
        while let Some(event) = events.pop_front() {
            let mut plans = Vec::new();
            for effect in farm.apply(event, now) {
                match effect {
                    Effect::Plan(tile, pass) => plans.extend(self.plan(tile, pass)),
                    Effect::Grant(ask, grant) => events.extend(self.deliver(ask, grant, &farm)),
                    Effect::Merge(accepted) => {
                        tokio::spawn(Arc::clone(self).merge_parts(accepted));
                    }
                    Effect::Measure(job, frame) => {
                        tokio::spawn(Arc::clone(self).measure_frame(job, frame));
                    }
                    Effect::TileFinished(key) => self.tile_finished(key),
                    Effect::FrameDone(job, _) => self.job_changed(job, &farm, true),
                    Effect::JobChanged(job) => self.job_changed(job, &farm, false),
                    Effect::AttemptFailed(attempt) => self.note_failure(attempt),
                    Effect::WorkerChanged(worker) => {
                        lock(&self.dirty).workers.insert(worker);
                    }
                    answer => answers.push(answer),
                }
            }
            if !plans.is_empty() {
                events.push_back(Event::Planned(plans));
            }
        }
        answers
    }

    /// Plan a pass: at once where no measurement is needed, else on another thread.
    fn plan(self: &Arc<Self>, tile: TileKey, pass: u32) -> Option<Plan> {
        let entry = self.entry(tile.job)?;
        let (rule, rect) = {
            let record = lock(&entry.record);
            (record.rule.clone(), record.grid().rect(tile.tile)?)
        };
        if pass > 0 && rule.looks_around() {
            tokio::spawn(Arc::clone(self).plan_from_films(tile, pass));
            return None;
        }
        Some(planned(tile, pass, rule.step(pass, rect, None)))
    }

    /// Send a lease to the request that waits for it.
    fn deliver(&self, ask: u64, grant: Grant, farm: &Farm) -> Option<Event> {
        let undelivered = Event::Undelivered(grant.lease);
        let Some(waiting) = lock(&self.asks).remove(&ask) else { return Some(undelivered) };
        let Some(entry) = self.entry(grant.job) else { return Some(undelivered) };
        let tracer = farm.tracer(grant.job).unwrap_or_default();
        let lease = {
            let record = lock(&entry.record);
            Lease {
                id: grant.lease,
                seconds: farm::LEASE_SECONDS,
                tracer,
                scene: record.scene,
                settings: RenderSettings {
                    frame: grant.frame,
                    resolution: record.resolution,
                    method: record.method.clone(),
                    seed: record.seed,
                    batch: record.rule.batch(),
                    batches_per_set: record.rule.batches_per_set(),
                },
                units: grant.units,
                request: record.request.clone(),
            }
        };
        waiting.send(lease).err().map(|_| undelivered)
    }

    fn tile_finished(&self, key: TileKey) {
        let Some(entry) = self.entry(key.job) else { return };
        // Where nobody looks across borders, planning the tile again says the same.
        if lock(&entry.record).rule.looks_around() {
            drop(self.store.write(Write::Finished(key)));
        }
        self.tell_tile(key, true);
    }

    /// Tell listeners what changed since the last time.
    fn tell(self: &Arc<Self>) {
        let Dirty { jobs, workers } = std::mem::take(&mut *lock(&self.dirty));
        let listened = self.notices.receiver_count() > 0;
        for &id in jobs.keys() {
            self.note_forecast(id);
            self.note_point(id);
        }
        for (id, changed) in jobs.into_iter().filter(|_| listened) {
            if let Ok(view) = self.job_view(id) {
                self.notify(if changed { "state" } else { "progress" }, Some(id), &view);
            }
        }
        let farm = self.farm();
        let now = self.clock.now();
        let views: Vec<_> = workers.into_iter().filter_map(|id| farm.worker(id, now)).collect();
        drop(farm);
        for view in views {
            if view.state == "lost" {
                tracing::warn!(worker = %view.id, machine = view.machine, "a worker is silent and counts as lost");
            }
            if listened {
                self.notify("worker", None, &view);
            }
        }
    }

    fn notify(&self, name: &'static str, job: Option<JobId>, data: &impl serde::Serialize) {
        match serde_json::to_string(data) {
            // An error here means that nobody listens.
            Ok(data) => drop(self.notices.send(Arc::new(Notice { name, job, data }))),
            Err(error) => tracing::error!(%error, "a notice could not be written"),
        }
    }

    /// A name for a request that brought none: no two have the same, across restarts too.
    #[must_use]
    pub fn next_request(&self) -> String {
        format!("r{}-{}", self.epoch, self.next_request.fetch_add(1, Ordering::Relaxed))
    }

    fn next_ask(&self) -> u64 {
        self.next_ask.fetch_add(1, Ordering::Relaxed)
    }
}

fn planned(tile: TileKey, pass: u32, step: Step) -> Plan {
    let work = match step {
        Step::Render { work, share } => Some((work, share)),
        Step::Finished => None,
    };
    Plan { tile, pass, work }
}

/// The answers that refuse an event.
fn refusal(answers: &[Effect]) -> Result<(), Failure> {
    for answer in answers {
        match answer {
            Effect::UnknownJob(id) => return Err(Failure::NotFound(format!("job {id}"))),
            Effect::UnknownWorker(id) => return Err(Failure::NotFound(format!("worker {id}; register again"))),
            Effect::Conflict(message) => return Err(Failure::Conflict(message.clone())),
            _ => {}
        }
    }
    Ok(())
}

/// A lock whose holder panicked holds values that are whole all the same: every change is a few assignments.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
