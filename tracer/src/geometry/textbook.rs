//! The forms that textbooks print, kept beside ours so that a chart can show where they fail. Only the
//! charts, their tests, and `--triangle moeller-trumbore` use them.

use glam::Vec3;

use super::{
    Bounds, Ray,
    simd::{Isa, Lanes},
    triangle::{Pack, TriangleHit},
};

/// Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection" (1997), in `f32`, without
/// its constant epsilon. Each triangle computes its own weights, so two triangles can both refuse a ray
/// that passes through the edge they share.
#[inline]
#[must_use]
pub fn moeller_trumbore(origin: [f32; 3], direction: [f32; 3], corners: [[f32; 3]; 3]) -> Option<TriangleHit> {
    let sub = |a: [f32; 3], b: [f32; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross =
        |a: [f32; 3], b: [f32; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let [a, b, c] = corners;
    let (u, v) = (sub(b, a), sub(c, a));
    let p = cross(direction, v);
    let inverse = 1.0 / dot(u, p);
    let s = sub(origin, a);
    let b1 = dot(s, p) * inverse;
    if !(0.0..=1.0).contains(&b1) {
        return None;
    }
    let q = cross(s, u);
    let b2 = dot(direction, q) * inverse;
    if !(b2 >= 0.0 && b1 + b2 <= 1.0) {
        return None;
    }
    let t = dot(v, q) * inverse;
    (t > 0.0 && t < f32::INFINITY).then_some(TriangleHit { t, b1, b2 })
}

/// The lanes of a pack that [`moeller_trumbore`] accepts: the same operations, eight at a time.
#[inline(always)]
pub(super) fn moeller_trumbore_lanes<I: Isa>(isa: I, origin: [f32; 3], direction: [f32; 3], pack: &Pack) -> u32 {
    type V<F> = [F; 3];
    #[inline(always)]
    fn sub<F: Lanes>(a: V<F>, b: V<F>) -> V<F> {
        [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
    }
    #[inline(always)]
    fn dot<F: Lanes>(a: V<F>, b: V<F>) -> F {
        a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
    }
    #[inline(always)]
    fn cross<F: Lanes>(a: V<F>, b: V<F>) -> V<F> {
        [a[1].mul(b[2]).sub(a[2].mul(b[1])), a[2].mul(b[0]).sub(a[0].mul(b[2])), a[0].mul(b[1]).sub(a[1].mul(b[0]))]
    }
    let at = |corner: usize| {
        let r = |axis: usize| isa.load(&pack.rows[3 * corner + axis]);
        [r(0), r(1), r(2)]
    };
    let o = [isa.splat(origin[0]), isa.splat(origin[1]), isa.splat(origin[2])];
    let d = [isa.splat(direction[0]), isa.splat(direction[1]), isa.splat(direction[2])];
    let (zero, one) = (isa.splat(0.0), isa.splat(1.0));
    let a = at(0);
    let (u, v) = (sub(at(1), a), sub(at(2), a));
    let p = cross(d, v);
    let inverse = one.div(dot(u, p));
    let s = sub(o, a);
    let b1 = dot(s, p).mul(inverse);
    let q = cross(s, u);
    let b2 = dot(d, q).mul(inverse);
    let inside = zero.le(b1) & b1.le(one) & zero.le(b2) & b1.add(b2).le(one);
    if inside == 0 {
        return 0;
    }
    let t = dot(v, q).mul(inverse);
    inside & zero.lt(t) & t.lt(isa.splat(f32::INFINITY))
}

/// The slab test of Kay and Kajiya as usually written: where the ray is inside a box, if it is. With a
/// direction component of zero and an origin on that slab's plane, 0 times infinity is NaN, and what
/// a comparison makes of it depends on its order.
#[must_use]
pub fn slab_test(bounds: &Bounds, ray: &Ray) -> Option<(f32, f32)> {
    let (mut near, mut far) = (0.0f32, ray.t_max);
    for axis in 0..3 {
        let inverse = 1.0 / ray.direction[axis];
        let mut t0 = (bounds.lo[axis] - ray.origin[axis]) * inverse;
        let mut t1 = (bounds.hi[axis] - ray.origin[axis]) * inverse;
        if t0 > t1 {
            std::mem::swap(&mut t0, &mut t1);
        }
        // As in C: the second operand unless the comparison holds.
        near = if near > t0 { near } else { t0 };
        far = if far < t1 { far } else { t1 };
    }
    (near <= far).then_some((near, far))
}

/// A ray that starts a constant distance along its direction: too far in a small scene (light leaks), not
/// far enough in a large one or away from the origin (a surface shadows itself).
#[must_use]
pub fn spawn(p: Vec3, direction: Vec3, epsilon: f32) -> Ray {
    Ray::new(p + direction * epsilon, direction)
}
