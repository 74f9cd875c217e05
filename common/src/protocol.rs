//! The messages of the farm, grouped by who speaks and who listens. JSON, but for unit results
//! (see [`crate::result`]).

use std::{fmt, str::FromStr};

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{
    hash::AssetHash,
    job::{JobId, JobState, LeaseId, Quality, WorkerId},
    method::Method,
    pass::Work,
    plan::MethodPlan,
    tile::Rect,
};

/// Prefix of every route but health and metrics.
pub const API: &str = "/api/v1";
/// Seconds between two heartbeats of a worker.
pub const HEARTBEAT_SECONDS: f64 = 5.0;
/// Seconds of silence after which a worker is lost.
pub const WORKER_LOST_SECONDS: f64 = 15.0;
/// Longest a request for a lease waits, seconds.
pub const LEASE_POLL_SECONDS: f64 = 20.0;
/// Content type of a unit's result: zstd over [`crate::result::UnitResult::encode`].
pub const RESULT_CONTENT_TYPE: &str = "application/x-tessera-unit+zstd";

// ---------------------------------------------------------------- everyone <- coordinator

/// The body of every response that is not a success.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorBody {
    /// The error.
    pub error: ApiError,
}

/// What went wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ApiError {
    /// A short name for programs: `not_found`, `invalid`, `missing_assets`, `conflict`, `unauthorized`,
    /// `too_large`, `malformed`, `forbidden`, `method_not_allowed`, `leaving`, `internal`.
    pub code: String,
    /// One sentence for people.
    pub message: String,
    /// The offending field, by its path in the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// With `missing_assets`: the hashes wanted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<AssetHash>,
}

// ---------------------------------------------------------------- worker -> coordinator

/// `POST /workers`: a worker process starts. Answered by [`Registered`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Register {
    /// Name of the machine, for people.
    pub machine: String,
    /// Threads it renders with.
    pub threads: u32,
    /// Instruction sets the kernels may use: `avx2`, `sse2`, ...
    pub cpu_features: Vec<String>,
    /// Version of the tracer, [`Lease::tracer`].
    pub tracer: String,
    /// Drawn once per process start: a restarted worker is a new worker, a repeated request is not.
    pub nonce: String,
}

/// `POST /workers/{id}/lease`: give me work. Answered by [`Lease`], or 204 after the wait.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LeaseRequest {
    /// Scenes that are prepared here, as (scene, frame).
    #[serde(default)]
    pub prepared: Vec<(AssetHash, u32)>,
    /// Wait at most this long, seconds, up to [`LEASE_POLL_SECONDS`].
    #[serde(default)]
    pub wait_seconds: f64,
}

/// `POST /workers/{id}/heartbeat`: still here. Answered by [`HeartbeatReply`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Heartbeat {
    /// Leases it holds and wants renewed.
    pub leases: Vec<LeaseId>,
    /// Whether it is going away and wants no more work.
    #[serde(default)]
    pub draining: bool,
    /// Scenes that are prepared here, as (scene, frame).
    #[serde(default)]
    pub prepared: Vec<(AssetHash, u32)>,
}

/// The result of a unit that prepares a job, in the place of pixels: zstd over JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Preparation {
    /// What the scene needs and which method was chosen.
    pub plan: MethodPlan,
    /// Processor seconds that this took.
    pub cpu_seconds: f64,
}

/// Most bytes of a [`Preparation`], unpacked.
pub const MAX_PREPARATION: usize = 1 << 20;

/// `POST /leases/{lease}/fail`: units that will not be rendered under this lease.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LeaseFailure {
    /// The worker.
    pub worker: WorkerId,
    /// The units.
    pub units: Vec<UnitId>,
    /// Whether the units were at fault or the worker just leaves.
    pub cause: FailureCause,
    /// One sentence for people.
    pub message: String,
}

/// Why units come back unrendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FailureCause {
    /// The scene could not be loaded or the render failed: costs an attempt.
    Failed,
    /// The worker goes away or the lease was cancelled: costs nothing.
    Returned,
}

// ---------------------------------------------------------------- coordinator -> worker

/// The answer to [`Register`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Registered {
    /// Its name from now on.
    pub worker: WorkerId,
    /// Seconds between two heartbeats.
    pub heartbeat_seconds: f64,
}

/// The answer to [`Heartbeat`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeartbeatReply {
    /// Leases that are no longer wanted: stop them and say nothing.
    pub cancelled: Vec<LeaseId>,
    /// Whether to finish what is begun and ask for no more.
    pub drain: bool,
}

