//! Watertight ray/triangle test.
//!
//! Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (JCGT 2013): corners are moved to
//! the ray's origin and sheared so that the ray runs along one axis; three edge functions then say on
//! which side of the origin each projected edge passes. A corner's projection depends on the corner and
//! the ray alone, so triangles that share an edge agree about it and no ray slips between them.
//!
//! Two things differ from the paper:
//! - Whatever the `f32` edge functions do not reject is decided anew in `f64`, where the products of two
//!   `f32` are exact. In `f32` they are only a filter: rounding is monotone, so they can be zero or
//!   overflow, but never have the wrong sign. The parameter is a weighted mean with nearly exact weights,
//!   so slivers and triangles of any size give the same answer as fat ones.
//! - The parameter is held against a bound of its error, as in Pharr, Jakob and Humphreys, "Physically
//!   Based Rendering", 4th edition, 6.8.7, but only where the triangle reaches behind the origin:
//!   elsewhere it is positive whatever its error, and refusing it would open a hole. That bound grows with the
//!   whole triangle (1e-5 of its size for rays at a slant), so what it cannot decide is not refused either: it
//!   is computed again in `f64` from the corners themselves, whose bound is 1e-15 of the size. A surface met
//!   at a hair's breadth is then told from the surface that a ray leaves.

use glam::Vec3;

use super::{
    Ray,
    offset::gamma,
    simd::{Isa, Lanes, Row},
};

/// Half the distance between 1 and the next `f32`.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;

/// A ray as the triangle and box tests want it. Axes are permuted so that the last one, z, is where the
/// direction is largest.
#[derive(Clone, Copy, Debug)]
pub struct RayFrame {
    /// World axis of each permuted axis.
    pub(super) axes: [usize; 3],
    /// Origin, permuted.
    pub(super) origin: [f32; 3],
    /// Direction, permuted; components that are not normal numbers are zero.
    pub(super) direction: [f32; 3],
    /// Reciprocals of the direction, permuted; infinite where it is zero.
    pub(super) reciprocal: [f32; 3],
    /// x and y moved by each step along z.
    pub(super) shear: [f32; 2],
}

/// What a triangle answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Ray parameter.
    pub t: f32,
    /// Weight of the second corner.
    pub b1: f32,
    /// Weight of the third corner.
    pub b2: f32,
}

impl RayFrame {
    /// None for a ray that can hit nothing: a direction of zero, or anything not finite.
    #[inline(always)]
    #[must_use]
    pub fn new(ray: &Ray) -> Option<Self> {
        let flush = |x: f32| if x.abs() < f32::MIN_POSITIVE { 0.0f32.copysign(x) } else { x };
        let o = ray.origin.to_array();
        let d = ray.direction.to_array().map(flush);
        let a = d.map(f32::abs);
        // The largest of three, without branches: nothing can be foretold of a scattered ray.
        let y_first = usize::from(a[0] <= a[1]);
        let larger = if a[0] > a[1] { a[0] } else { a[1] };
        let kz = if larger > a[2] { y_first } else { 2 };
        // A sum is not finite as soon as one of its terms is not.
        let sum = (a[0] + a[1] + a[2]) * 0.0 + (o[0] * 0.0 + o[1] * 0.0 + o[2] * 0.0);
        // x follows z, y follows x. Rows of four, so that no index needs a check.
        static AXES: [[u8; 4]; 4] = [[1, 2, 0, 0], [2, 0, 1, 0], [0, 1, 2, 0], [0, 1, 2, 0]];
        let [kx, ky, ..] = AXES[kz & 3];
        let axes = [usize::from(kx & 3), usize::from(ky & 3), kz & 3];
        let (o, d) = ([o[0], o[1], o[2], 0.0], [d[0], d[1], d[2], 0.0]);
        let direction = [d[axes[0]], d[axes[1]], d[axes[2]]];
        if sum != 0.0 || direction[2] == 0.0 {
            return None;
        }
        Some(Self {
            axes,
            origin: [o[axes[0]], o[axes[1]], o[axes[2]]],
            direction,
            reciprocal: [1.0 / direction[0], 1.0 / direction[1], 1.0 / direction[2]],
            shear: [direction[0] / direction[2], direction[1] / direction[2]],
        })
    }

    /// Where the ray meets a triangle, with `0 < t`; both sides count. This is the reference: every
    /// other path must give these bits.
    #[inline]
    #[must_use]
    pub fn intersect(&self, corners: [[f32; 3]; 3]) -> Option<TriangleHit> {
        let [kx, ky, kz] = self.axes;
        let [ox, oy, oz] = self.origin;
        let [sx, sy] = self.shear;
        let z = corners.map(|p| p[kz] - oz);
        let x = std::array::from_fn(|i| (corners[i][kx] - ox) - sx * z[i]);
        let y = std::array::from_fn(|i| (corners[i][ky] - oy) - sy * z[i]);
        self.decide(x, y, z, || corners)
    }

