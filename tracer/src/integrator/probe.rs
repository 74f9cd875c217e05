//! A look into one path: its vertices as they are made. For features of the first hit and for people.

use std::fmt;

use super::Shading;
use crate::{
    geometry::Hit,
    math::{Rgb, Vec3},
    scene::Scene,
};

/// Is told of a path as it grows.
pub trait Probe {
    /// The path has reached a vertex; emission there is in `radiance` already.
    fn vertex(&mut self, _vertex: &Vertex) {}

    /// One of the ways in which the path went on has ended with this radiance; the path's own holds its share.
    fn way(&mut self, _radiance: Rgb) {}

    /// The path has ended with this radiance.
    fn end(&mut self, _end: End, _radiance: Rgb) {}
}

/// A vertex of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// Scatterings before it.
    pub depth: u32,
    /// Where.
    pub p: Vec3,
    /// Unit geometric normal of the front.
    pub ng: Vec3,
    /// Unit shading normal.
    pub ns: Vec3,
    /// Instance that was hit, [`Hit::NO_INSTANCE`] for none.
    pub instance: u32,
    /// Shape that was hit.
    pub shape: u32,
    /// Primitive that was hit.
    pub primitive: u32,
    /// Colour of the surface.
    pub albedo: Rgb,
    /// Depth along the camera's axis.
    pub camera_depth: f32,
    /// What light from here counts for.
    pub throughput: Rgb,
    /// Radiance found so far.
    pub radiance: Rgb,
}

/// Why a path ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Left the scene.
    Escaped,
    /// Has as many bounces as are allowed, or as can matter.
    Depth,
    /// The surface scattered nothing onwards.
    Absorbed,
    /// The direction lay on different sides of the geometric and of the shading normal.
    Shading,
    /// Russian roulette.
    Roulette,
}

impl Vertex {
    pub(super) fn new(depth: u32, shading: &Shading, hit: Hit, throughput: Rgb, radiance: Rgb, scene: &Scene) -> Self {
        Self {
            depth,
            p: shading.point.p,
            ng: shading.point.ng,
            ns: shading.frame.n,
            instance: hit.instance,
            shape: hit.shape,
            primitive: hit.primitive,
            albedo: shading.bsdf.albedo(),
            camera_depth: scene.camera().depth(shading.point.p),
            throughput,
            radiance,
        }
    }
}

impl fmt::Display for Vertex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.depth)?;
        if self.instance != Hit::NO_INSTANCE {
            write!(f, "instance {} ", self.instance)?;
        }
        let Vertex { shape, primitive, p, ns, throughput, radiance, .. } = self;
        write!(f, "shape {shape} primitive {primitive} at {p} normal {ns} throughput {throughput} radiance {radiance}")
    }
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            End::Escaped => "left the scene",
            End::Depth => "reached its last bounce",
            End::Absorbed => "was absorbed",
            End::Shading => "went below the surface",
            End::Roulette => "lost at roulette",
        })
    }
}