/// Units given to one worker until a deadline: all of one job and frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Lease {
    /// Its name.
    pub id: LeaseId,
    /// Seconds until it must be renewed by a heartbeat.
    pub seconds: f64,
    /// Version of the tracer that the job is pinned to.
    pub tracer: String,
    /// The scene file.
    pub scene: AssetHash,
    /// Settings shared by the units.
    pub settings: RenderSettings,
    /// The units.
    pub units: Vec<Unit>,
    /// Id of the request that submitted the job, for the worker's log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<String>,
}

/// What the units of a frame have in common. With a [`Unit`] it is all that pixels depend on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RenderSettings {
    /// Frame number.
    pub frame: u32,
    /// Width and height of the whole frame, pixels.
    pub resolution: [u32; 2],
    /// How light is estimated.
    pub method: Method,
    /// Seed of the sample points.
    pub seed: u64,
    /// Samples of a batch.
    pub batch: u32,
}

/// One piece of work, computed once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Unit {
    /// Its name, which holds its rectangle.
    pub id: UnitId,
    /// Which samples.
    pub work: Work,
    /// Whether features of the first hit are wanted too (first pass).
    pub features: bool,
}

/// Names a unit: job, frame, tile, pass, and the rectangle (the tile's, or a part of it). Written
/// `j3.f1.t12.p0.x64.y0.w64.h32`, so that a result can be placed even by a coordinator that was restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UnitId {
    /// Job.
    pub job: JobId,
    /// Frame number.
    pub frame: u32,
    /// Tile index in the frame.
    pub tile: u32,
    /// Pass of the tile.
    pub pass: u32,
    /// The pixels.
    pub rect: Rect,
}

impl fmt::Display for UnitId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let UnitId { job, frame, tile, pass, rect: Rect { x, y, w, h } } = self;
        write!(f, "{job}.f{frame}.t{tile}.p{pass}.x{x}.y{y}.w{w}.h{h}")
    }
}

impl FromStr for UnitId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || format!("\"{text}\" is not a unit such as j3.f1.t12.p0.x64.y0.w64.h32");
        let mut parts = text.split('.');
        let job = parts.next().and_then(|part| part.parse().ok()).ok_or_else(bad)?;
        let mut number = |prefix: &str| -> Result<u32, String> {
            let digits = parts.next().and_then(|part| part.strip_prefix(prefix)).ok_or_else(bad)?;
            if digits.bytes().all(|b| b.is_ascii_digit()) { digits.parse().map_err(|_| bad()) } else { Err(bad()) }
        };
        let (frame, tile, pass) = (number("f")?, number("t")?, number("p")?);
        let rect = Rect { x: number("x")?, y: number("y")?, w: number("w")?, h: number("h")? };
        if parts.next().is_some() { Err(bad()) } else { Ok(UnitId { job, frame, tile, pass, rect }) }
    }
}

impl Serialize for UnitId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for UnitId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl JsonSchema for UnitId {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "UnitId".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "examples": ["j3.f1.t12.p0.x64.y0.w64.h32"] })
    }
}

// ---------------------------------------------------------------- coordinator -> people

/// A job as people see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobView {
    /// Its name in the API.
    pub id: JobId,
    /// Its name for people.
    pub name: String,
    /// Where it is in its life.
    #[serde(rename = "status")]
    pub state: JobState,
    /// Why it failed, one sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// Share of the work done, 0 to 1.
    pub progress: f64,
    /// Samples taken so far.
    pub samples: u64,
    /// Samples per second over the last seconds.
    pub samples_per_second: f64,
    /// Relative error that 99% of the measured pixels keep to so far: half-width of the stopping rule's
    /// interval (at the target's confidence, else 95%) over the luminance. Absent until it can be told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
    /// Seconds to the end, absent until it can be told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eta_seconds: Option<f64>,
    /// Frames and how far each is.
    pub frames: Vec<FrameView>,
    /// The scene file.
    pub scene: AssetHash,
    /// Frame size, pixels.
    pub resolution: [u32; 2],
    /// Part of the frame that is rendered.
    pub region: Rect,
    /// Edge of a tile, pixels.
    pub tile: u32,
    /// How exact the picture must be.
    pub quality: Quality,
    /// How light is estimated.
    pub method: Method,
    /// What the scene needs and how the method was chosen; absent until a worker has prepared the job, and of
    /// jobs that name their method or have a frame too small for that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<MethodPlan>,
    /// 0 (last) to 100 (first).
    pub priority: u8,
    /// Free words.
    pub tags: Vec<String>,
    /// Seed of the sample points.
    pub seed: u64,
    /// Version of the tracer it is pinned to, once a worker has begun.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracer: Option<String>,
    /// When it was submitted, RFC 3339.
    pub created_at: String,
    /// When it ended, RFC 3339.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finished_at: Option<String>,
    /// Seconds from its first lease to its end, or until now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_seconds: Option<f64>,
    /// What was forecast of it: when the pilot of its first frame was done, and at a quarter and half of the
    /// work.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub forecasts: Vec<Forecast>,
    /// What it cost so far.
    pub statistics: JobStatistics,
    /// Workers that hold units of it now.
    #[serde(default)]
    pub workers_now: u32,
    /// Id of the request that submitted it, as the logs have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<String>,
}

