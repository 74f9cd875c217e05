//! The path tracer: scene in, samples out.
//!
//! Synchronous and deterministic. It knows nothing of HTTP, async runtimes, clocks, entropy, file
//! formats, or how many machines there are. A pixel's samples are a function of the scene, the settings,
//! and the numbers of the samples, and nothing else.

pub mod aim;
pub mod bsdf;
pub mod camera;
pub mod fresnel;
pub mod geometry;
pub mod integrator;
mod lanes;
pub mod light;
pub mod material;
pub mod math;
pub mod microfacet;
pub mod pilot;
pub mod sampler;
pub mod scene;
pub mod special;
#[cfg(test)]
mod testing;
pub mod texture;
pub mod unit;

use std::collections::HashMap;

use common::mesh::{MeshPart, Picture};

pub use unit::{Loaded, Prepared, RowResult, UnitRender};

/// Names the arithmetic of this build: units of two builds with the same version are byte-equal. Bump it
/// with every change that alters an image's bits.
pub const VERSION: &str = concat!("tessera-", env!("CARGO_PKG_VERSION"), "-5");

/// Decoded files of a scene, by the relative path that the scene names them with.
#[derive(Debug, Default)]
pub struct Assets {
    /// Mesh files: their parts.
    pub meshes: HashMap<String, Vec<MeshPart>>,
    /// Pictures.
    pub pictures: HashMap<String, Picture>,
}
