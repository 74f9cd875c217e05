//! The meshes of scenes/bench: too large to keep, made when they are wanted.
//!
//! `cargo run --release -p tessera-tests --example generate-meshes -- bench` writes them.

use std::{collections::BTreeMap, f64::consts::TAU};

use glam::DVec3;

/// Every mesh: its path in scenes/, and the bytes of its file.
#[must_use]
pub fn all() -> Vec<(&'static str, Vec<u8>)> {
    let ball = icosphere(5);
    let parts = |(positions, triangles): (Vec<DVec3>, Vec<[u32; 3]>)| ply(&positions, &triangles);
    vec![
        ("bench/meshes/torus-knot-50k.ply", parts(torus_knot())),
        ("bench/meshes/sphere-20k.ply", ply(&ball.0, &ball.1)),
        ("bench/meshes/displaced-1m3.ply", parts(displaced(icosphere(8)))),
    ]
}

/// A sphere of radius 1 of 20 x 4^`level` triangles, front outside: every edge of the icosahedron halved `level` times.
#[must_use]
pub fn icosphere(level: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let p = (1.0 + 5.0f64.sqrt()) / 2.0;
    let corners = [
        [-1.0, p, 0.0],
        [1.0, p, 0.0],
        [-1.0, -p, 0.0],
        [1.0, -p, 0.0],
        [0.0, -1.0, p],
        [0.0, 1.0, p],
        [0.0, -1.0, -p],
        [0.0, 1.0, -p],
        [p, 0.0, -1.0],
        [p, 0.0, 1.0],
        [-p, 0.0, -1.0],
        [-p, 0.0, 1.0],
    ];
    let mut positions: Vec<DVec3> = corners.map(|c| DVec3::from_array(c).normalize()).to_vec();
    #[rustfmt::skip]
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4],
        [11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8],
        [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
    ];
    for _ in 0..level {
        let edges = |[a, b, c]: [u32; 3]| [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b)));
        // New vertices in the order of their edges.
        let mut middles: BTreeMap<(u32, u32), u32> =
            triangles.iter().flat_map(|&t| edges(t)).map(|edge| (edge, 0)).collect();
        for ((a, b), vertex) in &mut middles {
            *vertex = positions.len() as u32;
            positions.push((positions[*a as usize] + positions[*b as usize]).normalize());
        }
        let cut = |&[a, b, c]: &[u32; 3]| {
            let [ab, bc, ca] = edges([a, b, c]).map(|edge| middles[&edge]);
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        triangles = triangles.iter().flat_map(cut).collect();
    }
    (positions, triangles)
}

/// Waves that displace the sphere, four an octave: direction, and phase.
#[rustfmt::skip]
const WAVES: [[f64; 4]; 24] = [
    [0.3635365676813111, 0.8642994867575062, 0.3476025908263671, 5.960540267916768],
    [0.7918482140228322, 0.39041102059734734, -0.4696335176975643, 2.57107400134529],
    [0.7768565446870102, 0.6267582445143515, 0.06056411404658504, 3.381254158776311],
    [-0.8226902875991798, -0.18198613373554226, -0.5385737997878915, 2.8494112760217813],
    [0.04752830184596732, -0.34993039438246576, -0.9355692275887287, 1.6481633265414255],
    [0.00615381217381068, -0.20829905575636926, 0.978045824062827, 6.162153563995592],
    [-0.8193359383881047, -0.5708755755216803, -0.05281758550401722, 1.7397587449451388],
    [0.09984938673225842, 0.10156879368917397, 0.9898049707481359, 3.9175016711702146],
    [-0.1735546202432566, 0.9388976414256076, 0.2972373003471302, 0.24876938092549292],
    [-0.29634718220320333, -0.9501875070900958, 0.0965507585165991, 4.029583729416905],
    [-0.8725977216876869, -0.48574655202165934, -0.0512201454949852, 5.27713123271619],
    [-0.6941732720145283, 0.6744864890970724, 0.251379085140647, 0.929421561852132],
    [0.5311368831348725, 0.7971927168145042, 0.2870146052584823, 1.2039604632920315],
    [0.5858506343331628, -0.4015144343964135, 0.7039639147163432, 5.373549559144173],
    [0.5907752829630359, -0.012961638249160107, -0.806732025504035, 1.7218968087939561],
    [0.05299980382820608, 0.2672325046196405, -0.9621734818986053, 5.250036224246081],
    [0.35665574900053576, -0.8340773296872925, 0.420846390986762, 5.058308699090638],
    [-0.7966947735513853, 0.12292044870025269, 0.5917499481091956, 5.621665559451513],
    [-0.7145679176343923, 0.662949725194509, 0.22336148493456354, 4.231473267934168],
    [-0.22630106963882998, -0.971384124737222, -0.07211593505476233, 4.149135224403537],
    [0.4269123452594472, 0.10661900365920314, -0.8979856555222903, 5.223053827391882],
    [0.6873885863985852, 0.5287039045091515, -0.49796497130393874, 2.3571180964202516],
    [0.40918988592818106, 0.4301564020783155, 0.8046919329812626, 2.48975089632114],
    [-0.0869075419555751, -0.23722707046616304, 0.9675589884804348, 0.6655227581977521],
];

/// Ridges and deep valleys on a sphere, where light bounces: six octaves of 1 - |sum of four sines|.
fn displaced((mut positions, triangles): (Vec<DVec3>, Vec<[u32; 3]>)) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    for position in &mut positions {
        let (mut height, mut frequency, mut amplitude) = (0.0, 3.0, 0.22);
        for octave in WAVES.chunks_exact(4) {
            let waves = octave.iter().map(|&[x, y, z, phase]| {
                let along = position.dot(DVec3::new(x, y, z) * frequency);
                libm::sin(along + phase)
            });
            height += (1.0 - waves.sum::<f64>().abs() / 2.0) * amplitude;
            frequency *= 1.9;
            amplitude /= 1.7;
        }
        *position *= 1.0 + height.clamp(-0.5, 1.0);
    }
    (positions, triangles)
}

/// A (2, 3) torus knot: a thin round tube of 50,000 triangles about a closed curve, front outside.
fn torus_knot() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    const ALONG: u32 = 500;
    const AROUND: u32 = 50;
    const TUBE: f64 = 0.18;
    let curve = |s: f64| {
        let (sin2, cos2) = libm::sincos(2.0 * s);
        let (sin3, cos3) = libm::sincos(3.0 * s);
        let radius = 2.0 + cos3;
        DVec3::new(radius * cos2, sin3 * 1.5, radius * sin2) / 3.0
    };
    let mut positions = Vec::new();
    for i in 0..ALONG {
        let s = TAU * f64::from(i) / f64::from(ALONG);
        let (before, after) = (curve(s - 1e-4), curve(s + 1e-4));
        let tangent = (after - before).normalize();
        // The place itself is never parallel to the curve.
        let binormal = tangent.cross(after + before).normalize();
        let normal = binormal.cross(tangent);
        for j in 0..AROUND {
            let (sin, cos) = libm::sincos(TAU * f64::from(j) / f64::from(AROUND));
            positions.push(curve(s) + (normal * cos + binormal * sin) * TUBE);
        }
    }
    (positions, super::grid(ALONG, AROUND, true))
}

/// Binary PLY with 32-bit indices.
fn ply(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut bytes = super::ply_header(positions.len(), triangles.len(), "int").into_bytes();
    for position in positions {
        bytes.extend(position.to_array().iter().flat_map(|c| (*c as f32).to_le_bytes()));
    }
    for triangle in triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
    }
    bytes
}
