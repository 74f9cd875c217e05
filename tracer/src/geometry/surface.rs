//! The point that a ray hit, with a bound of its error.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::{Ray, Shape, disk, sphere};

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position, in world space.
    pub p: Vec3,
    /// The true point is within this of `p`, along each axis.
    pub p_error: Vec3,
    /// Unit geometric normal, on the front side, whichever side was hit.
    pub ng: Vec3,
}

/// Half the distance between 1 and the next `f32`: the relative error of rounding once.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;
/// Room for the few dozen `f64` operations behind a point.
const ROOM: f64 = 64.0 * f64::EPSILON;

/// A point before it is rounded: where, of what size the numbers were that it came from, and the normal.
struct Exact {
    p: DVec3,
    size: DVec3,
    normal: DVec3,
}

/// The point of a triangle at weights `b1` and `b2` of its second and third corner. It is the weights that
/// are kept, not the parameter: so the point is in the triangle's plane.
#[inline(always)]
fn of_triangle(corners: [Vec3; 3], b1: f32, b2: f32) -> Exact {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let (b1, b2) = (f64::from(b1), f64::from(b2));
    let b0 = 1.0 - b1 - b2;
    Exact {
        p: a * b0 + b * b1 + c * b2,
        size: (a * b0).abs() + (b * b1).abs() + (c * b2).abs(),
        normal: (b - a).cross(c - a),
    }
}

/// The point of a triangle of the world itself, as [`super::Accel::surface`] finds it.
#[inline(always)]
#[must_use]
pub fn triangle_point(corners: [Vec3; 3], b1: f32, b2: f32) -> SurfacePoint {
    finish(of_triangle(corners, b1, b2), true, None)
}

/// The point of a shape that a ray hit near parameter `t`. None for a mesh without that triangle.
pub(super) fn of_hit(
    shape: &Shape,
    primitive: u32,
    (b1, b2): (f32, f32),
    ray: &Ray,
    t: f32,
    placed: Option<(&DAffine3, &DMat3)>,
) -> Option<SurfacePoint> {
    // The hit was found with this parameter rounded to `f32`; here it is had in full.
    let whole = Ray { t_max: f32::INFINITY, ..*ray };
    let (exact, flips) = match *shape {
        Shape::Mesh(ref mesh) => {
            let corners = mesh.triangles.get(primitive as usize)?;
            let corner = |k: usize| mesh.positions.get(corners[k] as usize).copied();
            (of_triangle([corner(0)?, corner(1)?, corner(2)?], b1, b2), true)
        }
        Shape::Sphere { center, radius } => {
            let t = sphere::roots(center, radius, &whole)
                .and_then(|roots| roots.into_iter().find(|&x| x as f32 == t))
                .unwrap_or(f64::from(t));
            let (p, normal) = sphere::surface(center, radius, &whole, t);
            (Exact { p, size: center.as_dvec3().abs() + f64::from(radius), normal }, false)
        }
        Shape::Disk { center, normal, radius } => {
            let t = disk::intersect(center, normal, radius, &whole).unwrap_or(f64::from(t));
            let (p, normal) = disk::surface(center, normal, &whole, t);
            (Exact { p, size: center.as_dvec3().abs() + f64::from(radius), normal }, false)
        }
    };
    Some(finish(exact, flips, placed))
}

/// Into world space, and rounded. `flips` is for normals that follow from the order of corners: a
/// mirroring turns that order round.
#[inline(always)]
fn finish(exact: Exact, flips: bool, placed: Option<(&DAffine3, &DMat3)>) -> SurfacePoint {
    let Exact { mut p, size, mut normal } = exact;
    let mut error = size * ROOM;
    if let Some((to_world, normals)) = placed {
        let m = &to_world.matrix3;
        let absolute = |v: DVec3| m.x_axis.abs() * v.x + m.y_axis.abs() * v.y + m.z_axis.abs() * v.z;
        // A ray that leaves this point is rounded once more when it is taken into object space.
        error = absolute(error + p.abs() * (2.0 * UNIT)) + (absolute(size) + to_world.translation.abs()) * ROOM;
        normal = *normals * normal;
        if flips && m.determinant() < 0.0 {
            normal = -normal;
        }
        p = to_world.transform_point3(p);
    }
    error += p.abs() * UNIT;
    let up = |x: f64| (x as f32).next_up();
    SurfacePoint {
        p: p.as_vec3(),
        p_error: Vec3::new(up(error.x), up(error.y), up(error.z)),
        ng: normal.try_normalize().unwrap_or(DVec3::Z).as_vec3(),
    }
}
