//! Directions uniform over the cone that a sphere subtends.

use std::f64::consts::PI;

use crate::math::{DVec3, Frame, Vec2, Vec3, gamma, select, sin_cos_turns};

/// A sphere as seen from a reference point outside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphereCone {
    /// From the reference point to the centre.
    axis: DVec3,
    distance: f64,
    /// Cosine of the cone's half angle.
    cos_edge: f64,
    /// 1 - `cos_edge`. As a difference it would vanish at 1e-8 of a radian.
    height: f64,
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
        let cos_edge = ((distance2 - radius2) / distance2).sqrt();
        let cone = Self { axis, distance: distance2.sqrt(), cos_edge, height: radius2 / distance2 / (1.0 + cos_edge) };
        (cone, distance2 > inside * inside)
    }

    /// Density of directions uniform over it, at most the largest finite one.
    #[inline(always)]
    pub(super) fn pdf(&self) -> f32 {
        let pdf = 1.0 / self.solid_angle();
        select(pdf < f64::from(f32::MAX), pdf, f64::from(f32::MAX)) as f32
    }

    /// Solid angle, 0 to 2 pi.
    #[inline(always)]
    pub(super) fn solid_angle(&self) -> f64 {
        2.0 * PI * self.height
    }

    /// The direction that `u` chooses, and the unit normal of the sphere at the point there.
    #[inline(always)]
    pub(super) fn sample(&self, u: Vec2) -> (Vec3, Vec3) {
        let x = f64::from(u.x);
        // 1 - cos of the angle at the reference point.
        let rise = x * self.height;
        let (sin, cos) = ((rise * (2.0 - rise)).sqrt(), 1.0 - rise);
        // Sine of the angle between the direction and the normal, by the law of sines: radius and distance
        // cancel, so that it is as precise for a far sphere as for a near one.
        let sin_2 = x * (2.0 - rise) / (1.0 + self.cos_edge);
        let sin_2 = select(sin_2 < 1.0, sin_2, 1.0);
        let (sin_normal, cos_normal) = (sin_2.sqrt(), (1.0 - sin_2).sqrt());
        // The angle at the centre is the difference of the two.
        let cos_center = cos_normal * cos + sin_normal * sin;
        let sin_center = sin_normal * cos - cos_normal * sin;
        let frame = Frame::from_normal((-self.axis / self.distance).as_vec3());
        let (sin_turn, cos_turn) = sin_cos_turns(u.y);
        let across = frame.t * cos_turn + frame.b * sin_turn;
        let wi = across * sin as f32 - frame.n * cos as f32;
        (wi, across * sin_center as f32 + frame.n * cos_center as f32)
    }
}