    /// The exact part, on sheared `x`, `y` and moved `z`; `corners` are the ones they came from.
    #[inline(always)]
    pub(super) fn decide(
        &self,
        x: [f32; 3],
        y: [f32; 3],
        z: [f32; 3],
        corners: impl FnOnce() -> [[f32; 3]; 3],
    ) -> Option<TriangleHit> {
        let [x, y, z] = [x, y, z].map(|v| v.map(f64::from));
        // Products are exact, so each sign is that of the exact value.
        let e0 = x[1] * y[2] - y[1] * x[2];
        let e1 = x[2] * y[0] - y[2] * x[0];
        let e2 = x[0] * y[1] - y[0] * x[1];
        if min3([e0, e1, e2]) < 0.0 && max3([e0, e1, e2]) > 0.0 {
            return None;
        }
        let det = e0 + e1 + e2;
        // Seen edge-on, or not a number.
        let size = det.abs();
        if !(size > 0.0 && size < f64::INFINITY) {
            return None;
        }
        let dz = f64::from(self.direction[2]);
        // The depth along z, times the determinant.
        let depth = e0 * z[0] + e1 * z[1] + e2 * z[2];
        let mut t = (depth / (det * dz)) as f32;
        let (z_min, z_max) = (min3(z), max3(z));
        let ahead = if dz > 0.0 { z_min > 0.0 } else { z_max < 0.0 };
        if !ahead && depth.abs() <= self.depth_error(x, y, z_min, z_max, size) {
            t = self.exact_parameter(corners())?;
        }
        if t.is_nan() || t <= 0.0 {
            return None;
        }
        let inverse = 1.0 / det;
        Some(TriangleHit { t, b1: (e1 * inverse) as f32, b2: (e2 * inverse) as f32 })
    }

    /// Bound of the error of the hit's depth times the determinant: corners are known to within the
    /// rounding of moving and shearing them; the rest of the sum is exact by comparison.
    #[inline(always)]
    fn depth_error(&self, x: [f64; 3], y: [f64; 3], z_min: f64, z_max: f64, det: f64) -> f64 {
        let largest = |v: [f64; 3]| max3(v.map(f64::abs));
        let (mx, my, mz) = (largest(x), largest(y), max2(z_max, -z_min));
        const G: f64 = gamma(5);
        let dx = G * (mx + f64::from(self.shear[0]).abs() * mz);
        let dy = G * (my + f64::from(self.shear[1]).abs() * mz);
        let edge = 2.0 * (dx * my + dy * mx + dx * dy);
        3.0 * edge * (z_max - z_min) + 2.0 * UNIT * mz * det
    }

    #[inline(never)]
    fn exact_parameter(&self, corners: [[f32; 3]; 3]) -> Option<f32> {
        let permuted = corners.map(|p| self.axes.map(|k| p[k]));
        let (t, certain) = exact_parameter(permuted, self.origin, self.direction.map(f64::from));
        certain.then_some(t)
    }
}

/// The parameter at which a ray meets the plane of a triangle, in `f64`, and whether its sign is certain. The
/// corners are exact; every difference, product and sum below is rounded once. Without branches, so that loops
/// over it become vector code.
#[inline(always)]
pub(super) fn exact_parameter(corners: [[f32; 3]; 3], origin: [f32; 3], direction: [f64; 3]) -> (f32, bool) {
    let [a, b, c] = corners;
    // An `f32` is exact in `f64`.
    let minus = |a: [f32; 3], b: [f32; 3]| {
        [f64::from(a[0]) - f64::from(b[0]), f64::from(a[1]) - f64::from(b[1]), f64::from(a[2]) - f64::from(b[2])]
    };
    let (u, v, to) = (minus(b, a), minus(c, a), minus(a, origin));
    // The normal, and what its coordinates were made of: written out, for loops within loops stay scalar.
    let (px, qx) = (u[1] * v[2], u[2] * v[1]);
    let (py, qy) = (u[2] * v[0], u[0] * v[2]);
    let (pz, qz) = (u[0] * v[1], u[1] * v[0]);
    let (nx, ny, nz) = (px - qx, py - qy, pz - qz);
    let (mx, my, mz) = (px.abs() + qx.abs(), py.abs() + qy.abs(), pz.abs() + qz.abs());
    let offset = nx * to[0] + ny * to[1] + nz * to[2];
    let speed = nx * direction[0] + ny * direction[1] + nz * direction[2];
    let offset_size = mx * to[0].abs() + my * to[1].abs() + mz * to[2].abs();
    let speed_size = mx * direction[0].abs() + my * direction[1].abs() + mz * direction[2].abs();
    // Three roundings before a product, two of products, one of a difference, three of a sum: with room.
    const ERROR: f64 = 8.0 * f64::EPSILON;
    let certain = (offset.abs() > ERROR * offset_size) & (speed.abs() > ERROR * speed_size);
    ((offset / speed) as f32, certain)
}

