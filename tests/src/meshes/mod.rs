//! The meshes in scenes/meshes: made here, kept there.
//!
//! `cargo run --release -p tessera-tests --example generate-meshes` writes them; a test holds the kept files
//! to what these functions give. Sines and exponentials are libm's, so the bytes are the same everywhere.

pub mod bench;

use std::f64::consts::TAU;

use glam::DVec3;

/// Every mesh: its path in scenes/, and the bytes of its file.
#[must_use]
pub fn all() -> Vec<(&'static str, Vec<u8>)> {
    vec![("meshes/torus-knot.ply", torus_knot()), ("meshes/shell.ply", shell())]
}

/// A (2, 3) torus knot: a round tube of 12,288 triangles about a closed curve.
#[must_use]
pub fn torus_knot() -> Vec<u8> {
    const ALONG: u32 = 512;
    const AROUND: u32 = 12;
    const TUBE: f64 = 0.22;
    let curve = |s: f64| {
        let (sin2, cos2) = libm::sincos(2.0 * s);
        let (sin3, cos3) = libm::sincos(3.0 * s);
        let radius = 1.0 + 0.45 * cos3;
        DVec3::new(radius * cos2, radius * sin2, 0.45 * sin3)
    };
    let mut positions = Vec::new();
    for i in 0..ALONG {
        let s = TAU * f64::from(i) / f64::from(ALONG);
        let step = TAU / f64::from(ALONG);
        let centre = curve(s);
        let tangent = (curve(s + step) - curve(s - step)).normalize();
        // Away from the torus's core: never along the tangent, and the same after a full turn.
        let (sin2, cos2) = libm::sincos(2.0 * s);
        let outward = centre - DVec3::new(cos2, sin2, 0.0);
        let normal = (outward - tangent * outward.dot(tangent)).normalize();
        let binormal = tangent.cross(normal);
        for j in 0..AROUND {
            let (sin, cos) = libm::sincos(TAU * f64::from(j) / f64::from(AROUND));
            positions.push(centre + (normal * cos + binormal * sin) * TUBE);
        }
    }
    ply(&positions, &grid(ALONG, AROUND, true))
}

/// A snail's shell: 98,304 triangles along a logarithmic spiral, ribbed in both directions.
#[must_use]
pub fn shell() -> Vec<u8> {
    const ALONG: u32 = 384;
    const AROUND: u32 = 128;
    const TURNS: f64 = 6.0;
    /// Size gained with every turn.
    const GROWTH: f64 = 1.75;
    let mut positions = Vec::new();
    for i in 0..=ALONG {
        let turn = TURNS * f64::from(i) / f64::from(ALONG);
        // 1 at the mouth.
        let size = libm::pow(GROWTH, turn - TURNS);
        let (sin, cos) = libm::sincos(TAU * turn);
        let outward = DVec3::new(cos, 0.0, sin);
        let centre = outward * (0.52 * size) + DVec3::Y * (1.55 * (1.0 - size));
        let rib = 1.0 + 0.035 * libm::cos(TAU * 14.0 * turn) * size.sqrt();
        for j in 0..AROUND {
            let angle = TAU * f64::from(j) / f64::from(AROUND);
            let (sin, cos) = libm::sincos(angle);
            let groove = 1.0 + 0.018 * libm::cos(16.0 * angle);
            let section = outward * (0.50 * cos) + DVec3::Y * (0.62 * sin);
            positions.push(centre + section * (size * rib * groove));
        }
    }
    ply(&positions, &grid(ALONG, AROUND, false))
}

/// Two triangles for each cell of a grid of vertices that closes around and, if asked, along. Their front is to
/// the side of around x along.
fn grid(along: u32, around: u32, closed: bool) -> Vec<[u32; 3]> {
    let rows = if closed { along } else { along + 1 };
    let vertex = |i: u32, j: u32| (i % rows) * around + j % around;
    let cells = (0..along).flat_map(|i| (0..around).map(move |j| (i, j)));
    cells
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1));
            [[a, c, b], [a, d, c]]
        })
        .collect()
}

/// Binary PLY with 16-bit indices: at most 65,536 vertices.
fn ply(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<u8> {
    assert!(positions.len() <= 1 << 16, "indices have 16 bits");
    let mut bytes = ply_header(positions.len(), triangles.len(), "ushort").into_bytes();
    for position in positions {
        bytes.extend(position.to_array().iter().flat_map(|c| (*c as f32).to_le_bytes()));
    }
    for triangle in triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|index| (*index as u16).to_le_bytes()));
    }
    bytes
}

fn ply_header(vertices: usize, faces: usize, index: &str) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment made by tessera-tests, example generate-meshes\n\
         element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar {index} vertex_indices\nend_header\n"
    )
}
