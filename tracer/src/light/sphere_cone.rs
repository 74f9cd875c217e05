//! Directions uniform over the cone that a sphere subtends.
//!
//! Differences that may cancel are taken in `f64`; once they are, products and roots of `f32` are as precise as their
//! numbers are stored, and a vector holds twice as many.

use std::f32::consts::PI;

use crate::math::{Frame, Vec2, Vec3, gamma, select, sin_cos_turns};

/// A sphere as seen from a reference point outside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphereCone {
    /// Unit vector from the centre to the reference point.
    axis: Vec3,
    /// 1 / (1 + the cosine of the cone's half angle).
    inverse: f32,
    /// 1 - that cosine. As a difference it would vanish at 1e-4 of a radian.
    height: f32,
}

impl SphereCone {
    /// The sphere seen from `from`; `None` from inside, and from so near that a point of the inside might have
    /// been rounded there.
    #[inline]
    pub(super) fn new(center: Vec3, radius: f32, from: Vec3) -> Option<Self> {
        let (cone, outside) = Self::seen_from(center, radius, from);
        outside.then_some(cone)
    }

    /// The same, and whether that is so. Without branches, so that loops over it become vector code.
    #[inline(always)]
    pub(super) fn seen_from(center: Vec3, radius: f32, from: Vec3) -> (Self, bool) {
        let axis = center.as_dvec3() - from.as_dvec3();
        let distance2 = axis.length_squared();
        let radius2 = f64::from(radius) * f64::from(radius);
        let (x, y, z) = (center.x.abs(), center.y.abs(), center.z.abs());
        let xy = select(x > y, x, y);
        let rounding = f64::from(gamma(8) * (select(xy > z, xy, z) + radius));
        let inside = f64::from(radius) + rounding;
        let (inverse2, outside2) = (1.0 / distance2, distance2 - radius2);
        let cos_edge = ((outside2 * inverse2) as f32).sqrt();
        let inverse = 1.0 / (1.0 + cos_edge);
        let axis = (axis * -inverse2.sqrt()).as_vec3();
        (Self { axis, inverse, height: (radius2 * inverse2) as f32 * inverse }, distance2 > inside * inside)
    }

    /// Density of directions uniform over it, at most the largest finite one.
    #[inline(always)]
    pub(super) fn pdf(&self) -> f32 {
        let pdf = 1.0 / self.solid_angle();
        select(pdf < f32::MAX, pdf, f32::MAX)
    }

    /// Solid angle, 0 to 2 pi.
    #[inline(always)]
    pub(super) fn solid_angle(&self) -> f32 {
        2.0 * PI * self.height
    }

    /// The direction that `u` chooses, and the unit normal of the sphere at the point there.
    #[inline(always)]
    pub(super) fn sample(&self, u: Vec2) -> (Vec3, Vec3) {
        // 1 - cos of the angle at the reference point.
        let rise = u.x * self.height;
        let (sin, cos) = ((rise * (2.0 - rise)).sqrt(), 1.0 - rise);
        // Sine of the angle between the direction and the normal, by the law of sines: radius and distance
        // cancel, so that it is as precise for a far sphere as for a near one.
        let sin_2 = u.x * (2.0 - rise) * self.inverse;
        let sin_2 = select(sin_2 < 1.0, sin_2, 1.0);
        let (sin_normal, cos_normal) = (sin_2.sqrt(), (1.0 - sin_2).sqrt());
        // The angle at the centre is the difference of the two.
        let cos_center = cos_normal * cos + sin_normal * sin;
        let sin_center = sin_normal * cos - cos_normal * sin;
        let frame = Frame::from_normal(self.axis);
        let (sin_turn, cos_turn) = sin_cos_turns(u.y);
        let across = frame.t * cos_turn + frame.b * sin_turn;
        let wi = across * sin - frame.n * cos;
        (wi, across * sin_center + frame.n * cos_center)
    }
}
