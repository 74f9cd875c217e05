//! Scenes of a few primitives: many rays at once against every one, without a tree.
//!
//! Where there are no more triangles than a ray through a tree would test anyway, testing them all for a
//! whole wave of rays is faster: rays are told apart by their largest axis, [`LANES`] of them are
//! held against one triangle after the other in `f32`, and what that leaves is decided in `f64`, again side by side.
//! The operations are those of [`super::triangle::RayFrame`], so hits have the bits that a tree would have found.

use super::{Counters, Ray, bvh::traverse::Nearest, bvh::traverse::WIDEN, offset::gamma};
use crate::{
    lanes::{Flag, Lane, Lane3, NO, Proven, WIDTH, YES, covering, stage},
    math::{Vec3, select},
};

/// Most triangles that are tested without a tree.
pub(super) const MOST_TRIANGLES: usize = 64;
/// Most spheres and disks.
pub(super) const MOST_OTHERS: usize = 8;
/// Rays held against a triangle at once.
const LANES: usize = 16;
/// Room for three groups of rays, each filled up to a multiple of [`LANES`].
const ROOM: usize = WIDTH + 3 * LANES;
/// Candidates decided at once.
const CANDIDATES: usize = 64;

/// Corners of a triangle, x, y, z of each.
type Corners = [f32; 9];

/// The primitives.
#[derive(Debug)]
pub(super) struct Few {
    /// Of each permutation of the axes, by its last axis, the triangles.
    triangles: [Vec<Corners>; 3],
    /// Their numbers in the tree.
    ids: Vec<u32>,
    /// Numbers of spheres and disks.
    pub others: Vec<u32>,
}

impl Few {
    /// `None` for too many. `triangles` are those that can be hit, with their numbers.
    pub fn new(triangles: Vec<(u32, [[f32; 3]; 3])>, others: Vec<u32>) -> Option<Self> {
        if triangles.len() > MOST_TRIANGLES || others.len() > MOST_OTHERS {
            return None;
        }
        let permuted = |last: usize| {
            let axes = [(last + 1) % 3, (last + 2) % 3, last];
            let corners = |t: &[[f32; 3]; 3]| std::array::from_fn(|i| t[i / 3][axes[i % 3]]);
            triangles.iter().map(|(_, t)| corners(t)).collect()
        };
        Some(Self {
            triangles: std::array::from_fn(permuted),
            ids: triangles.iter().map(|(id, _)| *id).collect(),
            others,
        })
    }
}

/// Room to work in, kept from wave to wave.
#[derive(Debug)]
pub struct FewRays {
    proven: Proven,
    /// Rays by lane: permuted origin and direction, shear, reciprocal of the last, the last axis.
    frame: Frames<WIDTH>,
    axis: Lane<u32>,
    /// The same, grouped by axis; and which lane each was.
    grouped: Frames<ROOM>,
    lane: [u32; ROOM],
    /// One bit for each triangle that may be hit.
    maybe: [[u32; ROOM]; 2],
    /// Whether some triangle is surely hit.
    sure: [Flag; ROOM],
    candidates: Candidates,
}

#[derive(Debug)]
struct Frames<const N: usize> {
    origin: [[f32; N]; 3],
    direction: [[f32; N]; 3],
    shear: [[f32; N]; 2],
    reciprocal: [f32; N],
    t_max: [f32; N],
}

impl<const N: usize> Frames<N> {
    const EMPTY: Self = Self {
        origin: [[0.0; N]; 3],
        direction: [[0.0; N]; 3],
        shear: [[0.0; N]; 2],
        reciprocal: [0.0; N],
        t_max: [0.0; N],
    };
}

/// Pairs of a ray and a triangle.
#[derive(Debug)]
struct Candidates {
    n: usize,
    /// Index of the ray among the grouped ones, and of the triangle.
    ray: [u32; CANDIDATES],
    triangle: [u32; CANDIDATES],
    corners: [[f32; CANDIDATES]; 9],
    origin: [[f32; CANDIDATES]; 3],
    direction: [[f32; CANDIDATES]; 3],
    shear: [[f32; CANDIDATES]; 2],
    hit: [Flag; CANDIDATES],
    t: [f32; CANDIDATES],
    b1: [f32; CANDIDATES],
    b2: [f32; CANDIDATES],
}

