//! What workers and the coordinator say to each other.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::UnitId;
use crate::{
    hash::AssetHash,
    job::{LeaseId, WorkerId},
    method::Method,
    pass::Work,
    plan::MethodPlan,
};

// ---------------------------------------------------------------- worker -> coordinator

/// `POST /workers`: a worker process starts. Answered by [`Registered`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Register {
    /// Name of the machine, for people.
    #[schemars(length(max = 256))]
    pub machine: String,
    /// Threads it renders with.
    pub threads: u32,
    /// Instruction sets the kernels may use: `avx2`, `sse2`, ...
    #[schemars(length(max = 64), inner(length(max = 256)))]
    pub cpu_features: Vec<String>,
    /// Version of the tracer, [`Lease::tracer`].
    #[schemars(length(max = 256))]
    pub tracer: String,
    /// Drawn once per process start: a restarted worker is a new worker, a repeated request is not.
    #[schemars(length(min = 1, max = 256))]
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
    /// Batches whose points are spread evenly together, a power of two; 1 where each is drawn by itself.
    pub batches_per_set: u32,
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
