//! Directions aimed at what sends light on without scattering it: mirrors and smooth glass.
//!
//! Light that reaches a diffuse surface by way of a mirror is met only by a ray that happens to leave for the part of the mirror
//! in which the lamp is seen. Where such parts are known ([`Targets`]), a share of all directions is drawn uniformly within the
//! cones that spheres around them subtend, the rest from the BSDF; the density is that of the whole mixture (the one-sample
//! model with the balance heuristic: Veach and Guibas 1995, section 5.2), so that no choice of targets biases anything, and no sample
//! counts for more than 1 / (1 - [`SHARE`]) times what it would have. That directions are drawn by where light was seen to come
//! from is the idea of Jensen's projection maps (1996) and of his importance driven path tracing (1995).

use crate::math::{Frame, INV_PI, ONE_MINUS_EPSILON, Vec2, Vec3, select, select3, sin_cos_turns};

/// Most targets of a vertex.
pub const MOST: usize = 3;
/// Share of directions that is aimed where every target is seen.
pub const SHARE: f32 = 0.15;
/// Square of the sine of the narrowest half angle: in a cone narrower than a thousandth of a radian, rounding of directions shows.
const NARROWEST: f32 = 1e-6;

/// A sphere to aim at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Centre.
    pub center: Vec3,
    /// Radius.
    pub radius: f32,
    /// Share of all directions; 0 where there is no target.
    pub share: f32,
}

impl Target {
    /// None.
    pub const NONE: Self = Self { center: Vec3::ZERO, radius: 0.0, share: 0.0 };
}

/// What a vertex aims at.
pub type Targets = [Target; MOST];

/// Directions within a target's sphere, as a vertex sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Unit vector to the centre.
    pub axis: Vec3,
    /// Square of the distance from the axis' end to that of a unit vector along the edge: 2 (1 - cos). Neither it nor a direction's
    /// own distance is spoilt by cancellation, as cosines would be.
    pub reach2: f32,
    /// Share of all directions; 0 where the vertex does not aim there.
    pub share: f32,
    /// That share over the solid angle.
    pub density: f32,
}

impl Cone {
    /// The cone of `target` from `p`, where a surface scatters to the side of the unit vector `n`; no share from within the sphere, of
    /// spheres whose centre is below the surface, and where `n` is 0. Without branches, so that loops over it become vector code.
    #[inline(always)]
    #[must_use]
    pub fn seen_from(target: &Target, p: Vec3, n: Vec3) -> Self {
        let to = target.center - p;
        let distance2 = to.length_squared();
        let sin2 = target.radius * target.radius / distance2;
        let seen = (sin2 < 0.98) & (sin2 > NARROWEST) & (to.dot(n) > 0.0);
        let sin2 = select(seen, sin2, 0.5);
        let reach2 = 2.0 * sin2 / (1.0 + (1.0 - sin2).sqrt());
        let share = select(seen, target.share, 0.0);
        // The solid angle is pi reach2.
        let density = share * INV_PI / reach2;
        Self { axis: to * (1.0 / distance2.sqrt()), reach2, share, density }
    }
}

/// All that a vertex aims at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cones(pub [Cone; MOST]);

impl Cones {
    /// Those of `targets` from `p`, see [`Cone::seen_from`].
    #[inline(always)]
    #[must_use]
    pub fn seen_from(targets: &Targets, p: Vec3, n: Vec3) -> Self {
        Self(targets.map(|target| Cone::seen_from(&target, p, n)))
    }

    /// Share of directions that is left to the BSDF.
    #[inline(always)]
    #[must_use]
    pub fn rest(&self) -> f32 {
        1.0 - self.aimed()
    }

    #[inline(always)]
    fn aimed(&self) -> f32 {
        self.0[0].share + self.0[1].share + self.0[2].share
    }

    /// Density of the unit vector `wi` among all directions, `pdf` among those of the BSDF.
    #[inline(always)]
    #[must_use]
    pub fn density(&self, wi: Vec3, pdf: f32) -> f32 {
        let mut density = self.rest() * pdf;
        for cone in &self.0 {
            let within = (wi - cone.axis).length_squared() <= cone.reach2;
            density += select(within, cone.density, 0.0);
        }
        density
    }

