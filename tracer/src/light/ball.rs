//! A sphere that shines, ready to be sampled for many points at once.

use super::{LampSample, sphere_cone::SphereCone, with_choice};
use crate::math::{Rgb, Vec2, Vec3, gamma};

/// The sphere, chosen among the lights. Its samples have the bits of [`super::Lights::for_each`].
#[derive(Debug, Clone, Copy)]
pub struct Ball {
    /// Centre.
    pub center: Vec3,
    /// Number of the emitter.
    pub emitter: u32,
    /// Radius.
    pub radius: f32,
    /// Whether it shines inwards too.
    pub two_sided: bool,
    /// Radiance.
    pub radiance: Rgb,
    /// Probability with which it was chosen.
    pub chosen: f32,
}

impl Ball {
    /// The point that `u` chooses for the reference point `p`; not precise from inside, and next to the surface. Without
    /// branches, so that loops over it become vector code.
    #[inline(always)]
    #[must_use]
    pub fn sample(&self, p: Vec3, u: Vec2) -> LampSample {
        let (cone, precise) = SphereCone::seen_from(self.center, self.radius, p);
        let (wi, ng) = cone.sample(u);
        let offset = ng * self.radius;
        let pdf = cone.pdf();
        let useful = (pdf > 0.0) & wi.x.is_finite() & wi.y.is_finite() & wi.z.is_finite();
        // From where the cone is precise the outside is seen.
        let faces = self.two_sided | (ng.dot(wi) < 0.0);
        LampSample {
            wi,
            point: self.center + offset,
            point_error: gamma(6) * (self.center.abs() + offset.abs()),
            ng,
            radiance: self.radiance,
            pdf: with_choice(self.chosen, pdf),
            valid: useful & faces,
            precise,
        }
    }
}