/// What a job is to cost in the end, as foreseen from the errors and costs measured so far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Forecast {
    /// Share of the processor seconds that were spent when it was made, 0 to 1.
    pub progress: f64,
    /// Seconds after the first lease when it was made.
    pub made_at_seconds: f64,
    /// Samples in the end.
    pub samples: f64,
    /// Processor seconds in the end.
    pub cpu_seconds: f64,
    /// Seconds from the first lease to the end.
    pub wall_seconds: f64,
}

/// Work and time of a job so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct JobStatistics {
    /// Rays traced.
    pub rays: u64,
    /// Bounding-box tests.
    pub node_tests: u64,
    /// Primitive tests.
    pub primitive_tests: u64,
    /// Samples that were not finite and were left out.
    pub rejected: u64,
    /// Luminance that a clamp took away.
    pub clamped: f64,
    /// Processor seconds of all workers.
    pub cpu_seconds: f64,
    /// Seconds to fetch and decode the scene, summed over workers and frames.
    pub load_seconds: f64,
    /// Seconds to build its acceleration structure, summed likewise.
    pub build_seconds: f64,
    /// Leases given back, failed or lost and tried again, in units.
    pub retries: u64,
    /// Workers that handed in a result.
    pub workers: u32,
}

/// A frame as people see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameView {
    /// Frame number.
    pub frame: u32,
    /// Share of its work done, 0 to 1.
    pub progress: f64,
    /// Whether it is done.
    pub done: bool,
    /// Mean samples a pixel.
    pub mean_samples: f64,
    /// Most samples of a pixel.
    pub max_samples: u32,
    /// Measured pixels whose interval is wider than the target; absent without a noise target. The interval is
    /// that of the stopping rule: over tile borders once the frame is done, by each tile alone before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels_missed: Option<u64>,
    /// Share of pixels whose interval is within the target; absent without a noise target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_target: Option<f64>,
}

/// A page of jobs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobList {
    /// The jobs, newest first.
    pub jobs: Vec<JobView>,
    /// Give this as `cursor` for the next page; absent on the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}

/// A tile as people see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TileView {
    /// Index in the frame.
    pub tile: u32,
    /// Its pixels.
    pub rect: Rect,
    /// `waiting`, `pending`, `leased` or `done`.
    pub state: String,
    /// Passes finished.
    pub passes: u32,
    /// Attempts that failed.
    pub attempts: u32,
    /// Worker that has it, or had it last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worker: Option<WorkerId>,
    /// Processor milliseconds spent.
    pub milliseconds: f64,
    /// Samples taken in it.
    pub samples: u64,
    /// Why its last attempt came to nothing, where one did; see `/jobs/{id}/failures`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

/// An attempt at a unit that came to nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FailureView {
    /// When, RFC 3339.
    pub at: String,
    /// Frame number.
    pub frame: u32,
    /// Tile index in the frame.
    pub tile: u32,
    /// Pass of the tile.
    pub pass: u32,
    /// The worker that had it.
    pub worker: WorkerId,
    /// `failed`: the worker could not render it, or handed in a bad result. `hung`: it was not done in many
    /// times the predicted time. `lost`: its worker fell silent.
    pub cause: String,
    /// One sentence.
    pub message: String,
}

/// What went wrong in a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FailureList {
    /// The last attempts that came to nothing, oldest first, at most 100.
    pub failures: Vec<FailureView>,
}

/// How the error of a job fell so far, and what is foreseen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Convergence {
    /// What was measured, in the order of time.
    pub points: Vec<ConvergencePoint>,
    /// The relative error that is asked for; absent without a noise target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<f64>,
    /// Where it is to end; absent when it has ended, or nothing can be told yet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forecast: Option<ConvergencePoint>,
}