// One instruction each, unlike `f64::min` and `f64::max`, which look after NaN.
#[inline(always)]
fn min2(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}
#[inline(always)]
fn max2(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
#[inline(always)]
fn min3(v: [f64; 3]) -> f64 {
    min2(min2(v[0], v[1]), v[2])
}
#[inline(always)]
fn max3(v: [f64; 3]) -> f64 {
    max2(max2(v[0], v[1]), v[2])
}

/// Up to eight triangles, a row for each coordinate of each corner: x, y, z of the first, second, third.
/// Unused lanes repeat the first triangle.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Pack {
    pub rows: [Row; 9],
    /// Numbers of the triangles within their tree; above the first one's, how many lanes are not used.
    ids: [u32; 8],
}

/// Bits of a triangle's number within its tree.
pub(super) const ID_BITS: u32 = 27;

impl Pack {
    /// Of rows, and the numbers of one to eight triangles.
    pub fn new(rows: [Row; 9], numbers: impl ExactSizeIterator<Item = u32>) -> Self {
        let mut ids = [0; 8];
        let unused = 8 - numbers.len() as u32;
        for (id, number) in ids.iter_mut().zip(numbers) {
            debug_assert!(number >> ID_BITS == 0);
            *id = number;
        }
        ids[0] |= unused << ID_BITS;
        Self { rows, ids }
    }

    /// The number of a lane's triangle.
    #[inline(always)]
    pub fn id(&self, lane: usize) -> u32 {
        self.ids[lane & 7] & ((1 << ID_BITS) - 1)
    }

    /// The lanes in use, a bit for each.
    #[inline(always)]
    fn lanes(&self) -> u32 {
        0xff >> (self.ids[0] >> ID_BITS)
    }

    /// Everything in it, as bits.
    #[cfg(test)]
    pub fn bits(&self) -> impl Iterator<Item = u32> {
        self.rows.iter().flat_map(|row| row.0.map(f32::to_bits)).chain(self.ids)
    }

    /// The corners of one triangle.
    #[inline(always)]
    pub fn corners(&self, lane: usize) -> [[f32; 3]; 3] {
        let at = |row: usize| self.rows[row].0[lane & 7];
        [[at(0), at(1), at(2)], [at(3), at(4), at(5)], [at(6), at(7), at(8)]]
    }
}

/// A ray's constants in every lane.
#[derive(Clone, Copy)]
pub(super) struct WideFrame<I: Isa> {
    ox: I::F,
    oy: I::F,
    oz: I::F,
    sx: I::F,
    sy: I::F,
    rz: I::F,
    /// Magnitude of the direction's z.
    dz: I::F,
}

impl<I: Isa> WideFrame<I> {
    #[inline(always)]
    pub fn new(isa: I, f: &RayFrame) -> Self {
        Self {
            ox: isa.splat(f.origin[0]),
            oy: isa.splat(f.origin[1]),
            oz: isa.splat(f.origin[2]),
            sx: isa.splat(f.shear[0]),
            sy: isa.splat(f.shear[1]),
            rz: isa.splat(f.reciprocal[2]),
            dz: isa.splat(f.direction[2].abs()),
        }
    }

