//! The nouns that two sides of the farm speak: scene, mesh, method, job, tile, pass, film, protocol.
//!
//! Everything here is pure: values in, values out. This crate knows nothing of sockets, files, threads,
//! async runtimes or any clock; CI proves it.

pub mod adaptive;
pub mod film;
pub mod hash;
pub mod job;
pub mod mesh;
pub mod method;
pub mod pass;
pub mod plan;
pub mod protocol;
pub mod result;
pub mod scene;
pub mod tile;

/// Relative luminance of linear Rec. 709 RGB: 0.2126 R + 0.7152 G + 0.0722 B.
#[must_use]
pub fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}
