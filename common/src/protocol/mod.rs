//! The messages of the farm, a file for each pair of who speaks and who listens. JSON, but for unit results
//! (see [`crate::result`]).

mod farm;
mod job;
mod unit;
mod worker;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::hash::AssetHash;

pub use farm::*;
pub use job::*;
pub use unit::UnitId;
pub use worker::*;

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
