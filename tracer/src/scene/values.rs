//! What values of a scene file mean for rendering: what a material asks of a hit, whether a transform keeps
//! a shape, numbers in f32.

use common::{
    job::FieldError,
    mesh::{Encoding, MeshPart, Picture},
    scene::{self, MaterialKind, ShapeKind},
};

use super::mesh::Source;
use crate::{
    geometry::{Shape, World},
    math::{DAffine3, DVec3, Rgb, Vec2, Vec3},
    texture::srgb_to_linear,
};

/// What of a hit a material asks for.
#[derive(Clone, Copy, Default)]
pub(super) struct Needs {
    pub uv: bool,
    pub tangents: bool,
}

impl Needs {
    pub fn is_nothing(self) -> bool {
        !self.uv && !self.tangents
    }
}

pub(super) fn needs(material: &scene::Material) -> Needs {
    let mapped = |texture: &scene::Texture| matches!(texture, scene::Texture::Mapped(_));
    let alphas = match &material.kind {
        MaterialKind::Dielectric(m) => m.roughness.alphas(),
        MaterialKind::Conductor(m) => m.roughness.alphas(),
        MaterialKind::Plastic(m) => m.roughness.alphas(),
        _ => [0.0; 2],
    };
    let tangents = material.normal_map.is_some() || alphas[0] != alphas[1];
    Needs { uv: tangents || material.textures().iter().any(|(_, texture)| mapped(texture)), tangents }
}

/// Whether a material has perfectly smooth parts, and whether it has rough ones.
pub(super) fn smoothness(kind: &MaterialKind) -> (bool, bool) {
    let by = |roughness: scene::Roughness| {
        let rough = roughness.alphas().iter().any(|&a| a > 0.0);
        (!rough, rough)
    };
    match kind {
        MaterialKind::Diffuse(_) => (false, false),
        MaterialKind::Mirror(_) => (true, false),
        MaterialKind::Dielectric(m) => by(m.roughness),
        MaterialKind::Conductor(m) => by(m.roughness),
        MaterialKind::Plastic(m) => by(m.roughness),
        _ => (false, true),
    }
}

pub(super) fn rgb(colour: scene::Rgb) -> Rgb {
    let [r, g, b] = colour.0;
    Rgb::new(r as f32, g as f32, b as f32)
}

pub(super) fn linear(picture: &Picture) -> Vec<Rgb> {
    let decode = |c: f32| if picture.encoding == Encoding::Srgb { srgb_to_linear(c) } else { c };
    picture.pixels.iter().map(|p| Rgb::new(decode(p[0]), decode(p[1]), decode(p[2]))).collect()
}

pub(super) fn from_part(part: &MeshPart) -> Source<'_> {
    let vector = |v: &[f32; 3]| Vec3::from_array(*v).as_dvec3();
    Source {
        positions: part.mesh.positions.iter().map(vector).collect(),
        triangles: &part.mesh.triangles,
        normals: part.mesh.normals.iter().map(vector).collect(),
        uvs: part.mesh.uvs.iter().map(|&uv| Vec2::from_array(uv)).collect(),
    }
}

/// Whether `to_world` leaves the shape of this kind: rotations, mirrorings and uniform scale keep a sphere;
/// a disk also bears any scale along its normal.
pub(super) fn keeps_shape(kind: &ShapeKind, to_world: &DAffine3) -> bool {
    let round = |a: DVec3, b: DVec3| {
        let (la, lb) = (a.length_squared(), b.length_squared());
        (la - lb).abs() <= 1e-6 * la && a.dot(b).abs() <= 1e-6 * la
    };
    let m = to_world.matrix3;
    match kind {
        ShapeKind::Sphere(_) => round(m.x_axis, m.y_axis) && round(m.y_axis, m.z_axis) && round(m.z_axis, m.x_axis),
        ShapeKind::Disk(disk) => {
            let (u, v) = DVec3::from_array(disk.normal).normalize().any_orthonormal_pair();
            round(m * u, m * v)
        }
        _ => true,
    }
}

/// Where a disk's front points, and by how much the disk grows.
pub(super) fn placed_disk(normal: DVec3, to_world: &DAffine3) -> (DVec3, f64) {
    let normal = normal.normalize();
    let (u, _) = normal.any_orthonormal_pair();
    let front = to_world.matrix3.inverse().transpose() * normal;
    (front.normalize_or_zero(), (to_world.matrix3 * u).length())
}

/// Refuse a quadrilateral that is bent or not convex. Bends within a hundredth of its size, as measured
/// walls have them, are left to its two triangles.
pub(super) fn check_quad(path: &str, v: [DVec3; 4]) -> Result<(), FieldError> {
    let (ac, bd) = (v[2] - v[0], v[3] - v[1]);
    let normal = ac.cross(bd).normalize_or_zero();
    let size = ac.length().max(bd.length());
    let field = || format!("{path}.vertices");
    if (v[1] - v[0]).dot(normal).abs() > 1e-2 * size {
        return Err(FieldError::new(field(), "are not in one plane; write two triangles as a mesh"));
    }
    let turns = |i: usize| (v[(i + 1) % 4] - v[i]).cross(v[(i + 2) % 4] - v[(i + 1) % 4]).dot(normal);
    if (0..4).any(|i| turns(i) < -1e-4 * size * size) {
        return Err(FieldError::new(field(), "do not go round a convex quadrilateral"));
    }
    Ok(())
}

/// About the radius of a sphere around everything; 1 for an empty world. It only weighs lights.
pub(super) fn scene_radius(world: &World) -> f32 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut cover = |center: DVec3, reach: f64| {
        if center.is_finite() && reach.is_finite() {
            low = low.min(center - reach);
            high = high.max(center + reach);
        }
    };
    let placed = world.instances.iter().map(|i| (&world.objects[i.object as usize].shapes, i.to_world));
    for (shapes, to_world) in std::iter::once((&world.shapes, DAffine3::IDENTITY)).chain(placed) {
        let m = to_world.matrix3;
        let stretch = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        for shape in shapes {
            match shape {
                Shape::Mesh(mesh) => {
                    for p in &mesh.positions {
                        cover(to_world.transform_point3(p.as_dvec3()), 0.0);
                    }
                }
                Shape::Sphere { center, radius } | Shape::Disk { center, radius, .. } => {
                    cover(to_world.transform_point3(center.as_dvec3()), f64::from(*radius) * stretch);
                }
            }
        }
    }
    let radius = 0.5 * (high - low).length();
    if radius.is_finite() && radius > 0.0 { radius as f32 } else { 1.0 }
}
