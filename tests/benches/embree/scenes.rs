//! What the rays meet: a bumpy sphere seen from within, a hairball, and a box with a knot in it. Made here; no files.

use std::{collections::HashMap, f64::consts::TAU};

use glam::{DVec3, dvec3};
use tracer::geometry::TriangleMesh;

/// Triangles, where they are looked at from, and a light.
pub struct Scene {
    pub name: &'static str,
    pub mesh: TriangleMesh,
    pub eye: DVec3,
    pub target: DVec3,
    /// Angle of view, degrees.
    pub fov: f64,
    /// A corner of a parallelogram and its two edges.
    pub light: [DVec3; 3],
}

pub fn all() -> [fn() -> Scene; 3] {
    [sphere, hairball, cornell]
}

/// Numbers that are the same every time (SplitMix64).
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn direction(&mut self) -> DVec3 {
        let z = 1.0 - 2.0 * self.uniform();
        let (sin, cos) = (TAU * self.uniform()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        dvec3(r * cos, r * sin, z)
    }
}

#[derive(Default)]
struct Builder(TriangleMesh);

impl Builder {
    fn vertex(&mut self, p: DVec3) -> u32 {
        self.0.positions.push(p.as_vec3());
        self.0.positions.len() as u32 - 1
    }

    fn quad(&mut self, corners: [DVec3; 4]) {
        let [a, b, c, d] = corners.map(|p| self.vertex(p));
        self.0.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

/// 1,310,720 triangles: an icosahedron divided eight times, its radius bumpy at six scales.
fn sphere() -> Scene {
    let mut mesh = icosphere(8);
    for p in &mut mesh.positions {
        let v = p.as_dvec3();
        *p = (v * (1.0 + 0.12 * bumps(v))).as_vec3();
    }
    Scene {
        name: "sphere",
        mesh,
        eye: dvec3(0.1, 0.2, 0.5),
        target: dvec3(0.0, -0.1, -1.0),
        fov: 70.0,
        light: [dvec3(-0.15, 0.5, -0.15), dvec3(0.3, 0.0, 0.0), dvec3(0.0, 0.0, 0.3)],
    }
}

fn bumps(p: DVec3) -> f64 {
    let (mut size, mut frequency, mut sum) = (0.5, 3.0, 0.0);
    for octave in 0..6 {
        let phase = 1.7 * f64::from(octave);
        let q = p * frequency;
        sum +=
            size * ((q.x + phase).sin() * (q.y - phase).sin() + (q.z + 0.5 * phase).sin() * (q.x - 2.0 * phase).cos());
        size *= 0.55;
        frequency *= 2.1;
    }
    sum
}

fn icosphere(divisions: u32) -> TriangleMesh {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut mesh = Builder::default();
    // Three golden rectangles at right angles.
    for axis in 0..3 {
        for (long, short) in [(golden, 1.0), (golden, -1.0), (-golden, 1.0), (-golden, -1.0)] {
            let mut p = [0.0; 3];
            p[axis] = long;
            p[(axis + 1) % 3] = short;
            mesh.vertex(DVec3::from_array(p).normalize());
        }
    }
    let mut mesh = mesh.0;
    // Neighbours are nearer than any others; three of them in turn are a face.
    let near = |a: usize, b: usize| mesh.positions[a].distance(mesh.positions[b]) < 1.2;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let [p, q, r] = [a, b, c].map(|k| mesh.positions[k]);
                    let outwards = (q - p).cross(r - p).dot(p) > 0.0;
                    let [b, c] = if outwards { [b, c] } else { [c, b] };
                    mesh.triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    for _ in 0..divisions {
        let mut middles = HashMap::with_capacity(2 * mesh.triangles.len());
        let mut finer = Vec::with_capacity(4 * mesh.triangles.len());
        let positions = &mut mesh.positions;
        for &[a, b, c] in &mesh.triangles {
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let sum = positions[a as usize].as_dvec3() + positions[b as usize].as_dvec3();
                    positions.push(sum.normalize().as_vec3());
                    positions.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        mesh.triangles = finer;
    }
    mesh
}

/// 300,000 long thin triangles: 5,000 curling ribbons of 30 segments.
fn hairball() -> Scene {
    let mut mesh = Builder::default();
    let mut random = Random(7);
    for _ in 0..5000 {
        let mut p = random.direction() * 0.2;
        let mut d = p.normalize();
        let w = d.cross(random.direction()).normalize() * 0.0015;
        let mut last = [mesh.vertex(p + w), mesh.vertex(p - w)];
        for _ in 0..30 {
            d = (d + random.direction() * 0.45 + p.normalize() * 0.05).normalize();
            p += d * 0.035;
            let next = [mesh.vertex(p + w), mesh.vertex(p - w)];
            mesh.0.triangles.extend([[last[0], last[1], next[0]], [last[1], next[1], next[0]]]);
            last = next;
        }
    }
    Scene {
        name: "hairball",
        mesh: mesh.0,
        eye: dvec3(0.3, 0.5, 2.4),
        target: DVec3::ZERO,
        fov: 40.0,
        light: [dvec3(0.6, 1.4, 0.6), dvec3(0.5, 0.0, 0.0), dvec3(0.0, 0.0, 0.5)],
    }
}

/// Five walls of ten triangles, and a (2, 3) torus knot of 70,312.
fn cornell() -> Scene {
    const ALONG: u32 = 374;
    const AROUND: u32 = 94;
    let mut mesh = Builder::default();
    let corner = |x: f64, y: f64, z: f64| dvec3(x, y, z) * 5.0;
    for wall in [
        [[-1., 0., -1.], [1., 0., -1.], [1., 0., 1.], [-1., 0., 1.]],
        [[-1., 2., -1.], [1., 2., -1.], [1., 2., 1.], [-1., 2., 1.]],
        [[-1., 0., -1.], [1., 0., -1.], [1., 2., -1.], [-1., 2., -1.]],
        [[-1., 0., -1.], [-1., 0., 1.], [-1., 2., 1.], [-1., 2., -1.]],
        [[1., 0., -1.], [1., 0., 1.], [1., 2., 1.], [1., 2., -1.]],
    ] {
        mesh.quad(wall.map(|[x, y, z]| corner(x, y, z)));
    }
    let centre = |s: f64| {
        let r = 2.0 + (3.0 * s).cos();
        dvec3(0.27 * r * (2.0 * s).cos(), 0.9 + 0.27 * (3.0 * s).sin(), 0.27 * r * (2.0 * s).sin())
    };
    let first = mesh.0.positions.len() as u32;
    for i in 0..ALONG {
        let s = TAU * f64::from(i) / f64::from(ALONG);
        let along = (centre(s + 1e-4) - centre(s - 1e-4)).normalize();
        let n = along.cross(DVec3::Y).normalize();
        let b = along.cross(n);
        for j in 0..AROUND {
            let a = TAU * f64::from(j) / f64::from(AROUND);
            let r = 0.13 * (1.0 + 0.15 * (8.0 * a).sin() * (40.0 * s).sin());
            mesh.vertex(centre(s) + n * (r * a.cos()) + b * (r * a.sin()));
        }
    }
    for i in 0..ALONG {
        for j in 0..AROUND {
            let at = |i: u32, j: u32| first + i % ALONG * AROUND + j % AROUND;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.0.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Scene {
        name: "cornell with a knot",
        mesh: mesh.0,
        eye: dvec3(0.0, 1.6, 4.6),
        target: dvec3(0.0, 1.2, 0.0),
        fov: 50.0,
        light: [dvec3(-1.0, 9.95, -1.0), dvec3(2.0, 0.0, 0.0), dvec3(0.0, 0.0, 2.0)],
    }
}
