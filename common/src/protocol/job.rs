//! What the coordinator tells people of jobs, and what they may change.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::UnitId;
use crate::{
    hash::AssetHash,
    job::{JobId, JobState, LeaseId, Quality, WorkerId},
    method::Method,
    plan::MethodPlan,
    tile::Rect,
};

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

/// How an attempt at a unit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Its result counts.
    Done,
    /// Its result came after another's: the unit had been given to two workers, or was handed in twice.
    Late,
    /// The worker could not render it, or handed in a bad result.
    Failed,
    /// It was not done in many times the predicted time.
    Hung,
    /// Its worker fell silent.
    Lost,
    /// It was handed back unrendered, and nobody is to blame.
    Returned,
}

impl Outcome {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Done, Self::Late, Self::Failed, Self::Hung, Self::Lost, Self::Returned];

    /// Its name in the API.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Late => "late",
            Self::Failed => "failed",
            Self::Hung => "hung",
            Self::Lost => "lost",
            Self::Returned => "returned",
        }
    }
}

impl std::str::FromStr for Outcome {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|outcome| outcome.name() == text)
            .ok_or_else(|| format!("\"{text}\" is not one of {}", Self::ALL.map(Self::name).join(", ")))
    }
}

/// One attempt at a unit: who had it, for how long, and what came of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AttemptView {
    /// When it ended, RFC 3339.
    pub at: String,
    /// The unit.
    pub unit: UnitId,
    /// The lease it was given under.
    pub lease: LeaseId,
    /// Who had it; absent where the lease was no longer known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worker: Option<WorkerId>,
    /// What came of it.
    pub outcome: Outcome,
    /// Seconds from the lease to the end; its other units count in. Absent where the lease was no longer known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Processor seconds, as the worker measured them; 0 where there is no result.
    pub cpu_seconds: f64,
    /// Samples taken.
    pub samples: u64,
    /// Why it came to nothing, one sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

/// A page of attempts at a job's units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AttemptList {
    /// The attempts, newest first.
    pub attempts: Vec<AttemptView>,
    /// Give this as `cursor` for the next page; absent on the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
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
    #[schemars(range(max = 100))]
    pub priority: Option<u8>,
    /// A finer target; every sample taken is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    /// Name for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}