    /// The direction that `u` chooses, if it is an aimed one; and numbers for the BSDF if not.
    #[inline(always)]
    #[must_use]
    pub fn choose(&self, u: Vec2) -> (bool, Vec3, Vec2) {
        // Parts of the unit square, side by side: each keeps points as evenly spread as they were.
        let (mut low, mut aimed) = (0.0, false);
        let (mut x, mut reach2, mut axis) = (0.0, 0.0, Vec3::Z);
        for cone in &self.0 {
            let this = (u.x >= low) & (u.x < low + cone.share);
            x = select(this, (u.x - low) / cone.share, x);
            reach2 = select(this, cone.reach2, reach2);
            axis = select3(this, cone.axis, axis);
            aimed |= this;
            low += cone.share;
        }
        // 1 - cos.
        let rise = 0.5 * (x * reach2);
        let (sin, cos) = ((rise * (2.0 - rise)).sqrt(), 1.0 - rise);
        let (sin_turn, cos_turn) = sin_cos_turns(u.y);
        let frame = Frame::from_normal(axis);
        let direction = (frame.t * cos_turn + frame.b * sin_turn) * sin + axis * cos;
        let left = (u.x - low) / (1.0 - low);
        let left = select(left > 0.0, left, 0.0);
        (aimed, direction, Vec2::new(select(left < ONE_MINUS_EPSILON, left, ONE_MINUS_EPSILON), u.y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        math::cosine_hemisphere,
        testing::{ChiSquare, Directions, Rng, chi_square},
    };

    fn targets(share: f32, spheres: [([f32; 3], f32); MOST]) -> Targets {
        spheres.map(|(center, radius)| Target { center: center.into(), radius, share })
    }

    #[test]
    fn directions_fall_where_the_mixture_says() {
        let overlapping = [([0.0, 1.0, 2.0], 0.8), ([0.3, 1.0, 2.0], 0.5), ([-2.0, 0.0, 2.0], 0.1)];
        let at_the_horizon = [([3.0, 0.0, 0.4], 1.0), ([0.0, 0.0, 0.5], 0.8), ([-1.0, 0.0, 1.0], 0.4)];
        let unseen = [([1.0, 1.0, -0.1], 0.5), ([9.0, 0.0, 9.0], 1e-3), ([0.0, -1.0, 1.0], 0.4)];
        let cases = [
            ("overlapping cones", overlapping, 0.4),
            ("one is cut by the horizon, one around the vertex", at_the_horizon, 0.6),
            ("one is below, one too small", unseen, 0.8),
        ];
        for (name, spheres, rest) in cases {
            let targets = targets(0.2, spheres);
            let cones = Cones::seen_from(&targets, Vec3::ZERO, Vec3::Z);
            assert!((cones.rest() - rest).abs() < 1e-6, "{name}: {}", cones.rest());
            let density = |wi: Vec3| cones.density(wi, wi.z.max(0.0) * INV_PI);
            chi_square(
                ChiSquare {
                    name,
                    directions: Directions::about(Vec3::Z, 1.0),
                    // More would show how coarsely expected counts are integrated where a cone's edge cuts a cell.
                    samples: 60_000,
                    comparisons: 3,
                    agreement: 1e-6,
                },
                |rng| {
                    let (aimed, direction, u) = cones.choose(rng.next_2d());
                    let wi = if aimed { direction } else { cosine_hemisphere(u) };
                    assert!((wi.length() - 1.0).abs() < 1e-6);
                    Some((wi, density(wi)))
                },
                density,
            );
        }
    }

    #[test]
    fn narrow_cones_hold_what_is_drawn_in_them() {
        let mut rng = Rng::new(1);
        for radius in [0.9f32, 0.1, 0.01, 1.1e-3] {
            let mut targets = [Target::NONE; MOST];
            targets[1] = Target { center: Vec3::new(0.3, -0.7, 0.648_074_1), radius, share: 0.5 };
            let cones = Cones::seen_from(&targets, Vec3::ZERO, Vec3::Z);
            let (mut aimed, mut outside) = (0, 0);
            for _ in 0..20_000 {
                let (is_aimed, wi, _) = cones.choose(rng.next_2d());
                aimed += i32::from(is_aimed);
                outside += i32::from(is_aimed && cones.density(wi, 0.0) == 0.0);
            }
            assert!((aimed - 10_000).abs() < 400 && outside < aimed / 1000, "{radius}: {outside} of {aimed}");
            // The measure of directions is kept: 2 pi (1 - cos) in f64.
            let expected = std::f64::consts::TAU * (1.0 - (1.0 - f64::from(radius).powi(2)).sqrt());
            let found = f64::from(cones.0[1].share / cones.0[1].density);
            assert!((found / expected - 1.0).abs() < 1e-4, "{radius}: {found} {expected}");
        }
    }

    #[test]
    fn without_targets_nothing_changes() {
        let cones = Cones::seen_from(&[Target::NONE; MOST], Vec3::ONE, Vec3::Z);
        let mut rng = Rng::new(2);
        for _ in 0..1000 {
            let u = rng.next_2d();
            let (aimed, _, left) = cones.choose(u);
            assert_eq!((aimed, left, cones.density(Vec3::Z, u.x)), (false, u, u.x));
        }
    }
}
