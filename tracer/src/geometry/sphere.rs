//! Ray against sphere, in `f64`.
//!
//! The discriminant is taken from the distance between the centre and the ray, and the nearer root from
//! the product of both (Haines, Guenther, Akenine-Moeller, "Precision Improvements for Ray/Sphere
//! Intersection", Ray Tracing Gems, 2019). With `f32` input that holds for spheres seen at a
//! radius of a millionth of their distance.

use glam::{DVec3, Vec3};

use super::Ray;

/// The parameter of the first point of the sphere that has `0 < t < t_max`; both sides count.
#[must_use]
pub fn intersect(center: Vec3, radius: f32, ray: &Ray) -> Option<f64> {
    let length = (ray.origin.as_dvec3() - center.as_dvec3()).length();
    // What the difference between distance and radius cannot tell from zero.
    let least = 8.0 * f64::EPSILON * (length + f64::from(radius)) / ray.direction.as_dvec3().length();
    let accept = |t: f64| t > least && (t as f32) < ray.t_max && (t as f32) > 0.0;
    roots(center, radius, ray)?.into_iter().find(|&t| accept(t))
}

/// Both parameters at which the line of a ray passes through a sphere, the smaller one first.
#[must_use]
pub fn roots(center: Vec3, radius: f32, ray: &Ray) -> Option<[f64; 2]> {
    let d = ray.direction.as_dvec3();
    let oc = ray.origin.as_dvec3() - center.as_dvec3();
    let r = f64::from(radius);
    let a = d.length_squared();
    if !(a > 0.0 && a < f64::INFINITY) {
        return None;
    }
    let b = oc.dot(d);
    let closest = oc - d * (b / a);
    let discriminant = r * r - closest.length_squared();
    // Not a number neither.
    if discriminant.is_nan() || discriminant < 0.0 {
        return None;
    }
    let q = -(b + (a * discriminant).sqrt().copysign(b));
    let length = oc.length();
    let c = (length - r) * (length + r);
    let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (q / a, c / q) };
    Some(if t0 > t1 { [t1, t0] } else { [t0, t1] })
}

/// The point at a parameter, put back on the sphere, and the outward unit normal there.
#[must_use]
pub fn surface(center: Vec3, radius: f32, ray: &Ray, t: f64) -> (DVec3, DVec3) {
    let center = center.as_dvec3();
    let p = ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
    let n = (p - center).try_normalize().unwrap_or(DVec3::Z);
    (center + n * f64::from(radius), n)
}
