//! What is known of a surface beside its shape, and its value at a hit.

use super::{Placement, apply};
use crate::{
    geometry::Hit,
    light::LightSample,
    math::{Frame, INV_PI, TAU, Vec2, Vec3, acos, atan2},
    texture::Texture,
};

/// The emitter of surfaces that give no light.
pub const NO_EMITTER: u32 = u32::MAX;

/// A point of a surface, ready for shading.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Where.
    pub p: Vec3,
    /// Bound of its error, each coordinate.
    pub p_error: Vec3,
    /// Unit geometric normal; points to the front.
    pub ng: Vec3,
    /// Unit shading normal, on the side of `ng`.
    pub ns: Vec3,
    /// Texture coordinates; 0 where there are none or nothing asks for them.
    pub uv: Vec2,
    /// Change of place along u; 0 where nothing asks for it.
    pub dpdu: Vec3,
    /// Change of place along v; 0 where nothing asks for it.
    pub dpdv: Vec3,
    /// Its material.
    pub material: u32,
    /// The emitter that the primitive is, or [`NO_EMITTER`].
    pub emitter: u32,
    /// Number of its surface.
    pub(super) surface: u32,
}

impl Point {
    /// A point of a surface without attributes.
    #[inline]
    #[must_use]
    pub fn plain(p: Vec3, p_error: Vec3, ng: Vec3, material: u32, emitter: u32, surface: u32) -> Self {
        let (uv, dpdu, dpdv) = (Vec2::ZERO, Vec3::ZERO, Vec3::ZERO);
        Self { p, p_error, ng, ns: ng, uv, dpdu, dpdv, material, emitter, surface }
    }
}

/// What is known of a shape beside its geometry.
#[derive(Debug)]
pub(super) struct Surface {
    pub material: u32,
    /// Number of its first emitter, or [`NO_EMITTER`].
    pub first_emitter: u32,
    /// Whether each primitive is an emitter of its own; else all are the first.
    pub emitter_per_primitive: bool,
    /// Emission that varies over the surface.
    pub emission: Option<Texture>,
    pub attributes: Attributes,
}

/// Values that vary over a shape; what nobody asks for is not kept.
#[derive(Debug)]
pub(super) enum Attributes {
    /// None: flat, untextured, or a sphere or disk whose normal is known without.
    None,
    /// Of a mesh, by its vertices.
    Mesh {
        triangles: Vec<[u32; 3]>,
        /// One a vertex, or empty. Zero where the triangle's own is to be used.
        normals: Vec<Vec3>,
        /// One a vertex, or empty.
        uvs: Vec<Vec2>,
        /// (dp/du, dp/dv), one a triangle, or empty.
        tangents: Vec<[Vec3; 2]>,
    },
    /// Of a sphere: u along the equator from its x axis, v from its south to its north pole (y axis).
    Sphere { center: Vec3, axes: [Vec3; 3] },
    /// Of a disk: its square's coordinates.
    Disk { center: Vec3, axes: [Vec3; 2] },
}

impl Surface {
    #[inline]
    pub fn emitter(&self, primitive: u32) -> u32 {
        if self.emitter_per_primitive { self.first_emitter + primitive } else { self.first_emitter }
    }

    /// Fill in the shading normal, texture coordinates and tangents of a hit.
    pub fn interpolate(&self, hit: &Hit, placement: Option<&Placement>, point: &mut Point) {
        match &self.attributes {
            Attributes::None => {}
            Attributes::Mesh { triangles, normals, uvs, tangents } => {
                let [i, j, k] = triangles[hit.primitive as usize].map(|i| i as usize);
                let b0 = 1.0 - hit.b1 - hit.b2;
                if !uvs.is_empty() {
                    point.uv = uvs[i] * b0 + uvs[j] * hit.b1 + uvs[k] * hit.b2;
                }
                if let Some([dpdu, dpdv]) = tangents.get(hit.primitive as usize) {
                    (point.dpdu, point.dpdv) = (*dpdu, *dpdv);
                }
                if !normals.is_empty() {
                    let mut n = normals[i] * b0 + normals[j] * hit.b1 + normals[k] * hit.b2;
                    if let Some(placement) = placement {
                        n = apply(&placement.normal, n);
                    }
                    point.ns = on_the_side_of(n, point.ng);
                }
                if let Some(placement) = placement {
                    point.dpdu = apply(&placement.linear, point.dpdu);
                    point.dpdv = apply(&placement.linear, point.dpdv);
                }
            }
            // Spheres and disks with coordinates are never parts of an instance.
            Attributes::Sphere { center, axes } => {
                let q = (point.p - *center).normalize_or_zero();
                let local = Vec3::new(q.dot(axes[0]), q.dot(axes[1]), q.dot(axes[2]));
                point.uv = sphere_uv(local);
                point.dpdu = (axes[1].cross(q)) * TAU;
                point.dpdv = (axes[1] - q * local.y) * std::f32::consts::PI;
            }
            Attributes::Disk { center, axes } => {
                let q = point.p - *center;
                point.uv = disk_uv(q, axes);
                (point.dpdu, point.dpdv) = (axes[0] * 2.0, axes[1] * 2.0);
            }
        }
    }

    /// Texture coordinates of a point that light sampling chose.
    pub fn emitter_uv(&self, primitive: u32, sample: &LightSample) -> Vec2 {
        let c = sample.coordinates;
        match &self.attributes {
            Attributes::None => Vec2::ZERO,
            Attributes::Mesh { triangles, uvs, .. } if !uvs.is_empty() => {
                if self.emitter_per_primitive || triangles.len() == 1 {
                    let [i, j, k] = triangles[primitive as usize].map(|i| i as usize);
                    uvs[i] * (1.0 - c.x - c.y) + uvs[j] * c.x + uvs[k] * c.y
                } else {
                    // A rectangle: vertices 0, 1 and 3 span it.
                    uvs[0] + (uvs[1] - uvs[0]) * c.x + (uvs[3] - uvs[0]) * c.y
                }
            }
            Attributes::Mesh { .. } => Vec2::ZERO,
            Attributes::Sphere { center, axes } => {
                let q = (sample.point - *center).normalize_or_zero();
                sphere_uv(Vec3::new(q.dot(axes[0]), q.dot(axes[1]), q.dot(axes[2])))
            }
            Attributes::Disk { center, axes } => disk_uv(sample.point - *center, axes),
        }
    }
}

/// `n` with unit length, turned to the side of `ng`; `ng` itself where `n` has no direction.
#[inline]
fn on_the_side_of(n: Vec3, ng: Vec3) -> Vec3 {
    let length = n.length();
    if !(length > 1e-20 && length.is_finite()) {
        return ng;
    }
    let n = n / length;
    if n.dot(ng) < 0.0 { -n } else { n }
}

fn sphere_uv(q: Vec3) -> Vec2 {
    let turn = atan2(-q.z, q.x) / TAU;
    Vec2::new(if turn < 0.0 { turn + 1.0 } else { turn }, 1.0 - acos(q.y) * INV_PI)
}

fn disk_uv(q: Vec3, axes: &[Vec3; 2]) -> Vec2 {
    let along = |axis: Vec3| 0.5 + 0.5 * q.dot(axis) / axis.length_squared();
    Vec2::new(along(axes[0]), along(axes[1]))
}

/// Axes of a disk with this unit normal and radius.
pub(super) fn disk_axes(normal: Vec3, radius: f32) -> [Vec3; 2] {
    let frame = Frame::from_normal(normal);
    [frame.t * radius, frame.b * radius]
}
