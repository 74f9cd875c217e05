//! The native scene file: camera, film, materials, shapes, lights, environment, animation, settings.
//!
//! These types are the file as written. [`SceneFile::parse`] reads it, refuses unknown fields, and names
//! the place of every error. Lengths are in scene units, angles in degrees, colours linear Rec. 709 RGB.
//! The coordinate system is right-handed; a mesh's front is where its triangles run counter-clockwise.

mod animation;
mod check;
mod import;
mod light;
mod material;
mod parse;
mod shape;
mod transform;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use animation::{Animation, CameraKey, TransformKey};
pub use import::{Import, Source};
pub use light::{Constant, Directional, Environment, EnvironmentImage, Light, Point, Spot};
pub use material::{
    BlinnMicrofacet, BlinnPhong, Checkerboard, Conductor, Dielectric, Diffuse, Image, Material, MaterialKind, Metal,
    MetallicRoughness, Mirror, NormalMap, Phong, Plastic, Roughness, Texture, TextureKind, UvTransform, Wrap,
};
pub use parse::{SceneError, from_json, nested};
pub use shape::{Disk, Emission, Instance, Mesh, MeshSource, Normals, Quad, Shape, ShapeKind, Sphere};
pub use transform::{Rotate, Step, Transform};

use crate::{
    hash::AssetHash,
    job::{Frames, Quality},
    method::MethodChoices,
};

/// A vector or point, scene units.
pub type Vec3 = [f64; 3];

/// A linear Rec. 709 colour; a single number is a grey.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, JsonSchema)]
#[serde(transparent)]
pub struct Rgb(pub [f64; 3]);

impl Rgb {
    /// The grey of this value.
    #[must_use]
    pub fn grey(value: f64) -> Self {
        Self([value; 3])
    }

    /// Whether every channel is zero.
    #[must_use]
    pub fn is_black(&self) -> bool {
        self.0 == [0.0; 3]
    }
}

impl<'de> Deserialize<'de> for Rgb {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        parse::rgb(deserializer)
    }
}

/// A native scene file, version 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Version of the format: 1.
    #[schemars(extend("enum" = [1]))]
    pub tessera: u32,
    /// What people call the scene.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Where it comes from, and for analytic scenes the derivation of the expected value.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// The camera.
    pub camera: Camera,
    /// Image size and pixel filter.
    #[serde(default)]
    pub film: FilmSettings,
    /// Materials by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub materials: BTreeMap<String, Material>,
    /// Groups of shapes that instances repeat.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub objects: BTreeMap<String, Vec<Shape>>,
    /// What is in the scene.
    #[serde(default)]
    pub shapes: Vec<Shape>,
    /// Lights without a surface.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<Light>,
    /// What rays that leave the scene meet; black where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment: Option<Environment>,
    /// Movement of the camera and of named shapes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub animation: Option<Animation>,
    /// What to render where the job does not say.
    #[serde(default)]
    pub settings: Settings,
    /// Hash of every file that is named here or by one that is, by its relative path. Filled in on submission.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub assets: BTreeMap<String, AssetHash>,
}

/// What to render where the job does not say.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// How exact the picture must be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    /// Choices of method.
    #[serde(default)]
    pub method: MethodChoices,
    /// Frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<Frames>,
}

/// How the scene is projected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Projection.
    #[serde(default, rename = "type")]
    pub kind: CameraKind,
    /// The eye.
    pub position: Vec3,
    /// A point in the middle of the image.
    pub target: Vec3,
    /// A direction that points up in the image.
    #[serde(default = "default_up")]
    pub up: Vec3,
    /// Perspective: full angle of view along `fov_axis`, degrees, between 0 and 180.
    #[serde(default = "default_fov")]
    pub fov: f64,
    /// Perspective: the axis that `fov` is measured along.
    #[serde(default)]
    pub fov_axis: FovAxis,
    /// Orthographic: height of the image in scene units.
    #[serde(default = "default_height")]
    pub height: f64,
    /// Nothing nearer along the view axis is seen.
    #[serde(default)]
    pub near: f64,
    /// Nothing farther along the view axis is seen; without bound where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub far: Option<f64>,
    /// Thin lens: its radius, scene units; 0 is a pinhole.
    #[serde(default)]
    pub lens_radius: f64,
    /// Thin lens: distance from the eye to the plane in focus along the view axis; to `target` where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus_distance: Option<f64>,
}

fn default_up() -> Vec3 {
    [0.0, 1.0, 0.0]
}

fn default_fov() -> f64 {
    45.0
}

fn default_height() -> f64 {
    2.0
}

/// Projection of a camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraKind {
    /// Pinhole, or thin lens where `lens_radius` is above 0.
    #[default]
    Perspective,
    /// Parallel rays.
    Orthographic,
}

/// Axis of the image that the angle of view is measured along.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FovAxis {
    /// Left to right.
    #[default]
    X,
    /// Top to bottom.
    Y,
    /// The shorter side.
    Smaller,
    /// The longer side.
    Larger,
}

/// Image size and pixel filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilmSettings {
    /// Width in pixels.
    #[serde(default = "default_edge")]
    #[schemars(range(min = 1, max = crate::job::MAX_EDGE))]
    pub width: u32,
    /// Height in pixels.
    #[serde(default = "default_edge")]
    #[schemars(range(min = 1, max = crate::job::MAX_EDGE))]
    pub height: u32,
    /// Pixel filter, by importance: a sample feeds one pixel.
    #[serde(default)]
    pub filter: Filter,
}

fn default_edge() -> u32 {
    512
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { width: default_edge(), height: default_edge(), filter: Filter::Box }
    }
}

/// Pixel filter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// The pixel's own square.
    #[default]
    Box,
    /// A tent of one pixel's radius.
    Tent,
    /// A Gaussian of 0.5 pixel standard deviation, cut at 1.5 pixels.
    Gaussian,
}
