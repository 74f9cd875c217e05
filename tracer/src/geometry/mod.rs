//! What rays meet: triangles, spheres, disks and instances of them, and the structure that finds the
//! nearest one.
//!
//! Self-contained: positions in, hits out. It knows nothing of materials, lights, cameras, samples or
//! scene files.
//!
//! Layout:
//! - [`ray`], [`bounds`]: the plain data.
//! - [`triangle`], [`sphere`], [`disk`]: one primitive against one ray, as exact as `f32` input allows.
//! - [`bvh`]: the tree: parallel build, eight-wide nodes, one traversal for every instruction set.
//! - [`accel`]: world and instances on top of the trees; the type the renderer holds.
//! - [`surface`], [`offset`]: the point that was hit, its error bound, and rays that leave it.
//! - [`textbook`]: the usual forms of the same things, kept to be charted beside ours.
//!
//! The hit of a ray (parameter, primitive, barycentrics) has the same bits on every processor and
//! for every shape of the tree: a triangle is decided by one fixed sequence of operations without fused
//! multiply-add, boxes never cull a triangle that this sequence accepts, and equal parameters are
//! told apart by the lowest (instance, shape, primitive).

pub mod accel;
pub mod bounds;
pub mod bvh;
pub mod disk;
mod few;
pub mod offset;
mod pages;
pub mod ray;
mod simd;
pub mod sphere;
pub mod surface;
pub mod textbook;
pub mod triangle;

#[cfg(test)]
mod tests;

use glam::{DAffine3, Vec3};

pub use accel::{Accel, Options, Stats};
pub use bounds::Bounds;
pub use bvh::{BuildMethod, Width};
pub use few::FewRays;
pub(crate) use few::{Found, NO_ROUND, Rays, Spared};
pub use offset::{spawn, spawn_to};
pub use ray::{Counters, Hit, Ray};
pub use simd::InstructionSet;
pub(crate) use simd::prefetch;
pub use surface::SurfacePoint;

/// Triangles over shared positions.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    /// Corner positions.
    pub positions: Vec<Vec3>,
    /// Corners of each triangle. Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

/// A surface. Its index in the list it stands in names it in a [`Hit`].
#[derive(Clone, Debug)]
pub enum Shape {
    /// Triangles; a hit's `primitive` is the triangle.
    Mesh(TriangleMesh),
    /// A whole sphere, front side outwards; `primitive` is 0.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
    },
    /// A flat disk; `primitive` is 0.
    Disk {
        /// Centre.
        center: Vec3,
        /// Front side; need not be unit length.
        normal: Vec3,
        /// Radius, above 0.
        radius: f32,
    },
}

/// Shapes that are placed together, any number of times.
#[derive(Clone, Debug, Default)]
pub struct Object {
    /// The shapes, in object space.
    pub shapes: Vec<Shape>,
}

/// One placement of an object.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Index in [`World::objects`].
    pub object: u32,
    /// Object space to world space; must be invertible (one that is not is dropped and counted).
    pub to_world: DAffine3,
}

/// Everything a ray can meet.
#[derive(Clone, Debug, Default)]
pub struct World {
    /// Shapes in world space.
    pub shapes: Vec<Shape>,
    /// Shapes that instances refer to.
    pub objects: Vec<Object>,
    /// Placements of objects.
    pub instances: Vec<Instance>,
}

/// How a ray is tested against a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TriangleTest {
    /// Watertight ([`triangle`]).
    #[default]
    Watertight,
    /// Moeller and Trumbore's, as textbooks print it ([`textbook::moeller_trumbore`]): rays can slip
    /// through shared edges.
    MoellerTrumbore,
}