impl FewRays {
    pub(crate) fn new(proven: Proven) -> Self {
        Self {
            proven,
            frame: Frames::EMPTY,
            axis: [0; WIDTH],
            grouped: Frames::EMPTY,
            lane: [0; ROOM],
            maybe: [[0; ROOM]; 2],
            sure: [NO; ROOM],
            candidates: Candidates {
                n: 0,
                ray: [0; CANDIDATES],
                triangle: [0; CANDIDATES],
                corners: [[0.0; CANDIDATES]; 9],
                origin: [[0.0; CANDIDATES]; 3],
                direction: [[0.0; CANDIDATES]; 3],
                shear: [[0.0; CANDIDATES]; 2],
                hit: [NO; CANDIDATES],
                t: [0.0; CANDIDATES],
                b1: [0.0; CANDIDATES],
                b2: [0.0; CANDIDATES],
            },
        }
    }

    /// Rays of the first `n` lanes that are `active`, sorted by axis. Of each axis, where its rays begin, and
    /// how many there are.
    fn group(&mut self, few: &Few, rays: &Rays, counters: &mut Counters) -> [(usize, usize); 3] {
        frames(self.proven, self, rays);
        let mut counts = [0usize; 3];
        for i in (0..rays.n).filter(|&i| rays.active[i] == YES) {
            if let Some(count) = counts.get_mut(self.axis[i] as usize) {
                *count += 1;
            }
        }
        let mut groups = [(0, 0); 3];
        let mut next = 0;
        for (group, count) in groups.iter_mut().zip(counts) {
            *group = (next, 0);
            next += count.next_multiple_of(LANES);
        }
        for i in (0..rays.n).filter(|&i| rays.active[i] == YES) {
            let Some((start, count)) = groups.get_mut(self.axis[i] as usize) else { continue };
            let to = (*start + *count) % ROOM;
            *count += 1;
            let (frame, grouped) = (&self.frame, &mut self.grouped);
            for k in 0..3 {
                grouped.origin[k][to] = frame.origin[k][i];
                grouped.direction[k][to] = frame.direction[k][i];
            }
            for k in 0..2 {
                grouped.shear[k][to] = frame.shear[k][i];
            }
            grouped.reciprocal[to] = frame.reciprocal[i];
            grouped.t_max[to] = rays.t_max[i];
            self.lane[to] = i as u32;
        }
        let tested = counts.iter().sum::<usize>() * (few.ids.len() + few.others.len());
        counters.primitive_tests += tested as u64;
        groups
    }

    /// The nearest triangle of each active ray, offered to `nearest`.
    pub(super) fn closest(&mut self, few: &Few, rays: &Rays, nearest: &mut [Nearest; WIDTH], counters: &mut Counters) {
        let groups = self.group(few, rays, counters);
        for (axis, (start, count)) in groups.into_iter().enumerate() {
            if count == 0 || few.ids.is_empty() {
                continue;
            }
            filter(self.proven, self, &few.triangles[axis], start, count);
            self.each_candidate(few, axis, start..start + count, |work, c| {
                let (ray, triangle) = (work.candidates.ray[c] as usize, work.candidates.triangle[c] as usize);
                let Candidates { t, b1, b2, .. } = &work.candidates;
                nearest[work.lane[ray] as usize].offer(0, few.ids[triangle], t[c], b1[c], b2[c]);
            });
        }
    }

    /// Whether each active ray meets a triangle, added to `occluded`.
    pub(super) fn occluded(&mut self, few: &Few, rays: &Rays, occluded: &mut Lane<Flag>, counters: &mut Counters) {
        let groups = self.group(few, rays, counters);
        for (axis, (start, count)) in groups.into_iter().enumerate() {
            if count == 0 || few.ids.is_empty() {
                continue;
            }
            filter_any(self.proven, self, &few.triangles[axis], start, count);
            for i in start..start + count {
                if self.sure[i] == YES {
                    occluded[self.lane[i] as usize] = YES;
                    (self.maybe[0][i], self.maybe[1][i]) = (0, 0);
                }
            }
            self.each_candidate(few, axis, start..start + count, |work, c| {
                let ray = work.candidates.ray[c] as usize;
                if work.candidates.t[c] < work.grouped.t_max[ray] {
                    occluded[work.lane[ray] as usize] = YES;
                }
            });
        }
    }

