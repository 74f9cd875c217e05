//! A coordinator without a socket, and a worker that renders made-up pixels.

#![allow(dead_code, reason = "every test file uses its own part")]

use std::path::Path;

use axum::{
    body::{Body, Bytes},
    http::{Method, Request, Response, StatusCode},
};
use common::{
    film::{Features, Film, Moments},
    hash::AssetHash,
    pass::Work,
    protocol::{JobView, Lease, Registered, RenderSettings, Unit},
    result::{UnitResult, UnitStatistics},
};
use coordinator::{App, Config, build_app};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use tower::ServiceExt;

/// A scene without files.
pub fn scene() -> Value {
    json!({
        "tessera": 1,
        "name": "a ball",
        "camera": { "position": [0, 0, 5], "target": [0, 0, 0] },
        "film": { "width": 100, "height": 70 },
        "shapes": [{ "type": "sphere", "radius": 1 }],
    })
}

/// A job of that scene: twelve tiles of 64 samples.
pub fn fixed() -> Value {
    json!({ "scene": scene(), "tile": 32, "quality": { "target": "samples", "samples": 64 } })
}

/// An answer, read whole.
#[derive(Debug)]
pub struct Answer {
    pub status: StatusCode,
    pub headers: axum::http::HeaderMap,
    pub body: Bytes,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {:?}", self.body))
    }

    pub fn read<T: DeserializeOwned>(&self) -> T {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {:?}", self.body))
    }

    pub fn text(&self) -> String {
        String::from_utf8(self.body.to_vec()).unwrap()
    }

    /// The one error body: its code, message and field.
    pub fn error(&self) -> (String, String, Option<String>) {
        let body: common::protocol::ErrorBody = self.read();
        (body.error.code, body.error.message, body.error.field)
    }
}

/// A coordinator in a folder of its own.
pub async fn fresh() -> (tempfile::TempDir, App) {
    let folder = tempfile::tempdir().unwrap();
    let app = open(folder.path()).await;
    (folder, app)
}

/// Open a data folder; one that a coordinator was dropped on is free when its last task has gone.
pub async fn open(folder: &Path) -> App {
    for _ in 0..1000 {
        match build_app(Config::new(folder)).await {
            Ok(app) => return app,
            Err(error) if error.to_string().contains("in use") => {
                tokio::time::sleep(std::time::Duration::from_millis(5)).await;
            }
            Err(error) => panic!("{error}"),
        }
    }
    panic!("the folder is never freed");
}

pub async fn send(app: &App, request: Request<Body>) -> Response<Body> {
    app.router.clone().oneshot(request).await.unwrap()
}

pub async fn call(app: &App, method: Method, path: &str, body: impl Into<Body>) -> Answer {
    let request = Request::builder().method(method).uri(path).body(body.into()).unwrap();
    whole(send(app, request).await).await
}

pub async fn whole(response: Response<Body>) -> Answer {
    let (parts, body) = response.into_parts();
    let body = axum::body::to_bytes(body, 1 << 28).await.unwrap();
    Answer { status: parts.status, headers: parts.headers, body }
}

pub async fn get(app: &App, path: &str) -> Answer {
    call(app, Method::GET, path, Body::empty()).await
}

pub async fn post(app: &App, path: &str, body: &Value) -> Answer {
    call(app, Method::POST, path, body.to_string()).await
}

pub async fn put(app: &App, path: &str, body: impl Into<Body>) -> Answer {
    call(app, Method::PUT, path, body).await
}

pub async fn submit(app: &App, body: Value) -> JobView {
    let answer = post(app, "/api/v1/jobs", &body).await;
    assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
    answer.read()
}

pub async fn job(app: &App, id: impl std::fmt::Display) -> JobView {
    get(app, &format!("/api/v1/jobs/{id}")).await.read()
}

/// A worker that makes up pixels: a pure function of what a unit's pixels may depend on.
pub struct Worker {
    pub id: String,
}

impl Worker {
    pub async fn register(app: &App, nonce: &str) -> Worker {
        Self::register_as(app, nonce, "made-up-1").await
    }

