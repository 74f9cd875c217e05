//! What the coordinator tells people of workers, files, scenes and the farm as a whole.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    hash::AssetHash,
    job::{JobId, LeaseId, Quality, WorkerId},
};

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
    /// Every few seconds, oldest first; none while the coordinator was away.
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
