//! Scenes of a few primitives: many rays at once against every one, without a tree.
//!
//! Where there are no more triangles than a ray through a tree would test anyway, testing them all for a
//! whole wave of rays is faster. [`LANES`] rays at a time are held against one facet after the other ([`facet`]), in
//! `f32` with a bound of the error: that tells which triangles may be hit before any that surely is. What
//! is left, hardly more than one a ray, is decided in `f64`, again side by side. The operations of that are those of
//! [`super::triangle::RayFrame`], so hits have the bits that a tree would have found.

mod facet;

use super::{Counters, Ray, bvh::traverse::WIDEN, offset::gamma};
use crate::{
    lanes::{Flag, Lane, Lane3, NO, Proven, WIDTH, YES, covering, lanes_of, mask_of, stage},
    math::{Vec3, select},
};
use facet::{Facet, Kept, Masks, Round};

/// Most triangles that are tested without a tree.
pub(super) const MOST_TRIANGLES: usize = 64;
/// Most spheres and disks.
pub(super) const MOST_OTHERS: usize = 8;
/// Rays held against a facet at once.
const LANES: usize = 16;
/// Candidates decided at once.
const CANDIDATES: usize = 64;

/// A bit for each triangle.
pub(crate) type Spared = [u32; 2];

/// Corners of a triangle, x, y, z of each.
type Corners = [f32; 9];

/// The primitives.
#[derive(Debug)]
pub(super) struct Few {
    /// Of each permutation of the axes, by its last axis, the triangles.
    triangles: [Vec<Corners>; 3],
    /// Their numbers in the tree.
    ids: Vec<u32>,
    /// Facets of two triangles and of one, each by the axis that their normal is nearest to.
    facets: [[Vec<Facet>; 3]; 2],
    /// Of each number in the tree, the bits of what rays from there need not be held against.
    spared: Vec<Spared>,
    /// The largest coordinate.
    extent: f32,
    /// Numbers of spheres and disks, and the spheres around them.
    others: Vec<(u32, Round)>,
}

impl Few {
    /// `None` for too many. `triangles` are those that can be hit, with their numbers; `others` spheres and disks,
    /// with a sphere that holds each: centre and radius.
    /// Two triangles of a flat quadrilateral are one facet if `quads`.
    pub fn new(triangles: Vec<(u32, [[f32; 3]; 3])>, others: Vec<(u32, [f32; 4])>, quads: bool) -> Option<Self> {
        if triangles.len() > MOST_TRIANGLES || others.len() > MOST_OTHERS {
            return None;
        }
        let permuted = |last: usize| {
            let axes = [(last + 1) % 3, (last + 2) % 3, last];
            let corners = |t: &[[f32; 3]; 3]| std::array::from_fn(|i| t[i / 3][axes[i % 3]]);
            triangles.iter().map(|(_, t)| corners(t)).collect()
        };
        let corners: Vec<[[f32; 3]; 3]> = triangles.iter().map(|(_, corners)| *corners).collect();
        let extent = corners.as_flattened().as_flattened().iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let facets = facet::of(&corners, extent, quads);
        let places = triangles.iter().map(|(id, _)| *id).chain(others.iter().map(|(id, _)| *id)).max();
        let mut spared = vec![[0; 2]; places.map_or(0, |last| last as usize + 1)];
        for (bits, (id, _)) in facet::spared(&corners, &facets, extent).into_iter().zip(&triangles) {
            spared[*id as usize] = bits;
        }
        Some(Self {
            spared,
            triangles: std::array::from_fn(permuted),
            ids: triangles.iter().map(|(id, _)| *id).collect(),
            facets,
            extent,
            others: others.into_iter().map(|(id, round)| (id, Round::new(round))).collect(),
        })
    }

    /// What a ray that leaves primitive `id` from well within, at no flat angle, need not be held against.
    #[inline(always)]
    pub fn spared(&self, id: u32) -> Spared {
        self.spared.get(id as usize).copied().unwrap_or_default()
    }

