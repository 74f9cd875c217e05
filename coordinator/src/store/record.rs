//! The records of a store, as JSON: what is known of jobs, tiles and workers.

use std::collections::BTreeMap;

use common::{
    hash::AssetHash,
    job::{Frames, JobId, JobState, Quality, WorkerId},
    method::Method,
    plan::{MethodPlan, Trial},
    protocol::{ConvergencePoint, FailureView, Forecast, JobStatistics, Register},
    result::UnitStatistics,
    tile::{Rect, TileGrid},
};
use serde::{Deserialize, Serialize};

use crate::plan::{Rule, budget::Round};

/// A job as it was resolved when it was submitted, and where it is in its life.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobRecord {
    /// Its name in the API.
    pub id: JobId,
    /// Its name for people.
    pub name: String,
    /// The scene file.
    pub scene: AssetHash,
    /// Its frames.
    pub frames: Frames,
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
    /// What a worker must prepare before anything is rendered: the choice of a method.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prepare: Option<Trial>,
    /// What was prepared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<MethodPlan>,
    /// How passes follow from both.
    pub rule: Rule,
    /// 0 (last) to 100 (first).
    pub priority: u8,
    /// Free words.
    pub tags: Vec<String>,
    /// Seed of the sample points.
    pub seed: u64,
    /// Where it is in its life.
    pub state: JobState,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// Version of the tracer it is pinned to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracer: Option<String>,
    /// When it was submitted, RFC 3339.
    pub created_at: String,
    /// When it ended, RFC 3339.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finished_at: Option<String>,
    /// Frames that are done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<Frames>,
    /// Under a budget: the round that each open frame is in.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rounds: BTreeMap<u32, Round>,
    /// When its first lease was given, Unix seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub began: Option<f64>,
    /// When it ended, Unix seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<f64>,
    /// What was forecast of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub forecasts: Vec<Forecast>,
    /// How its error fell.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve: Vec<ConvergencePoint>,
    /// The last attempts at its units that came to nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<FailureView>,
    /// Id of the request that submitted it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<String>,
    /// How it is known when it is submitted once more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub once: Option<Once>,
}

/// Names a submission, so that one that is repeated makes no second job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Once {
    /// The key that the client drew.
    pub key: String,
    /// Hash of the request.
    pub request: AssetHash,
}

impl JobRecord {
    /// The tiles of its frames.
    #[must_use]
    pub fn grid(&self) -> TileGrid {
        TileGrid::new(self.region, self.tile)
    }
}

/// How far a tile is, what it cost, and a summary of its pixels.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TileRecord {
    /// Passes merged.
    pub passes: u32,
    /// Share of its work done, 0 to 1.
    pub share: f64,
    /// Whether the rule said that it is finished.
    #[serde(default)]
    pub finished: bool,
    /// Whether its pixels are judged anew since its last pass: none of them counts as stopped.
    #[serde(default)]
    pub fresh: bool,
    /// Attempts that failed.
    #[serde(default)]
    pub attempts: u32,
    /// Worker of the last result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worker: Option<WorkerId>,
    /// Work and time.
    pub work: WorkRecord,
    /// Its pixels in short.
    pub summary: TileSummary,
}

/// Work and time, summed over results.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct WorkRecord {
    /// Camera samples.
    pub samples: u64,
    /// Rays.
    pub rays: u64,
    /// Bounding-box tests.
    pub node_tests: u64,
    /// Primitive tests.
    pub primitive_tests: u64,
    /// Samples left out for not being finite.
    pub rejected: u64,
    /// Luminance that a clamp took away.
    pub clamped: f64,
    /// Processor seconds.
    pub cpu_seconds: f64,
    /// Seconds to fetch and decode the scene.
    pub load_seconds: f64,
    /// Seconds to build its acceleration structure.
    pub build_seconds: f64,
}

impl WorkRecord {
    /// Add a result's statistics.
    pub fn add(&mut self, s: &UnitStatistics) {
        self.samples += s.samples;
        self.rays += s.rays;
        self.node_tests += s.node_tests;
        self.primitive_tests += s.primitive_tests;
        self.rejected += s.rejected;
        self.clamped += s.clamped;
        self.cpu_seconds += s.cpu_seconds;
        self.load_seconds += s.load_seconds;
        self.build_seconds += s.build_seconds;
    }

    /// Processor seconds of a sample; 0 before the first.
    #[must_use]
    pub fn per_sample(&self) -> f64 {
        if self.samples == 0 { 0.0 } else { self.cpu_seconds / self.samples as f64 }
    }

    /// Add to a job's statistics.
    pub fn add_to(&self, job: &mut JobStatistics) {
        job.rays += self.rays;
        job.node_tests += self.node_tests;
        job.primitive_tests += self.primitive_tests;
        job.rejected += self.rejected;
        job.clamped += self.clamped;
        job.cpu_seconds += self.cpu_seconds;
        job.load_seconds += self.load_seconds;
        job.build_seconds += self.build_seconds;
    }
}

/// A tile's pixels in short.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TileSummary {
    /// Pixels with at least one sample.
    pub pixels: u32,
    /// Sum of the pixels' samples.
    pub samples: u64,
    /// Most samples of a pixel.
    pub max_samples: u32,
    /// Pixels whose interval is within the job's noise target.
    pub within: u32,
    /// Number of pixels by relative half-width of their interval: class k, at least 0, holds those from
    /// 2^((k-480)/32) on, the first also what is smaller. Class 1023 holds those whose interval is not known.
    pub errors: Vec<(u16, u32)>,
}

/// What is remembered of a worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorkerRecord {
    /// What it said of itself.
    pub register: Register,
    /// Units handed in.
    pub units: u64,
    /// Units failed.
    pub failures: u64,
    /// Whether a person disabled it.
    pub disabled: bool,
    /// When it was last written, RFC 3339.
    pub seen_at: String,
}
