//! The life of a worker: register, lease, render, hand in, and leave in good order.

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use common::{
    job::WorkerId,
    protocol::{
        FailureCause, HEARTBEAT_SECONDS, Heartbeat, HeartbeatReply, LEASE_POLL_SECONDS, Lease, LeaseRequest, Register,
        Registered,
    },
};
use reqwest::{Method, StatusCode};
use tokio::{
    sync::{Semaphore, watch},
    time::{Instant, sleep, timeout},
};
use tokio_util::{sync::CancellationToken, task::TaskTracker};
use tracing::Instrument;

use crate::{
    assets::AssetSource,
    endpoint::{CallError, Endpoint},
    lease,
    link::{Link, entropy},
    pool::Pool,
    scenes::Scenes,
};

/// Leases held for rendering: one in work, one to go on with.
const LEASES: usize = 2;
/// Results that may wait for their acknowledgement before no more work is taken.
const MOST_UNACKNOWLEDGED: usize = 1024;
/// Results on their way at a time.
const UPLOADS: usize = 64;
/// Shortest time between two requests for a lease of which the first brought nothing.
const IDLE_PAUSE: Duration = Duration::from_millis(250);
/// Time to hand work back when units could not be finished in time.
const HAND_BACK: Duration = Duration::from_secs(5);

/// What a worker needs to know.
#[derive(Debug, Clone)]
pub struct Config {
    /// The coordinator.
    pub endpoint: Endpoint,
    /// Name of this machine, for people.
    pub machine: String,
    /// Threads to render with, at least 1.
    pub threads: usize,
    /// Folder to keep files of scenes in, if any.
    pub cache: Option<PathBuf>,
    /// On leaving, how long to go on with units that are begun.
    pub grace: Duration,
}

/// Why a worker ended before it was told to.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The system gives no threads.
    #[error("no threads to render with: {0}")]
    Threads(String),
    /// The coordinator does not take this worker.
    #[error("{url} refuses this worker: {source}")]
    Refused {
        /// The coordinator.
        url: String,
        /// What it said.
        source: Box<CallError>,
    },
}

/// A worker that is about to start.
#[derive(Debug)]
pub struct Worker {
    config: Config,
    pool: Pool,
}

impl Worker {
    /// A worker with its threads.
    ///
    /// # Errors
    /// The system gives no threads.
    pub fn new(config: Config) -> Result<Self, WorkerError> {
        let pool = Pool::new(config.threads).map_err(|error| WorkerError::Threads(error.to_string()))?;
        Ok(Self { config, pool })
    }

    /// Work until `shutdown`, or until the coordinator asks it to drain. Then finish the units that are
    /// begun, hand back the others, and return. A coordinator that is away is waited for.
    ///
    /// # Errors
    /// The coordinator refuses the worker, or is not one.
    pub async fn run(self, shutdown: CancellationToken) -> Result<(), WorkerError> {
        let grace = self.config.grace;
        let session = Arc::new(Session::new(self.config, self.pool, shutdown.child_token()));
        tokio::select! {
            biased;
            () = session.draining.cancelled() => return Ok(()),
            registered = session.register() => session.enter(registered?),
        }
        let tasks = TaskTracker::new();
        let beats = tokio::spawn(Arc::clone(&session).heartbeats());
        let beating = beats.abort_handle();
        let ended = tokio::select! {
            ended = session.take_leases(&tasks) => ended,
            ended = beats => ended.unwrap_or(Ok(())),
        };
        session.draining.cancel();
        tasks.close();
        if timeout(grace, tasks.wait()).await.is_err() {
            session.leaving.cancel();
            if timeout(HAND_BACK, tasks.wait()).await.is_err() {
                tracing::warn!("left before everything was handed back; the coordinator will give it out again");
            }
        }
        beating.abort();
        session.say_goodbye().await;
        ended
    }
}

/// A registered worker at work.
#[derive(Debug)]
pub(crate) struct Session {
    pub link: Arc<Link>,
    pub pool: Pool,
    pub scenes: Scenes,
    /// Set when no new work is wanted.
    pub draining: CancellationToken,
    /// Set when time is up.
    pub leaving: CancellationToken,
    /// Results that are computed and not acknowledged.
    pub unacknowledged: watch::Sender<usize>,
    /// Limits results on their way.
    pub uploads: Semaphore,
    introduction: Register,
    registered: Mutex<Registered>,
    registering: tokio::sync::Mutex<()>,
    held: Mutex<BTreeMap<u64, Held>>,
    leases_taken: AtomicU64,
}