    /// Decide what the filter has left, and tell of each hit.
    fn each_candidate(
        &mut self,
        few: &Few,
        axis: usize,
        rays: std::ops::Range<usize>,
        mut hit: impl FnMut(&Self, usize),
    ) {
        for ray in rays {
            let mut bits = u64::from(self.maybe[0][ray]) | u64::from(self.maybe[1][ray]) << 32;
            while bits != 0 {
                let triangle = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                self.candidates.add(&self.grouped, ray, &few.triangles[axis][triangle], triangle);
                if self.candidates.n == CANDIDATES {
                    self.decide_all(&mut hit);
                }
            }
        }
        self.decide_all(&mut hit);
    }

    fn decide_all(&mut self, hit: &mut impl FnMut(&Self, usize)) {
        decide(self.proven, &mut self.candidates);
        for c in 0..self.candidates.n {
            if self.candidates.hit[c] == YES {
                hit(self, c);
            }
        }
        self.candidates.n = 0;
    }
}

impl Candidates {
    #[inline(always)]
    fn add(&mut self, rays: &Frames<ROOM>, ray: usize, corners: &Corners, triangle: usize) {
        let n = self.n;
        (self.ray[n], self.triangle[n]) = (ray as u32, triangle as u32);
        for (to, from) in self.corners.iter_mut().zip(corners) {
            to[n] = *from;
        }
        for k in 0..3 {
            self.origin[k][n] = rays.origin[k][ray];
            self.direction[k][n] = rays.direction[k][ray];
        }
        for k in 0..2 {
            self.shear[k][n] = rays.shear[k][ray];
        }
        self.n += 1;
    }
}

/// Rays side by side.
#[derive(Clone, Copy)]
pub(crate) struct Rays<'a> {
    /// Only the first so many lanes.
    pub n: usize,
    /// And of those, only these.
    pub active: &'a Lane<Flag>,
    pub origin: &'a Lane3,
    pub direction: &'a Lane3,
    pub t_max: &'a Lane<f32>,
}

impl Rays<'_> {
    /// How many there are.
    pub fn count(&self) -> u64 {
        self.active[..self.n].iter().map(|&active| u64::from(active)).sum()
    }

    pub fn at(&self, i: usize) -> Ray {
        Ray { origin: self.origin.at(i), direction: self.direction.at(i), t_max: self.t_max[i] }
    }
}

/// The last axis of a ray that can hit nothing.
const NOWHERE: u32 = 3;

stage! {
    /// As `RayFrame::new`.
    fn frames(work: &mut FewRays, rays: &Rays) {
        let (to, axis) = (&mut work.frame, &mut work.axis);
        let Rays { n, origin, direction, .. } = *rays;
        for i in 0..covering(n) {
            let flush = |x: f32| select(x.abs() < f32::MIN_POSITIVE, 0.0f32.copysign(x), x);
            let (o, d) = (origin.at(i), direction.at(i));
            let d = Vec3::new(flush(d.x), flush(d.y), flush(d.z));
            let a = d.abs();
            let x_over_y = a.x > a.y;
            let x_last = x_over_y & (a.x > a.z);
            let y_last = !x_over_y & (a.y > a.z);
            let turned = |v: Vec3| {
                [
                    select(x_last, v.y, select(y_last, v.z, v.x)),
                    select(x_last, v.z, select(y_last, v.x, v.y)),
                    select(x_last, v.x, select(y_last, v.y, v.z)),
                ]
            };
            let sum = (a.x + a.y + a.z) * 0.0 + (o.x * 0.0 + o.y * 0.0 + o.z * 0.0);
            let (o, d) = (turned(o), turned(d));
            let can_hit = (sum == 0.0) & (d[2] != 0.0);
            for k in 0..3 {
                to.origin[k][i] = o[k];
                to.direction[k][i] = d[k];
            }
            to.shear[0][i] = d[0] / d[2];
            to.shear[1][i] = d[1] / d[2];
            to.reciprocal[i] = 1.0 / d[2];
            let last = 2 - 2 * u32::from(x_last) - u32::from(y_last);
            axis[i] = last * u32::from(can_hit) + NOWHERE * u32::from(!can_hit);
        }
    }
}

