//! Lights without a surface, and the environment.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Rgb, Transform, Vec3, parse::tagged};

tagged!(
    /// Lights that no ray can hit.
    Light {
        /// Shines equally in all directions.
        Point = "point",
        /// Shines in a cone.
        Spot = "spot",
        /// Shines from infinitely far away.
        Directional = "directional",
    }
);

/// Shines equally in all directions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Where it is.
    pub position: Vec3,
    /// Radiant intensity, W/sr.
    pub intensity: Rgb,
}

/// Shines in a cone, falling off smoothly between two angles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spot {
    /// Where it is.
    pub position: Vec3,
    /// A point on its axis.
    pub target: Vec3,
    /// Radiant intensity on the axis, W/sr.
    pub intensity: Rgb,
    /// Angle from the axis beyond which it is dark, degrees, above 0 and at most 180.
    #[serde(default = "default_cutoff")]
    pub cutoff_angle: f64,
    /// Angle from the axis up to which it is at full strength, degrees.
    #[serde(default)]
    pub beam_angle: f64,
}

fn default_cutoff() -> f64 {
    20.0
}

/// Shines from infinitely far away.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Directional {
    /// Direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it, W/m^2.
    pub irradiance: Rgb,
}

tagged!(
    /// What rays that leave the scene meet.
    Environment {
        /// The same radiance from everywhere.
        Constant = "constant",
        /// A picture of everything around, latitude by longitude.
        EnvironmentImage = "image",
    }
);

/// The same radiance from everywhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Constant {
    /// Radiance.
    pub radiance: Rgb,
}

/// An equirectangular picture; its top is +y and its middle column looks along -z.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentImage {
    /// Relative path of an EXR, PNG or JPEG file.
    pub file: String,
    /// Multiplies every value.
    #[serde(default = "white")]
    pub scale: Rgb,
    /// Rotation from its own space to the world.
    #[serde(default, skip_serializing_if = "Transform::is_identity")]
    pub transform: Transform,
}

fn white() -> Rgb {
    Rgb::grey(1.0)
}
