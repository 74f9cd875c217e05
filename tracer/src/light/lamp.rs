//! A rectangle that is the only light of a scene, ready to be sampled for many points at once.

use super::{Emitter, spherical_rectangle::Plane, with_choice};
use crate::math::{Rgb, Vec2, Vec3, gamma};

/// The lamp. Its samples have the bits of [`super::Lights::for_each`].
#[derive(Debug, Clone, Copy)]
pub struct Lamp {
    plane: Plane,
    corner: Vec3,
    edge_u: Vec3,
    edge_v: Vec3,
    ng: Vec3,
    radiance: Rgb,
    two_sided: bool,
    emitter: u32,
}

/// A point on the lamp.
#[derive(Debug, Clone, Copy)]
pub struct LampSample {
    /// Unit vector towards the point.
    pub wi: Vec3,
    /// The point.
    pub point: Vec3,
    /// Bound of its error.
    pub point_error: Vec3,
    /// Unit normal of the lamp's front.
    pub ng: Vec3,
    /// Radiance.
    pub radiance: Rgb,
    /// Density per solid angle.
    pub pdf: f32,
    /// Whether it brings light at all.
    pub valid: bool,
    /// Whether the solid angle could be told precisely; if not, the point must be chosen by area instead.
    pub precise: bool,
}

impl Lamp {
    /// Emitter number `number`; `None` for one that is no rectangle.
    pub(super) fn new(number: u32, emitter: &Emitter, radiance: Rgb, two_sided: bool) -> Option<Self> {
        let Emitter::Rectangle { corner, edge_u, edge_v } = *emitter else { return None };
        let plane = Plane::new(corner, edge_u, edge_v);
        Some(Self { plane, corner, edge_u, edge_v, ng: plane.unit_normal(), radiance, two_sided, emitter: number })
    }

    /// Its number among the emitters.
    #[must_use]
    pub fn emitter(&self) -> u32 {
        self.emitter
    }

    /// Square of the longest side.
    #[must_use]
    pub fn size2(&self) -> f32 {
        self.edge_u.length_squared().max(self.edge_v.length_squared())
    }

    /// The point that `u` chooses for the reference point `p`. Without branches, so that loops over it
    /// become vector code.
    #[inline(always)]
    #[must_use]
    pub fn sample(&self, p: Vec3, u: Vec2) -> LampSample {
        let (seen, precise) = self.plane.seen_from(p);
        let c = seen.sample(u);
        let (along_u, along_v) = (self.edge_u * c.x, self.edge_v * c.y);
        let point = self.corner + along_u + along_v;
        let to = point.as_dvec3() - p.as_dvec3();
        let wi = (to / to.length()).as_vec3();
        let pdf = 1.0 / seen.solid_angle();
        let useful = (pdf > 0.0) & wi.x.is_finite() & wi.y.is_finite() & wi.z.is_finite();
        LampSample {
            wi,
            point,
            point_error: gamma(6) * (self.corner.abs() + along_u.abs() + along_v.abs()),
            ng: self.ng,
            radiance: self.radiance,
            pdf: with_choice(1.0, pdf),
            valid: (self.two_sided | self.plane.faces(p)) & (useful | !precise),
            precise,
        }
    }
}