    /// The lanes that [`RayFrame::intersect`] might accept with `t <= t_far`, and those that it surely
    /// accepts with `t < t_far` (a subset). `t_far` is the end of the ray, too large by
    /// up to 32 units in the last place. `moved` receives what [`RayFrame::decide`] wants to know.
    #[inline(always)]
    pub fn candidates(
        &self,
        isa: I,
        f: &RayFrame,
        pack: &Pack,
        t_far: I::F,
        any: bool,
        moved: &mut [I::F; 9],
    ) -> (u32, u32) {
        let [kx, ky, kz] = f.axes;
        // SAFETY: the axes are a permutation of 0..3, so every row is below 9.
        let row = |corner: usize, axis: usize| isa.load(unsafe { pack.rows.get_unchecked(3 * corner + axis) });
        let (z0, z1, z2) = (row(0, kz).sub(self.oz), row(1, kz).sub(self.oz), row(2, kz).sub(self.oz));
        let x0 = row(0, kx).sub(self.ox).sub(self.sx.mul(z0));
        let x1 = row(1, kx).sub(self.ox).sub(self.sx.mul(z1));
        let x2 = row(2, kx).sub(self.ox).sub(self.sx.mul(z2));
        let y0 = row(0, ky).sub(self.oy).sub(self.sy.mul(z0));
        let y1 = row(1, ky).sub(self.oy).sub(self.sy.mul(z1));
        let y2 = row(2, ky).sub(self.oy).sub(self.sy.mul(z2));
        let e0 = x1.mul(y2).sub(y1.mul(x2));
        let e1 = x2.mul(y0).sub(y2.mul(x0));
        let e2 = x0.mul(y1).sub(y0.mul(x1));
        let (lo, hi) = (e0.min(e1).min(e2), e0.max(e1).max(e2));
        let zero = isa.splat(0.0);
        // Rejected only by signs that are certain; a NaN is kept for `intersect` to look at.
        let (t0, t1, t2) = (z0.mul(self.rz), z1.mul(self.rz), z2.mul(self.rz));
        let (t_lo, t_hi) = (t0.min(t1).min(t2), t0.max(t1).max(t2));
        let mut maybe = !(lo.lt_and_gt(zero, hi) | t_hi.lt(zero) | t_far.lt(t_lo)) & 0xff;
        if maybe == 0 {
            return (0, 0);
        }
        maybe &= pack.lanes();
        let mut sure = 0;
        let mut inside = 0;
        if any {
            // Both signs certain, no overflow, and all of the triangle well inside the ray's span.
            inside = zero.lt(lo) & hi.lt(isa.splat(1e30)) | hi.lt(zero) & isa.splat(-1e30).lt(lo);
            let shrunk = t_far.mul(isa.splat(1.0 - 64.0 * f32::EPSILON));
            sure = maybe & inside & isa.splat(1e-30).lt(t_lo) & t_hi.lt(shrunk);
            if sure != 0 {
                return (maybe, sure);
            }
        }
        // One triangle that is all ahead is soon decided. Of others, which walls of a room are, most prove to be
        // missed, behind the origin or beyond the end; `f32` is enough to see it.
        if any || maybe & maybe.wrapping_sub(1) != 0 || maybe & t_lo.le(zero) != 0 {
            let greatest = |a: I::F, b: I::F, c: I::F| a.abs().max(b.abs()).max(c.abs());
            let (mx, my) = (greatest(x0, x1, x2), greatest(y0, y1, y2));
            let mt = t_hi.max(zero.sub(t_lo));
            // What moving and shearing the corners did counts only for triangles that reach behind the origin, as in
            // `decide`.
            let mz = mt.mul(self.dz).where_le(t_lo, zero);
            let unit = mx.add(mz).mul(my.add(mz)).mul(isa.splat(SIFT)).add(isa.splat(1e-30));
            let error = unit.mul(mt).add(isa.splat(1e-35));
            let error_far = unit.mul(mt.add(t_far)).add(isa.splat(1e-35));
            let det = e0.add(e1.add(e2));
            let depth = e0.mul(t0).add(e1.mul(t1).add(e2.mul(t2)));
            let beyond = depth.sub(t_far.mul(det)).times_sign_of(det);
            let depth = depth.times_sign_of(det);
            let certain = unit.lt(det.abs()) & error.lt(isa.splat(1e30));
            let behind = depth.add(error).lt(zero);
            maybe &= !(certain & (behind | error_far.lt(beyond)));
            if maybe == 0 {
                return (0, 0);
            }
            if any {
                let slack = error_far.add(t_far.mul(det.abs()).mul(isa.splat(64.0 * f32::EPSILON)));
                sure = maybe & certain & inside & error.lt(depth) & beyond.add(slack).lt(zero);
                if sure != 0 {
                    return (maybe, sure);
                }
            }
        }
        *moved = [x0, x1, x2, y0, y1, y2, z0, z1, z2];
        (maybe, sure)
    }
}

/// What bounds the error of the `f32` sums that tell whether a triangle is missed, relative to the product of the
/// greatest coordinates: some 21 for the edge functions' own roundings, 66 for those of the corners
/// ([`RayFrame::depth_error`]), and room.
const SIFT: f32 = 128.0 * f32::EPSILON;

/// Whether a triangle can be hit at all: finite corners that are not in a line.
#[must_use]
pub fn is_usable(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners;
    if !(a.is_finite() && b.is_finite() && c.is_finite()) {
        return false;
    }
    let (u, v) = (b.as_dvec3() - a.as_dvec3(), c.as_dvec3() - a.as_dvec3());
    u.cross(v) != glam::DVec3::ZERO
}
