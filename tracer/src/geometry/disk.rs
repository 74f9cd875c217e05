//! Ray against flat disk, in `f64`.

use glam::{DVec3, Vec3};

use super::Ray;

/// The parameter of the point of the disk that has `0 < t < t_max`; both sides count.
#[must_use]
pub fn intersect(center: Vec3, normal: Vec3, radius: f32, ray: &Ray) -> Option<f64> {
    let n = normal.as_dvec3().try_normalize()?;
    let d = ray.direction.as_dvec3();
    let oc = center.as_dvec3() - ray.origin.as_dvec3();
    let slope = n.dot(d);
    let t = n.dot(oc) / slope;
    // What the distance to the plane cannot tell from zero.
    let least = 8.0 * f64::EPSILON * n.abs().dot(oc.abs()) / slope.abs();
    if !(t > least && (t as f32) > 0.0 && (t as f32) < ray.t_max) {
        return None;
    }
    let r = f64::from(radius);
    ((d * t - oc).length_squared() <= r * r).then_some(t)
}

/// The point at a parameter, put back on the disk's plane, and its unit normal.
#[must_use]
pub fn surface(center: Vec3, normal: Vec3, ray: &Ray, t: f64) -> (DVec3, DVec3) {
    let n = normal.as_dvec3().try_normalize().unwrap_or(DVec3::Z);
    let p = ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
    (p - n * n.dot(p - center.as_dvec3()), n)
}
