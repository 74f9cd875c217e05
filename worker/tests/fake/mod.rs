//! A coordinator that hands out what a test gives it and writes down what it is told.

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    sync::{Arc, Mutex, MutexGuard, Once},
    time::Duration,
};

use axum::{
    Json, Router,
    body::Bytes,
    extract::{Path, State},
    http::StatusCode,
    response::{IntoResponse, Response},
    routing::{get, post, put},
};
use common::{
    hash::AssetHash,
    job::{JobId, LeaseId, WorkerId},
    pass::Work,
    protocol::{
        ApiError, ErrorBody, Heartbeat, HeartbeatReply, Lease, LeaseFailure, Register, Registered, RenderSettings,
        Unit, UnitId,
    },
    result::UnitResult,
    tile::Rect,
};
use tokio::{net::TcpListener, sync::Notify};
use tokio_util::sync::CancellationToken;
use worker::{Config, Endpoint, Worker, WorkerError};

/// Longest a test waits for anything.
const PATIENCE: Duration = Duration::from_secs(20);

/// What the coordinator has and was told.
#[derive(Default)]
pub struct Notes {
    pub assets: BTreeMap<AssetHash, Vec<u8>>,
    pub fetched: Vec<AssetHash>,
    pub registered: Vec<Register>,
    pub known: BTreeSet<WorkerId>,
    pub leases: VecDeque<Lease>,
    pub granted: Vec<LeaseId>,
    pub results: Vec<(LeaseId, UnitId, Vec<u8>)>,
    pub failures: Vec<(LeaseId, LeaseFailure)>,
    pub heartbeats: Vec<Heartbeat>,
    pub cancelled: Vec<LeaseId>,
    pub drain: bool,
    /// Forget all workers as soon as this lease is handed out, as a restart would.
    pub forget_after: Option<LeaseId>,
    /// Refuse everybody.
    pub closed: bool,
}

#[derive(Clone, Default)]
pub struct Fake {
    notes: Arc<Mutex<Notes>>,
    changed: Arc<Notify>,
}

impl Fake {
    pub fn notes(&self) -> MutexGuard<'_, Notes> {
        self.notes.lock().unwrap()
    }

    /// Wait until something holds.
    pub async fn wait(&self, what: &str, mut holds: impl FnMut(&Notes) -> bool) {
        let wait = async {
            loop {
                let changed = self.changed.notified();
                if holds(&self.notes()) {
                    return;
                }
                changed.await;
            }
        };
        tokio::time::timeout(PATIENCE, wait).await.unwrap_or_else(|_| panic!("never came: {what}"));
    }

    fn change<T>(&self, change: impl FnOnce(&mut Notes) -> T) -> T {
        let answer = change(&mut self.notes());
        self.changed.notify_waiters();
        answer
    }

    /// Keep a file.
    pub fn store(&self, bytes: &[u8]) -> AssetHash {
        let hash = AssetHash::of(bytes);
        self.notes().assets.insert(hash, bytes.to_vec());
        hash
    }

    /// Hand out a lease.
    pub fn offer(&self, lease: Lease) {
        self.change(|notes| notes.leases.push_back(lease));
    }

    /// Serve on `listener` until the test ends.
    pub fn serve(&self, listener: TcpListener) {
        let router = Router::new()
            .route("/workers", post(register))
            .route("/workers/{id}/lease", post(lease))
            .route("/workers/{id}/heartbeat", post(heartbeat))
            .route("/leases/{lease}/units/{unit}", put(result))
            .route("/leases/{lease}/fail", post(fail))
            .route("/assets/{hash}", get(asset))
            .with_state(self.clone());
        let router = Router::new().nest(common::protocol::API, router);
        tokio::spawn(async move { axum::serve(listener, router).await.unwrap() });
    }

    /// A worker for this coordinator, and the token that tells it to leave.
    pub fn worker(&self, url: &str, change: impl FnOnce(&mut Config)) -> Running {
        quiet_logs();
        let mut config = Config {
            endpoint: Endpoint::new(url, None).unwrap(),
            machine: "test".into(),
            threads: 2,
            cache: None,
            grace: Duration::from_secs(10),
        };
        change(&mut config);
        let leave = CancellationToken::new();
        let task = tokio::spawn(Worker::new(config).unwrap().run(leave.clone()));
        Running { leave, task }
    }

    /// A coordinator with a worker.
    pub async fn with_worker(change: impl FnOnce(&mut Config)) -> (Fake, Running) {
        let fake = Fake::default();
        let listener = listener().await;
        let url = url(&listener);
        fake.serve(listener);
        let running = fake.worker(&url, change);
        (fake, running)
    }
}

pub struct Running {
    pub leave: CancellationToken,
    pub task: tokio::task::JoinHandle<Result<(), WorkerError>>,
}

impl Running {
    /// Tell it to leave, and wait until it has.
    pub async fn stop(self) -> Result<(), WorkerError> {
        self.leave.cancel();
        self.ended().await
    }

    /// Wait until it leaves by itself.
    pub async fn ended(self) -> Result<(), WorkerError> {
        tokio::time::timeout(PATIENCE, self.task).await.expect("the worker never left").unwrap()
    }
}

pub async fn listener() -> TcpListener {
    TcpListener::bind("127.0.0.1:0").await.unwrap()
}

