//! Tests of the whole: what no single file can show.

mod builds;
mod equality;
mod instances;
mod leaks;
mod offsets;
mod quadrics;
mod slabs;

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::*;

/// A small generator, so that every test has the same rays each time (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f32 {
        (2.0 * self.unit() - 1.0) as f32
    }

    pub fn cube(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let z = 1.0 - 2.0 * self.unit();
        let a = std::f64::consts::TAU * self.unit();
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * a.cos(), r * a.sin(), z)
    }
}

/// A closed sphere of radius 1, `20 * 4^level` triangles.
pub fn icosphere(level: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = [
        [-1., g, 0.],
        [1., g, 0.],
        [-1., -g, 0.],
        [1., -g, 0.],
        [0., -1., g],
        [0., 1., g],
        [0., -1., -g],
        [0., 1., -g],
        [g, 0., -1.],
        [g, 0., 1.],
        [-g, 0., -1.],
        [-g, 0., 1.],
    ];
    let mut positions: Vec<DVec3> = corners.iter().map(|&c| DVec3::from_array(c).normalize()).collect();
    let mut triangles: Vec<[u32; 3]> = [
        "0 11 5", "0 5 1", "0 1 7", "0 7 10", "0 10 11", "1 5 9", "5 11 4", "11 10 2", "10 7 6", "7 1 8", "3 9 4",
        "3 4 2", "3 2 6", "3 6 8", "3 8 9", "4 9 5", "2 4 11", "6 2 10", "8 6 7", "9 8 1",
    ]
    .iter()
    .map(|t| {
        let k: Vec<u32> = t.split(' ').map(|k| k.parse().unwrap()).collect();
        [k[0], k[1], k[2]]
    })
    .collect();
    for _ in 0..level {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut finer = Vec::with_capacity(triangles.len() * 4);
        for t in &triangles {
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push((positions[a as usize] + positions[b as usize]).normalize());
                    positions.len() as u32 - 1
                })
            };
            let (a, b, c) = (middle(t[0], t[1]), middle(t[1], t[2]), middle(t[2], t[0]));
            finer.extend([[t[0], a, c], [t[1], b, a], [t[2], c, b], [a, b, c]]);
        }
        triangles = finer;
    }
    (positions, triangles)
}

/// The icosphere with each corner moved in and out, so that no edge lies in a plane of symmetry.
pub fn bumpy_sphere(level: u32, at: DVec3) -> TriangleMesh {
    let mut random = Random(17);
    let (positions, triangles) = icosphere(level);
    let move_it = |p: DVec3, by: f64| (p * (1.0 + 0.05 * by) + at).as_vec3();
    TriangleMesh { positions: positions.into_iter().map(|p| move_it(p, random.unit())).collect(), triangles }
}

pub fn world_of(mesh: TriangleMesh) -> World {
    World { shapes: vec![Shape::Mesh(mesh)], ..World::default() }
}

pub fn accel_for(world: World, instructions: InstructionSet) -> Accel {
    Accel::build_with(world, Options { instructions, ..Options::default() })
}

/// The instruction sets of this processor.
pub fn all_instructions() -> Vec<InstructionSet> {
    use InstructionSet::*;
    [Avx512, Avx2, Sse2, Portable].into_iter().filter(|i| i.is_available()).collect()
}

pub fn closest(accel: &Accel, ray: &Ray) -> Option<Hit> {
    accel.closest(ray, &mut Counters::default())
}

pub fn occluded(accel: &Accel, ray: &Ray) -> bool {
    accel.occluded(ray, &mut Counters::default())
}

/// A hit as bits: equal only where everything is.
pub fn bits(hit: Option<Hit>) -> Option<[u32; 6]> {
    hit.map(|h| [h.t.to_bits(), h.instance, h.shape, h.primitive, h.b1.to_bits(), h.b2.to_bits()])
}