    /// The bit in [`Rays::ended`] of primitive `id`, where that is a sphere or disk; else none.
    pub fn round(&self, id: u32) -> u32 {
        self.others.iter().position(|(other, _)| *other == id).map_or(0, |k| 1 << k)
    }

    /// Spheres and disks that lane `i` may hit, by what [`FewRays::closest`] or [`FewRays::occluded`] has found.
    pub fn others<'a>(&'a self, work: &FewRays, i: usize) -> impl Iterator<Item = u32> + use<'a> {
        let mut bits = work.masks.others[i];
        std::iter::from_fn(move || {
            let (id, _) = self.others.get(bits.trailing_zeros() as usize)?;
            bits &= bits - 1;
            Some(*id)
        })
    }
}

impl FewRays {
    /// The first lanes, up to `n`, of active rays that may hit spheres or disks, as of [`FewRays::closest`] or
    /// [`FewRays::occluded`].
    pub(super) fn near_others(&self, rays: &Rays) -> impl Iterator<Item = usize> + use<> {
        let n = rays.n;
        let some: Lane<Flag> = std::array::from_fn(|i| rays.active[i] & Flag::from(self.masks.others[i] != 0));
        lanes_of(mask_of(&some)).take_while(move |&i| i < n)
    }
}

/// No primitive.
pub(super) const NOTHING: u32 = u32::MAX;

/// The nearest hit of each ray.
#[derive(Debug)]
pub struct Found {
    pub t: Lane<f32>,
    /// Number of the primitive, or [`NOTHING`].
    pub(super) id: Lane<u32>,
    pub b1: Lane<f32>,
    pub b2: Lane<f32>,
}

impl Found {
    pub const NOTHING: Self = Self { t: [0.0; WIDTH], id: [NOTHING; WIDTH], b1: [0.0; WIDTH], b2: [0.0; WIDTH] };

    /// Number of the primitive that lane `i` hit.
    #[inline(always)]
    pub fn primitive(&self, i: usize) -> Option<usize> {
        (self.id[i] != NOTHING).then_some(self.id[i] as usize)
    }

    /// As [`super::bvh::traverse::Nearest::offer`].
    #[inline(always)]
    pub(super) fn offer(&mut self, i: usize, id: u32, t: f32, b1: f32, b2: f32) {
        // No hit has the greatest number.
        if t < self.t[i] || t == self.t[i] && id < self.id[i] && self.id[i] != NOTHING {
            (self.t[i], self.id[i], self.b1[i], self.b2[i]) = (t, id, b1, b2);
        }
    }
}

/// Room to work in, kept from wave to wave.
#[derive(Debug)]
pub struct FewRays {
    proven: Proven,
    /// Rays as `RayFrame` has them: permuted origin and direction, shear, and the last axis.
    origin: [Lane<f32>; 3],
    direction: [Lane<f32>; 3],
    shear: [Lane<f32>; 2],
    axis: Lane<u32>,
    kept: Box<Kept>,
    masks: Masks,
    candidates: Candidates,
}

/// Pairs of a ray and a triangle.
#[derive(Debug)]
struct Candidates {
    n: usize,
    /// Lane of the ray, and index of the triangle.
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
    /// The same room, run with these instructions from now on.
    pub(crate) fn run_with(&mut self, proven: Proven) {
        self.proven = proven;
    }