#[inline(always)]
fn least(a: f32, b: f32, c: f32) -> f32 {
    let ab = select(a < b, a, b);
    select(ab < c, ab, c)
}

#[inline(always)]
fn most(a: f32, b: f32, c: f32) -> f32 {
    let ab = select(a > b, a, b);
    select(ab > c, ab, c)
}

stage! {
    /// What [`held`] leaves of `count` grouped rays from `start` on.
    fn filter(work: &mut FewRays, triangles: &[Corners], start: usize, count: usize) {
        held::<false>(work, triangles, start, count);
    }
}

stage! {
    /// The same, and which rays surely meet something.
    fn filter_any(work: &mut FewRays, triangles: &[Corners], start: usize, count: usize) {
        held::<true>(work, triangles, start, count);
    }
}

/// As `WideFrame::candidates`: the triangles that rays may hit, of `count` grouped rays from `start` on. With
/// `ANY`, also whether a ray surely hits one before its end.
// Loops over lanes of many arrays at once.
#[allow(clippy::needless_range_loop)]
#[inline(always)]
fn held<const ANY: bool>(work: &mut FewRays, triangles: &[Corners], start: usize, count: usize) {
    for block in (start..start + count).step_by(LANES) {
        let mut rays = [[0.0f32; LANES]; 7];
        for l in 0..LANES {
            let i = (block + l) % ROOM;
            let Frames { origin, shear, reciprocal, t_max, .. } = &work.grouped;
            rays[0][l] = origin[0][i];
            rays[1][l] = origin[1][i];
            rays[2][l] = origin[2][i];
            rays[3][l] = shear[0][i];
            rays[4][l] = shear[1][i];
            rays[5][l] = reciprocal[i];
            rays[6][l] = t_max[i] * (1.0 + WIDEN);
        }
        let [ox, oy, oz, sx, sy, rz, t_far] = rays;
        let mut maybe = [[0u32; LANES]; 2];
        let mut sure = [NO; LANES];
        for (half, triangles) in triangles.chunks(32).enumerate().take(2) {
            let mut found = [0u32; LANES];
            for (j, c) in triangles.iter().enumerate() {
                for l in 0..LANES {
                    let z = [c[2] - oz[l], c[5] - oz[l], c[8] - oz[l]];
                    let x =
                        [(c[0] - ox[l]) - sx[l] * z[0], (c[3] - ox[l]) - sx[l] * z[1], (c[6] - ox[l]) - sx[l] * z[2]];
                    let y =
                        [(c[1] - oy[l]) - sy[l] * z[0], (c[4] - oy[l]) - sy[l] * z[1], (c[7] - oy[l]) - sy[l] * z[2]];
                    let e0 = x[1] * y[2] - y[1] * x[2];
                    let e1 = x[2] * y[0] - y[2] * x[0];
                    let e2 = x[0] * y[1] - y[0] * x[1];
                    let (lo, hi) = (least(e0, e1, e2), most(e0, e1, e2));
                    let t = [z[0] * rz[l], z[1] * rz[l], z[2] * rz[l]];
                    let t_hi = most(t[0], t[1], t[2]);
                    // Rejected only by what is certain: a NaN is kept to be decided. Rays that look for the nearest
                    // hit mostly have no end, and what lies beyond it is not taken anyway.
                    let mut out = (lo < 0.0) & (0.0 < hi) | (t_hi < 0.0);
                    if ANY {
                        let t_lo = least(t[0], t[1], t[2]);
                        out |= t_far[l] < t_lo;
                        let inside = (0.0 < lo) & (hi < 1e30) | (hi < 0.0) & (-1e30 < lo);
                        let near = t_far[l] * (1.0 - 64.0 * f32::EPSILON);
                        sure[l] |= Flag::from(!out & inside & (1e-30 < t_lo) & (t_hi < near));
                    }
                    found[l] |= u32::from(!out) << j;
                }
            }
            maybe[half] = found;
        }
        for l in 0..LANES {
            let i = (block + l) % ROOM;
            work.maybe[0][i] = maybe[0][l];
            work.maybe[1][i] = maybe[1][l];
            work.sure[i] = sure[l];
        }
    }
}

