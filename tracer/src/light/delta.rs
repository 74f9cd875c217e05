//! Lights without a surface: no ray hits them, so only light sampling finds them.

use std::f64::consts::PI;

use crate::math::{Rgb, Vec3};

/// A light without a surface, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DeltaLight {
    /// Shines equally in all directions.
    Point {
        /// Where it is.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// Shines in a cone.
    Spot {
        /// Where it is.
        position: Vec3,
        /// Unit vector along the cone.
        axis: Vec3,
        /// Radiant intensity on the axis, W/sr.
        intensity: Rgb,
        /// Cosine of the angle up to which it is at full strength.
        cos_beam: f32,
        /// Cosine of the angle from which it is dark, below `cos_beam`.
        cos_cutoff: f32,
    },
    /// Shines from infinitely far away.
    Directional {
        /// Unit vector along which light travels.
        direction: Vec3,
        /// Irradiance on a surface that faces it, W/m^2.
        irradiance: Rgb,
    },
}

/// What of a light without a surface arrives at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Unit vector towards the light.
    pub wi: Vec3,
    /// Irradiance on a surface that faces it.
    pub irradiance: Rgb,
    /// Where the light is, and how far away: infinitely for a directional one, whose place is then 0.
    pub position: Vec3,
    /// Its distance.
    pub distance: f32,
}

impl DeltaLight {
    /// The light that a scene file describes; `None` where a direction has no length.
    #[must_use]
    pub fn from_scene(light: &common::scene::Light) -> Option<Self> {
        use common::scene::Light;
        let vector = |v: [f64; 3]| Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32);
        let colour = |c: common::scene::Rgb| vector(c.0);
        let unit = |v: glam::DVec3| v.try_normalize().map(|v| v.as_vec3());
        match light {
            Light::Point(p) => Some(Self::Point { position: vector(p.position), intensity: colour(p.intensity) }),
            Light::Spot(s) => {
                let axis = unit(glam::DVec3::from_array(s.target) - glam::DVec3::from_array(s.position))?;
                let cos_cutoff = libm::cos(s.cutoff_angle.to_radians()) as f32;
                // A beam as wide as the cutoff is a hard edge; the falloff keeps a width for its division.
                let cos_beam = (libm::cos(s.beam_angle.to_radians()) as f32).max(cos_cutoff + 1e-6);
                Some(Self::Spot {
                    position: vector(s.position),
                    axis,
                    intensity: colour(s.intensity),
                    cos_beam,
                    cos_cutoff,
                })
            }
            Light::Directional(d) => Some(Self::Directional {
                direction: unit(glam::DVec3::from_array(d.direction))?,
                irradiance: colour(d.irradiance),
            }),
        }
    }

    /// The light that arrives at `p`, shadows left out; `None` where none does.
    #[inline]
    #[must_use]
    pub fn at(&self, p: Vec3) -> Option<Arrival> {
        match *self {
            Self::Point { position, intensity } => {
                let (wi, distance, per_area) = towards(p, position)?;
                arrival(wi, intensity * per_area, position, distance)
            }
            Self::Spot { position, axis, intensity, cos_beam, cos_cutoff } => {
                let (wi, distance, per_area) = towards(p, position)?;
                let t = ((-wi.dot(axis) - cos_cutoff) / (cos_beam - cos_cutoff)).clamp(0.0, 1.0);
                let falloff = t * t * (3.0 - 2.0 * t);
                arrival(wi, intensity * (falloff * per_area), position, distance)
            }
            Self::Directional { direction, irradiance } => arrival(-direction, irradiance, Vec3::ZERO, f32::INFINITY),
        }
    }

    /// Power it gives to a scene that a sphere of `radius` bounds: the mean of the three channels, W.
    #[must_use]
    pub fn power(&self, radius: f64) -> f64 {
        match *self {
            Self::Point { intensity, .. } => 4.0 * PI * mean(intensity),
            // The smooth step between the angles averages to one half over the cosine.
            Self::Spot { intensity, cos_beam, cos_cutoff, .. } => {
                2.0 * PI * (1.0 - 0.5 * (f64::from(cos_beam) + f64::from(cos_cutoff))) * mean(intensity)
            }
            Self::Directional { irradiance, .. } => PI * radius * radius * mean(irradiance),
        }
    }

    /// Whether it is infinitely far away.
    #[must_use]
    pub fn is_infinite(&self) -> bool {
        matches!(self, Self::Directional { .. })
    }
}

/// Mean of the three channels: what lights are weighed by. Luminance would starve blue lights.
#[must_use]
pub fn mean(c: Rgb) -> f64 {
    (f64::from(c.x) + f64::from(c.y) + f64::from(c.z)) / 3.0
}

/// Unit vector from `p` to `position`, the distance, and 1 / distance^2.
#[inline]
fn towards(p: Vec3, position: Vec3) -> Option<(Vec3, f32, f32)> {
    let to = position.as_dvec3() - p.as_dvec3();
    let distance2 = to.length_squared();
    let distance = distance2.sqrt();
    let per_area = (1.0 / distance2) as f32;
    (distance2 > 0.0 && per_area.is_finite()).then(|| ((to / distance).as_vec3(), distance as f32, per_area))
}

#[inline]
fn arrival(wi: Vec3, irradiance: Rgb, position: Vec3, distance: f32) -> Option<Arrival> {
    (irradiance.max_element() > 0.0).then_some(Arrival { wi, irradiance, position, distance })
}