    pub async fn register_as(app: &App, nonce: &str, tracer: &str) -> Worker {
        let register = json!({
            "machine": "nowhere", "threads": 2, "cpu_features": ["sse2"], "tracer": tracer, "nonce": nonce,
        });
        let answer = post(app, "/api/v1/workers", &register).await;
        assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
        let Registered { worker, .. } = answer.read();
        Worker { id: worker.to_string() }
    }

    pub async fn lease(&self, app: &App) -> Option<Lease> {
        let answer = post(app, &format!("/api/v1/workers/{}/lease", self.id), &json!({ "wait_seconds": 0 })).await;
        match answer.status {
            StatusCode::OK => Some(answer.read()),
            StatusCode::NO_CONTENT => None,
            other => panic!("{other}: {}", answer.text()),
        }
    }

    pub async fn hand_in(&self, app: &App, lease: &Lease, unit: &Unit) -> Answer {
        let body = compress(&render(&lease.settings, unit).encode());
        put(app, &format!("/api/v1/leases/{}/units/{}", lease.id, unit.id), body).await
    }

    /// Render leases until `enough` units are done, or there is no more work. Returns the units done.
    pub async fn work(&self, app: &App, enough: usize) -> usize {
        let mut done = 0;
        let mut dry = 0;
        while done < enough && dry < 200 {
            let Some(lease) = self.lease(app).await else {
                // Parts may still be on their way into their tile.
                dry += 1;
                tokio::time::sleep(std::time::Duration::from_millis(5)).await;
                if self.idle(app).await {
                    break;
                }
                continue;
            };
            dry = 0;
            for unit in &lease.units {
                if done == enough {
                    break;
                }
                let answer = self.hand_in(app, &lease, unit).await;
                assert_eq!(answer.status, StatusCode::OK, "{}", answer.text());
                done += 1;
            }
        }
        done
    }

    /// Whether no job wants anything any more.
    async fn idle(&self, app: &App) -> bool {
        let jobs = get(app, "/api/v1/jobs").await.json();
        let over = |job: &Value| !matches!(job["status"].as_str(), Some("queued" | "active"));
        jobs["jobs"].as_array().unwrap().iter().all(over)
    }
}

pub fn compress(bytes: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(bytes, 1).unwrap()
}

/// Pixels from nothing but settings and the numbers of the samples.
pub fn render(settings: &RenderSettings, unit: &Unit) -> UnitResult {
    let rect = unit.id.rect;
    let batch = settings.batch.max(1);
    let mut samples_taken = 0;
    let moments: Vec<Moments> = rect
        .pixels()
        .enumerate()
        .map(|(i, (x, y))| {
            let (first, samples) = match &unit.work {
                Work::Uniform { first, samples } => (*first, *samples),
                Work::PerPixel { first, batches } => (first[i] * batch, batches[i] * batch),
                Work::Prepare { .. } => (0, 0),
                Work::Textbook { batch, max_samples, .. } => (0, (batch * (1 + (x + y) % 5)).min(*max_samples)),
            };
            samples_taken += u64::from(samples);
            let mut moments = Moments::default();
            let mut at = first;
            while at < first + samples {
                let count = batch.min(first + samples - at);
                let key = format!("{} {} {x} {y} {at}", settings.seed, settings.frame);
                let hash = AssetHash::of(key.as_bytes());
                let value = |i: usize| f64::from(hash.as_bytes()[i]) / 256.0;
                moments = moments.merge(Moments::batch(count, [value(0), value(1), value(2)]));
                at += count;
            }
            moments
        })
        .collect();
    let feature = Features { albedo: [0.5, 0.25, 0.125], normal: [0.0, 0.0, 1.0], depth: 4.0 };
    let features = if unit.features { vec![feature; rect.area()] } else { Vec::new() };
    let statistics = UnitStatistics {
        samples: samples_taken,
        rays: 3 * samples_taken,
        cpu_seconds: 1e-5 * samples_taken as f64,
        wall_seconds: 5e-6 * samples_taken as f64,
        ..UnitStatistics::default()
    };
    UnitResult { rect, film: Film { moments, features }, statistics }
}