const UNIT: f64 = 0.5 * f32::EPSILON as f64;

#[inline(always)]
fn least_f64(v: [f64; 3]) -> f64 {
    let ab = select(v[0] < v[1], v[0], v[1]);
    select(ab < v[2], ab, v[2])
}

#[inline(always)]
fn most_f64(v: [f64; 3]) -> f64 {
    let ab = select(v[0] > v[1], v[0], v[1]);
    select(ab > v[2], ab, v[2])
}

// Not `map`, which compilers do not always see through.
#[inline(always)]
fn wide(v: [f32; 3]) -> [f64; 3] {
    [f64::from(v[0]), f64::from(v[1]), f64::from(v[2])]
}

#[inline(always)]
fn magnitudes(v: [f64; 3]) -> [f64; 3] {
    [v[0].abs(), v[1].abs(), v[2].abs()]
}

stage! {
    /// As `RayFrame::decide`.
    fn decide(c: &mut Candidates) {
        for i in 0..c.n.next_multiple_of(LANES).min(CANDIDATES) {
            let corners = [
                [c.corners[0][i], c.corners[1][i], c.corners[2][i]],
                [c.corners[3][i], c.corners[4][i], c.corners[5][i]],
                [c.corners[6][i], c.corners[7][i], c.corners[8][i]],
            ];
            let [p, q, r] = corners;
            let origin = [c.origin[0][i], c.origin[1][i], c.origin[2][i]];
            let direction =
                [f64::from(c.direction[0][i]), f64::from(c.direction[1][i]), f64::from(c.direction[2][i])];
            let (sx, sy) = (c.shear[0][i], c.shear[1][i]);
            let z = [p[2] - origin[2], q[2] - origin[2], r[2] - origin[2]];
            let x = [(p[0] - origin[0]) - sx * z[0], (q[0] - origin[0]) - sx * z[1], (r[0] - origin[0]) - sx * z[2]];
            let y = [(p[1] - origin[1]) - sy * z[0], (q[1] - origin[1]) - sy * z[1], (r[1] - origin[1]) - sy * z[2]];
            let (x, y, z) = (wide(x), wide(y), wide(z));
            let e0 = x[1] * y[2] - y[1] * x[2];
            let e1 = x[2] * y[0] - y[2] * x[0];
            let e2 = x[0] * y[1] - y[0] * x[1];
            let outside = (least_f64([e0, e1, e2]) < 0.0) & (most_f64([e0, e1, e2]) > 0.0);
            let det = e0 + e1 + e2;
            let size = det.abs();
            let dz = direction[2];
            let depth = e0 * z[0] + e1 * z[1] + e2 * z[2];
            let t = (depth / (det * dz)) as f32;
            let (z_min, z_max) = (least_f64(z), most_f64(z));
            let forward = dz > 0.0;
            let ahead = forward & (z_min > 0.0) | !forward & (z_max < 0.0);
            // As `RayFrame::depth_error`.
            let (mx, my) = (most_f64(magnitudes(x)), most_f64(magnitudes(y)));
            let mz = select(z_max > -z_min, z_max, -z_min);
            const G: f64 = gamma(5);
            let dx = G * (mx + f64::from(sx).abs() * mz);
            let dy = G * (my + f64::from(sy).abs() * mz);
            let edge = 2.0 * (dx * my + dy * mx + dx * dy);
            let error = 3.0 * edge * (z_max - z_min) + 2.0 * UNIT * mz * size;
            let doubtful = !ahead & (depth.abs() <= error);
            let (exact, certain) = super::triangle::exact_parameter(corners, origin, direction);
            let t = select(doubtful, exact, t);
            let hit = !outside & (size > 0.0) & (size < f64::INFINITY) & (t > 0.0) & (!doubtful | certain);
            let inverse = 1.0 / det;
            c.hit[i] = Flag::from(hit);
            c.t[i] = t;
            c.b1[i] = (e1 * inverse) as f32;
            c.b2[i] = (e2 * inverse) as f32;
        }
    }
}
