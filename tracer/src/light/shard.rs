//! A triangle that shines, one of many, ready to be sampled for many points at once.

use super::{LampSample, with_choice};
use crate::math::{DVec3, Rgb, Vec2, Vec3, gamma, select};

/// The triangle, chosen among the lights; points are uniform over its area. Its samples have the bits of
/// [`super::Lights::for_each`].
#[derive(Debug, Clone, Copy)]
pub struct Shard {
    /// Corners.
    pub p: [Vec3; 3],
    /// Whether its back shines too.
    pub two_sided: bool,
    /// Radiance.
    pub radiance: Rgb,
    /// Probability with which it was chosen.
    pub chosen: f32,
}

impl Shard {
    /// The point that `u` chooses for the reference point `p`. Without branches, so that loops over it become vector code.
    #[inline(always)]
    #[must_use]
    pub fn sample(&self, p: Vec3, u: Vec2) -> LampSample {
        let [a, b, c] = self.p;
        let along = triangle_coordinates(u);
        let (along_b, along_c) = ((b - a) * along.x, (c - a) * along.y);
        let point = a + along_b + along_c;
        let origin = a.as_dvec3();
        // As long as twice the area.
        let facing = (b.as_dvec3() - origin).cross(c.as_dvec3() - origin);
        let (from, to) = (p.as_dvec3(), point.as_dvec3() - p.as_dvec3());
        let distance2 = to.length_squared();
        let distance = distance2.sqrt();
        let wi = (to / distance).as_vec3();
        let shadow = (0.5 * facing.dot(origin - from)).abs();
        let density = distance2 * distance / shadow;
        let density = select(density < f64::from(f32::MAX), density, f64::from(f32::MAX)) as f32;
        let pdf = select(shadow > 0.0, density, 0.0);
        let inverse = 1.0 / facing.length();
        let sized = (inverse > 0.0) & (inverse < f64::INFINITY);
        let ng = DVec3::new(
            select(sized, facing.x * inverse, 0.0),
            select(sized, facing.y * inverse, 0.0),
            select(sized, facing.z * inverse, 0.0),
        );
        let useful = (pdf > 0.0) & wi.x.is_finite() & wi.y.is_finite() & wi.z.is_finite();
        LampSample {
            wi,
            point,
            point_error: gamma(6) * (a.abs() + along_b.abs() + along_c.abs()),
            ng: ng.as_vec3(),
            radiance: self.radiance,
            pdf: with_choice(self.chosen, pdf),
            valid: useful & (self.two_sided | (facing.dot(from - origin) > 0.0)),
            precise: true,
        }
    }
}

/// Uniform barycentrics (b1, b2): the square folded at its diagonal (Heitz 2019), which keeps neighbours
/// together better than a square root. Without branches.
#[inline(always)]
pub(super) fn triangle_coordinates(u: Vec2) -> Vec2 {
    let below = u.x < u.y;
    let (b1, b2) = (0.5 * u.x, 0.5 * u.y);
    Vec2::new(select(below, b1, u.x - b2), select(below, u.y - b1, b2))
}
