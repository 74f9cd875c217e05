//! Rays, hits, and the work that finding them took.

use glam::Vec3;

/// The points `origin + t * direction` with `0 < t < t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, not part of the ray.
    pub origin: Vec3,
    /// Need not be unit length. Components below the smallest normal number count as zero.
    pub direction: Vec3,
    /// End, not part of the ray; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// A ray without end.
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY }
    }

    /// The point at parameter `t`, as exact as plain `f32` is: for shading use [`super::Accel::surface`].
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// Where a ray met a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// Index in [`super::World::instances`], or [`Hit::NO_INSTANCE`] for a shape of the world itself.
    pub instance: u32,
    /// Index in [`super::World::shapes`], or in the object's shapes when there is an instance.
    pub shape: u32,
    /// Triangle of a mesh; 0 for other shapes.
    pub primitive: u32,
    /// Barycentric weight of the triangle's second corner; 0 for other shapes.
    pub b1: f32,
    /// Barycentric weight of the triangle's third corner; 0 for other shapes.
    pub b2: f32,
}

impl Hit {
    /// The `instance` of a shape that stands in the world itself.
    pub const NO_INSTANCE: u32 = u32::MAX;
}

/// What rendering has cost so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Rays traced, shadow rays included.
    pub rays: u64,
    /// Tree nodes opened; each tests eight boxes at once.
    pub node_tests: u64,
    /// Primitives tested; a pack of eight triangles counts as eight.
    pub primitive_tests: u64,
    /// Vertices at which paths were shaded, to go on or to gather light.
    pub vertices: u64,
    /// Samples of lights that were drawn at them.
    pub light_samples: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.node_tests += other.node_tests;
        self.primitive_tests += other.primitive_tests;
        self.vertices += other.vertices;
        self.light_samples += other.light_samples;
    }
}