    pub(crate) fn new(proven: Proven) -> Self {
        Self {
            proven,
            origin: [[0.0; WIDTH]; 3],
            direction: [[0.0; WIDTH]; 3],
            shear: [[0.0; WIDTH]; 2],
            axis: [0; WIDTH],
            kept: Box::new(Kept::NONE),
            masks: Masks::NONE,
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

    /// The nearest triangle of each active ray.
    pub(super) fn closest(&mut self, few: &Few, rays: &Rays, found: &mut Found, counters: &mut Counters) {
        counters.primitive_tests += rays.count() * few.ids.len() as u64;
        frames(self.proven, self, rays);
        filter(self.proven, few, rays, &mut self.kept, &mut self.masks);
        found.t[..rays.n].copy_from_slice(&rays.t_max[..rays.n]);
        found.id[..rays.n].fill(NOTHING);
        self.each_candidate(few, rays, |work, c| {
            let (ray, triangle) = (work.candidates.ray[c] as usize, work.candidates.triangle[c] as usize);
            let Candidates { t, b1, b2, .. } = &work.candidates;
            found.offer(ray, few.ids[triangle], t[c], b1[c], b2[c]);
        });
    }

    /// Whether each active ray meets a triangle.
    pub(super) fn occluded(&mut self, few: &Few, rays: &Rays, occluded: &mut Lane<Flag>, counters: &mut Counters) {
        counters.primitive_tests += rays.count() * few.ids.len() as u64;
        frames(self.proven, self, rays);
        filter_any(self.proven, few, rays, &mut self.kept, &mut self.masks);
        for (i, occluded) in occluded.iter_mut().enumerate().take(rays.n) {
            *occluded = self.masks.sure[i] & rays.active[i] & Flag::from(self.axis[i] != NOWHERE);
        }
        self.each_candidate(few, rays, |work, c| {
            let ray = work.candidates.ray[c] as usize;
            if work.candidates.t[c] < rays.t_max[ray] {
                occluded[ray] = YES;
            }
        });
    }

    /// Decide what the filter has left, and tell of each hit.
    #[inline(always)]
    fn each_candidate(&mut self, few: &Few, rays: &Rays, mut hit: impl FnMut(&Self, usize)) {
        let some: Lane<Flag> = std::array::from_fn(|i| {
            let bits = self.masks.triangles[0][i] | self.masks.triangles[1][i];
            rays.active[i] & Flag::from((bits != 0) & (self.axis[i] != NOWHERE))
        });
        for ray in lanes_of(mask_of(&some)).take_while(|&ray| ray < rays.n) {
            let axis = self.axis[ray] as usize;
            let mut bits = u64::from(self.masks.triangles[0][ray]) | u64::from(self.masks.triangles[1][ray]) << 32;
            while bits != 0 {
                let triangle = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                self.add(ray, &few.triangles[axis][triangle], triangle);
                if self.candidates.n == CANDIDATES {
                    self.decide_all(&mut hit);
                }
            }
        }
        if self.candidates.n > 0 {
            self.decide_all(&mut hit);
        }
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

    #[inline(always)]
    fn add(&mut self, ray: usize, corners: &Corners, triangle: usize) {
        let to = &mut self.candidates;
        let n = to.n % CANDIDATES;
        (to.ray[n], to.triangle[n]) = (ray as u32, triangle as u32);
        for (to, from) in to.corners.iter_mut().zip(corners) {
            to[n] = *from;
        }
        for k in 0..3 {
            to.origin[k][n] = self.origin[k][ray];
            to.direction[k][n] = self.direction[k][ray];
        }
        for k in 0..2 {
            to.shear[k][n] = self.shear[k][ray];
        }
        to.n = n + 1;
    }
}

/// No sphere and no disk, of each ray.
pub(crate) const NO_ROUND: &Lane<u32> = &[0; WIDTH];

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
    /// Triangles that each need not be held against, where it is known that it does not hit them.
    pub spared: &'a [Lane<u32>; 2],
    /// The same of spheres and disks.
    pub ended: &'a Lane<u32>,
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
                work.origin[k][i] = o[k];
                work.direction[k][i] = d[k];
            }
            work.shear[0][i] = d[0] / d[2];
            work.shear[1][i] = d[1] / d[2];
            let last = 2 - 2 * u32::from(x_last) - u32::from(y_last);
            work.axis[i] = last * u32::from(can_hit) + NOWHERE * u32::from(!can_hit);
        }
    }
}

stage! {
    /// Of each ray, what may be its nearest hit.
    fn filter(few: &Few, rays: &Rays, kept: &mut Kept, masks: &mut Masks) {
        facet::held::<false>(few, rays, kept, masks);
    }
}

stage! {
    /// Of each ray, what it may hit; and whether it surely hits something.
    fn filter_any(few: &Few, rays: &Rays, kept: &mut Kept, masks: &mut Masks) {
        facet::held::<true>(few, rays, kept, masks);
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
