//! Cones of directions: where the surfaces of a group of lights face.

use crate::math::{DVec3, Vec3, acos, atan2, sin_cos};

/// Directions within `spread` radians of `axis`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cone {
    /// Unit vector.
    pub(super) axis: Vec3,
    /// Half angle, 0 to pi.
    pub(super) spread: f32,
}

impl Cone {
    /// All directions.
    pub(super) const FULL: Self = Self { axis: Vec3::Z, spread: std::f32::consts::PI };

    /// The smallest cone that holds both.
    pub(super) fn union(self, other: Self) -> Self {
        let (wide, narrow) = if self.spread >= other.spread { (self, other) } else { (other, self) };
        let cross = wide.axis.as_dvec3().cross(narrow.axis.as_dvec3());
        let between = atan2(cross.length() as f32, wide.axis.dot(narrow.axis));
        if (between + narrow.spread).min(std::f32::consts::PI) <= wide.spread {
            return wide;
        }
        let spread = 0.5 * (wide.spread + between + narrow.spread);
        let Some(pivot) = cross.try_normalize().filter(|_| spread < std::f32::consts::PI) else { return Self::FULL };
        // Turn the wide cone's axis towards the narrow one's (Rodrigues; the pivot is square to the axis).
        let (sin, cos) = sin_cos(spread - wide.spread);
        let axis: DVec3 = wide.axis.as_dvec3();
        let axis = axis * f64::from(cos) + pivot.cross(axis) * f64::from(sin);
        Self { axis: axis.normalize().as_vec3(), spread }
    }

    /// Measure of the directions that surfaces facing within the cone shine into, weighted by cosine
    /// beyond it (Conty Estevez and Kulla 2018, equation 1, with light up to a right angle off a normal).
    pub(super) fn measure(self) -> f32 {
        use std::f32::consts::{FRAC_PI_2, PI, TAU};
        let reach = (self.spread + FRAC_PI_2).min(PI);
        let (sin, cos) = sin_cos(self.spread);
        let (_, cos_beyond) = sin_cos(self.spread - 2.0 * reach);
        TAU * (1.0 - cos) + FRAC_PI_2 * (2.0 * reach * sin - cos_beyond - 2.0 * self.spread * sin + cos)
    }

    /// A cone from the cosine of its half angle.
    pub(super) fn from_cosine(axis: Vec3, cos: f32) -> Self {
        Self { axis, spread: acos(cos) }
    }
}