/// A lease as heartbeats see it.
#[derive(Debug)]
struct Held {
    /// The worker it was given to: after the coordinator restarted, this one has another name.
    worker: WorkerId,
    lease: common::job::LeaseId,
    cancelled: CancellationToken,
}

/// A lease is listed in heartbeats as long as this lives.
#[derive(Debug)]
pub(crate) struct Hold {
    session: Arc<Session>,
    key: u64,
    /// The worker it was given to.
    pub worker: WorkerId,
    /// Set when nobody wants it any more.
    pub cancelled: CancellationToken,
}

impl Drop for Hold {
    fn drop(&mut self) {
        self.session.held().remove(&self.key);
    }
}

impl Session {
    fn new(config: Config, pool: Pool, draining: CancellationToken) -> Self {
        let link = Arc::new(Link::new(config.endpoint));
        let source = AssetSource::new(Arc::clone(&link), config.cache);
        let introduction = Register {
            machine: config.machine,
            threads: u32::try_from(pool.threads()).unwrap_or(u32::MAX),
            cpu_features: cpu_features(),
            tracer: tracer::VERSION.into(),
            nonce: format!("{:016x}{:016x}", entropy(), entropy()),
        };
        Self {
            link,
            scenes: Scenes::new(source, pool.clone()),
            pool,
            draining,
            leaving: CancellationToken::new(),
            unacknowledged: watch::Sender::new(0),
            uploads: Semaphore::new(UPLOADS),
            introduction,
            registered: Mutex::new(Registered { worker: WorkerId(0), heartbeat_seconds: HEARTBEAT_SECONDS }),
            registering: tokio::sync::Mutex::new(()),
            held: Mutex::default(),
            leases_taken: AtomicU64::new(0),
        }
    }

    async fn register(&self) -> Result<Registered, WorkerError> {
        let endpoint = &self.link.endpoint;
        let call = || endpoint.fetch(endpoint.request(Method::POST, "/workers").json(&self.introduction));
        self.link.persist(call).await.map_err(|source| self.refused(source))
    }

    fn enter(&self, registered: Registered) {
        tracing::info!("registered at {} as {}", self.link.endpoint.url(), registered.worker);
        *self.registered.lock().unwrap_or_else(PoisonError::into_inner) = registered;
    }