pub fn url(listener: &TcpListener) -> String {
    format!("http://{}", listener.local_addr().unwrap())
}

fn refusal(status: StatusCode) -> Response {
    let error = ApiError { code: "no".into(), message: "no".into(), field: None, missing: Vec::new() };
    (status, Json(ErrorBody { error })).into_response()
}

async fn register(State(fake): State<Fake>, Json(register): Json<Register>) -> Response {
    fake.change(|notes| {
        if notes.closed {
            return refusal(StatusCode::UNAUTHORIZED);
        }
        notes.registered.push(register);
        let worker = WorkerId(notes.registered.len() as u64);
        notes.known.insert(worker);
        Json(Registered { worker, heartbeat_seconds: 0.02 }).into_response()
    })
}

async fn lease(State(fake): State<Fake>, Path(worker): Path<WorkerId>) -> Response {
    loop {
        let changed = fake.changed.notified();
        let answer = fake.change_quietly(|notes| {
            if !notes.known.contains(&worker) {
                return Some(refusal(StatusCode::NOT_FOUND));
            }
            let lease = notes.leases.pop_front()?;
            notes.granted.push(lease.id);
            if notes.forget_after == Some(lease.id) {
                notes.known.clear();
            }
            Some(Json(lease).into_response())
        });
        if let Some(answer) = answer {
            fake.changed.notify_waiters();
            return answer;
        }
        changed.await;
    }
}

impl Fake {
    fn change_quietly<T>(&self, change: impl FnOnce(&mut Notes) -> T) -> T {
        change(&mut self.notes())
    }
}

async fn heartbeat(State(fake): State<Fake>, Path(worker): Path<WorkerId>, Json(beat): Json<Heartbeat>) -> Response {
    fake.change(|notes| {
        if !notes.known.contains(&worker) {
            return refusal(StatusCode::NOT_FOUND);
        }
        notes.heartbeats.push(beat);
        Json(HeartbeatReply { cancelled: notes.cancelled.clone(), drain: notes.drain }).into_response()
    })
}

async fn result(State(fake): State<Fake>, Path((lease, unit)): Path<(LeaseId, UnitId)>, body: Bytes) {
    fake.change(|notes| notes.results.push((lease, unit, body.to_vec())));
}

async fn fail(State(fake): State<Fake>, Path(lease): Path<LeaseId>, Json(failure): Json<LeaseFailure>) {
    fake.change(|notes| notes.failures.push((lease, failure)));
}

async fn asset(State(fake): State<Fake>, Path(hash): Path<AssetHash>) -> Response {
    fake.change(|notes| {
        notes.fetched.push(hash);
        notes.assets.get(&hash).map_or_else(|| refusal(StatusCode::NOT_FOUND), |bytes| bytes.clone().into_response())
    })
}

/// A scene of a lamp over a floor.
pub const SCENE: &str = r#"{
    "tessera": 1,
    "camera": {"position": [0, 1, 5], "target": [0, 1, 0]},
    "shapes": [
        {"type": "sphere", "center": [0, 3, 0], "radius": 0.5, "emission": [5, 4, 3]},
        {"type": "quad", "vertices": [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]]}
    ]
}"#;

/// A lease of units of `samples` samples, cut from rows of a frame of 16 x 4096 pixels.
pub fn lease_of(id: u64, scene: AssetHash, rects: &[Rect], samples: u32) -> Lease {
    let unit = |(tile, rect): (usize, &Rect)| Unit {
        id: UnitId { job: JobId(1), frame: 1, tile: id as u32 * 100 + tile as u32, pass: 0, rect: *rect },
        work: Work::Uniform { first: 0, samples },
        features: true,
    };
    Lease {
        id: LeaseId(id),
        seconds: 15.0,
        tracer: tracer::VERSION.into(),
        scene,
        settings: RenderSettings {
            frame: 1,
            resolution: [16, 4096],
            method: common::method::Method::default(),
            seed: 0,
            batch: 16,
            batches_per_set: 4,
        },
        units: rects.iter().enumerate().map(unit).collect(),
        request: None,
    }
}

/// A unit that is done at once.
pub fn short() -> Rect {
    Rect { x: 4, y: 2040, w: 8, h: 6 }
}

/// A unit of so many rows that it is not done while a test runs, each of which is short.
pub fn endless() -> Rect {
    Rect { x: 8, y: 0, w: 1, h: 4096 }
}

/// The pixels of a result as it came over the wire.
pub fn decode(unit: UnitId, body: &[u8]) -> UnitResult {
    let bytes = zstd::bulk::decompress(body, 1 << 24).unwrap();
    UnitResult::decode(&bytes, unit.rect).unwrap()
}

static LOG: Mutex<Vec<u8>> = Mutex::new(Vec::new());

/// Collect the log of all tests instead of printing it.
fn quiet_logs() {
    struct Sink;
    impl std::io::Write for Sink {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            LOG.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    static ONCE: Once = Once::new();
    ONCE.call_once(|| tracing_subscriber::fmt().with_ansi(false).with_writer(|| Sink).init());
}

/// Lines of the log that name `text`.
pub fn logged(text: &str) -> Vec<String> {
    let log = String::from_utf8(LOG.lock().unwrap().clone()).unwrap();
    log.lines().filter(|line| line.contains(text)).map(String::from).collect()
}