/// The error after so much work.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ConvergencePoint {
    /// Processor seconds of all workers.
    pub cpu_seconds: f64,
    /// Samples taken.
    pub samples: f64,
    /// Relative error that 99% of the measured pixels keep to, as [`JobView::error`].
    pub error: f64,
}

/// A worker as people see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorkerView {
    /// Its name in the API.
    pub id: WorkerId,
    /// Name of its machine.
    pub machine: String,
    /// `idle`, `busy`, `draining`, `disabled` or `lost`.
    pub state: String,
    /// Threads it renders with.
    pub threads: u32,
    /// Instruction sets.
    pub cpu_features: Vec<String>,
    /// Version of its tracer.
    pub tracer: String,
    /// Samples per second over the last units.
    pub samples_per_second: f64,
    /// Units handed in.
    pub units: u64,
    /// Units failed.
    pub failures: u64,
    /// Seconds since it was last heard of.
    pub last_seen_seconds: f64,
    /// Units it holds now.
    pub leased: u64,
    /// Samples per second over the last ten minutes.
    #[serde(default)]
    pub samples_per_second_before: f64,
    /// What it works on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<LeaseView>,
    /// Scenes that it holds prepared, as (scene, frame).
    #[serde(default)]
    pub prepared: Vec<(AssetHash, u32)>,
}

/// A lease as people see it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LeaseView {
    /// Its name.
    pub id: LeaseId,
    /// The job.
    pub job: JobId,
    /// Frame number.
    pub frame: u32,
    /// Units in it that are not done.
    pub units: u64,
    /// Seconds since it was given.
    pub seconds: f64,
}

/// All workers of the farm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorkerList {
    /// The workers, oldest first.
    pub workers: Vec<WorkerView>,
}

/// The farm as a whole, and how it was over the last hour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FarmView {
    /// Version of the coordinator.
    pub version: String,
    /// Units waiting for a worker now.
    pub units_pending: u64,
    /// Units that workers hold now.
    pub units_leased: u64,
    /// Jobs by state.
    pub jobs: std::collections::BTreeMap<String, u64>,
    /// Workers by state.
    pub workers: std::collections::BTreeMap<String, u64>,
    /// Every few seconds, oldest first; begins anew when the coordinator does.
    pub history: Vec<FarmMoment>,
}

/// The farm at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FarmMoment {
    /// Seconds since 1970.
    pub at: f64,
    /// Units waiting for a worker.
    pub units_pending: u64,
    /// Units that workers hold.
    pub units_leased: u64,
    /// Samples per second of all workers.
    pub samples_per_second: f64,
    /// Share of the present workers' threads whose worker holds a lease, 0 to 1; 0 without workers.
    pub busy: f64,
}

/// A file that was stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stored {
    /// Its name from now on.
    pub hash: AssetHash,
    /// Bytes.
    pub size: u64,
}

/// A scene that comes with the coordinator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShippedScene {
    /// Its name in the API: `cornell-box`.
    pub id: String,
    /// Its name for people.
    pub name: String,
    /// What it shows.
    pub description: String,
    /// Frame size, pixels.
    pub resolution: [u32; 2],
    /// What it asks for.
    pub quality: Quality,
    /// What to submit: `{"scene": {"asset": ...}}`.
    pub scene: AssetHash,
}

/// The scenes that come with the coordinator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShippedScenes {
    /// The scenes, by name.
    pub scenes: Vec<ShippedScene>,
}

/// The tiles of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TileList {
    /// The tiles in index order.
    pub tiles: Vec<TileView>,
}

/// `PATCH /jobs/{id}`: changes to a job.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JobPatch {
    /// New priority.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub priority: Option<u8>,
    /// A finer target; every sample taken is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    /// Name for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_has_one_spelling() {
        let id = UnitId { job: JobId(3), frame: 1, tile: 12, pass: 0, rect: Rect { x: 64, y: 0, w: 64, h: 32 } };
        assert_eq!(id.to_string(), "j3.f1.t12.p0.x64.y0.w64.h32");
        assert_eq!(id.to_string().parse(), Ok(id));
        for bad in
            ["", "j3", "j3.f1.t12.p0.x64.y0.w64.h32.z1", "j3.f1.t12.p0.x64.y0.w64.h-2", "j3.f+1.t12.p0.x6.y0.w6.h2"]
        {
            assert!(bad.parse::<UnitId>().is_err(), "{bad}");
        }
    }
}