    fn registered(&self) -> Registered {
        self.registered.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The coordinator does not know `worker`: it was restarted, or had given the worker up. Register
    /// again, unless that has been done meanwhile.
    async fn register_again(&self, worker: WorkerId) -> Result<(), WorkerError> {
        let _one_at_a_time = self.registering.lock().await;
        if self.registered().worker == worker {
            self.enter(self.register().await?);
        }
        Ok(())
    }

    fn refused(&self, source: CallError) -> WorkerError {
        WorkerError::Refused { url: self.link.endpoint.url().into(), source: Box::new(source) }
    }

    fn held(&self) -> std::sync::MutexGuard<'_, BTreeMap<u64, Held>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Take leases and start a task for each, until draining.
    async fn take_leases(self: &Arc<Self>, tasks: &TaskTracker) -> Result<(), WorkerError> {
        let places = Arc::new(Semaphore::new(LEASES));
        let mut unacknowledged = self.unacknowledged.subscribe();
        loop {
            let next = async {
                let place = Arc::clone(&places).acquire_owned().await.ok();
                // The sender lives as long as the session: this only waits.
                let _ = unacknowledged.wait_for(|waiting| *waiting < MOST_UNACKNOWLEDGED).await;
                self.next_lease().await.map(|lease| (place, lease))
            };
            let (place, (worker, lease)) = tokio::select! {
                biased;
                () = self.draining.cancelled() => return Ok(()),
                next = next => next?,
            };
            let hold = self.hold(worker, &lease);
            // Whoever asked for the picture finds what became of it here, by the id of the request.
            let span = tracing::info_span!("lease", id = %lease.id, request = lease.request);
            tasks.spawn(lease::work(Arc::clone(self), hold, lease, place).instrument(span));
        }
    }

    fn hold(self: &Arc<Self>, worker: WorkerId, lease: &Lease) -> Hold {
        let key = self.leases_taken.fetch_add(1, Ordering::Relaxed);
        let cancelled = CancellationToken::new();
        self.held().insert(key, Held { worker, lease: lease.id, cancelled: cancelled.clone() });
        Hold { session: Arc::clone(self), key, worker, cancelled }
    }

    /// Ask until there is work.
    async fn next_lease(&self) -> Result<(WorkerId, Lease), WorkerError> {
        let endpoint = &self.link.endpoint;
        loop {
            let Registered { worker, .. } = self.registered();
            let request = LeaseRequest { prepared: self.scenes.prepared(), wait_seconds: LEASE_POLL_SECONDS };
            let asked = Instant::now();
            let call = async || {
                let request = endpoint.request(Method::POST, &format!("/workers/{worker}/lease")).json(&request);
                let response = endpoint.send(request).await?;
                if response.status() == StatusCode::NO_CONTENT {
                    return Ok(None);
                }
                let body = response.bytes().await.map_err(|error| endpoint.unreachable(&error))?;
                serde_json::from_slice(&body).map(Some).map_err(|error| endpoint.garbled(&error.to_string()))
            };
            match self.link.persist(call).await {
                Ok(Some(lease)) => return Ok((worker, lease)),
                Ok(None) => tokio::time::sleep_until(asked + IDLE_PAUSE).await,
                Err(error) => self.put_right(worker, error, "asking for work").await?,
            }
        }
    }

    /// After a refusal: register again where the worker is not known, end where it is not welcome, and
    /// otherwise wait a moment.
    async fn put_right(&self, worker: WorkerId, error: CallError, doing: &str) -> Result<(), WorkerError> {
        match error.refusal() {
            Some(404) => self.register_again(worker).await,
            Some(401 | 403) => Err(self.refused(error)),
            _ => {
                tracing::warn!("{doing}: {error}");
                sleep(IDLE_PAUSE).await;
                Ok(())
            }
        }
    }

    async fn heartbeats(self: Arc<Self>) -> Result<(), WorkerError> {
        let mut told = false;
        loop {
            let Registered { worker, heartbeat_seconds } = self.registered();
            let pause = Duration::try_from_secs_f64(heartbeat_seconds).unwrap_or(Duration::from_secs(5));
            tokio::select! {
                () = sleep(pause.max(Duration::from_millis(10))) => {}
                // Say at once that no more work is wanted.
                () = self.draining.cancelled(), if !told => told = true,
            }
            match self.link.persist(|| self.beat(worker)).await {
                Ok(reply) => self.heed(worker, &reply),
                Err(error) => self.put_right(worker, error, "heartbeat").await?,
            }
        }
    }

    async fn beat(&self, worker: WorkerId) -> Result<HeartbeatReply, CallError> {
        let leases = self.held().values().filter(|held| held.worker == worker).map(|held| held.lease).collect();
        let beat = Heartbeat { leases, draining: self.draining.is_cancelled(), prepared: self.scenes.prepared() };
        let endpoint = &self.link.endpoint;
        endpoint.fetch(endpoint.request(Method::POST, &format!("/workers/{worker}/heartbeat")).json(&beat)).await
    }

    fn heed(&self, worker: WorkerId, reply: &HeartbeatReply) {
        for held in self.held().values() {
            if held.worker == worker && reply.cancelled.contains(&held.lease) {
                held.cancelled.cancel();
            }
        }
        if reply.drain {
            self.draining.cancel();
        }
    }

    /// A last heartbeat without leases, so that a lease which was on its way here is given out again.
    async fn say_goodbye(&self) {
        let _ = timeout(HAND_BACK, self.beat(self.registered().worker)).await;
    }

    /// Tell the coordinator that units will not come. Waits while it is away; what it refuses was not its
    /// any more.
    pub async fn give_back(&self, hold: &Hold, report: lease::Report) {
        let lease::Report { lease, units, cause, message } = report;
        if units.is_empty() {
            return;
        }
        if cause == FailureCause::Failed {
            tracing::error!(%lease, units = units.len(), "{message}");
        }
        let body = common::protocol::LeaseFailure { worker: hold.worker, units, cause, message };
        let endpoint = &self.link.endpoint;
        let call = || endpoint.send(endpoint.request(Method::POST, &format!("/leases/{lease}/fail")).json(&body));
        if let Err(error) = self.link.persist(call).await {
            tracing::debug!(%lease, "not taken back: {error}");
        }
    }
}

/// Instruction sets that the tracer's kernels may use here.
fn cpu_features() -> Vec<String> {
    #[cfg(target_arch = "x86_64")]
    {
        let features = [("avx2", is_x86_feature_detected!("avx2")), ("sse2", is_x86_feature_detected!("sse2"))];
        features.into_iter().filter(|(_, there)| *there).map(|(name, _)| name.to_string()).collect()
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        vec![std::env::consts::ARCH.to_string()]
    }
}
