//! How the farm's tests begin: jobs and workers of which a test names only what it is about.

use common::{hash::AssetHash, job::JobId, protocol::Register, tile::TileGrid};

use super::JobSpec;

/// A job of frames from 1 on, in batches of 16 samples, of middling priority.
pub fn spec(id: u64, frames: u32, grid: TileGrid) -> JobSpec {
    JobSpec {
        id: JobId(id),
        scene: AssetHash::of(&id.to_le_bytes()),
        frames: (1..=frames).collect(),
        grid,
        batch: 16,
        gated: false,
        priority: 50,
        tracer: None,
        prepare: None,
    }
}

/// A worker that says who it is.
pub fn register(nonce: &str, tracer: &str, threads: u32) -> Register {
    Register { machine: "m".into(), threads, cpu_features: Vec::new(), tracer: tracer.into(), nonce: nonce.into() }
}
