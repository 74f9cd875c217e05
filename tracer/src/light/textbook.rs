//! The forms found in textbooks, for comparison: each fails where the module it names does not.
//!
//! Nothing that makes pixels calls these. All arithmetic is f32, as published code has it.

use std::f32::consts::PI;

use crate::math::{Vec2, Vec3, acos, safe_sqrt, sin_cos};

/// Solid angle of a triangle by Girard's excess: the sum of its angles less pi. Of a small triangle it
/// leaves rounding error alone: 10% at 1e-5 sr. Compare [`super::Emitter::solid_angle`].
#[must_use]
pub fn girard_solid_angle(p: &[Vec3; 3], from: Vec3) -> f32 {
    spherical_angles(&p.map(|p| (p - from).normalize())).iter().sum::<f32>() - PI
}

/// Angles of a spherical triangle at its vertices, by arc cosines.
fn spherical_angles(v: &[Vec3; 3]) -> [f32; 3] {
    let [a, b, c] = *v;
    let (ab, bc, ca) = (a.cross(b).normalize(), b.cross(c).normalize(), c.cross(a).normalize());
    [acos(-ab.dot(ca)), acos(-bc.dot(ab)), acos(-ca.dot(bc))]
}

/// A direction uniform over the solid angle of a triangle (Arvo, "Stratified Sampling of Spherical
/// Triangles", 1995): exact in exact arithmetic, noise for triangles below 1e-4 sr.
#[must_use]
pub fn arvo_triangle(p: &[Vec3; 3], from: Vec3, u: Vec2) -> Vec3 {
    let v = p.map(|p| (p - from).normalize());
    let [a, b, c] = v;
    let [alpha, beta, gamma] = spherical_angles(&v);
    let area = u.x * (alpha + beta + gamma - PI);
    let (sin_alpha, cos_alpha) = sin_cos(alpha);
    let (s, t) = sin_cos(area - alpha);
    let (k, l) = (t - cos_alpha, s + sin_alpha * a.dot(b));
    let q = ((l * t - k * s) * cos_alpha - l) / ((l * s + k * t) * sin_alpha);
    let moved = a * q + (c - a * c.dot(a)).normalize() * safe_sqrt(1.0 - q * q);
    let z = 1.0 - u.y * (1.0 - moved.dot(b));
    b * z + (moved - b * moved.dot(b)).normalize() * safe_sqrt(1.0 - z * z)
}

/// Solid angle of a rectangle as the sum of four angles less 2 pi (Urena et al. 2013, as published).
#[must_use]
pub fn urena_solid_angle(corner: Vec3, edge_u: Vec3, edge_v: Vec3, from: Vec3) -> f32 {
    let to = corner - from;
    let (width, height) = (edge_u.length(), edge_v.length());
    let (x_axis, y_axis) = (edge_u / width, edge_v / height);
    let (x0, y0, z0) = (to.dot(x_axis), to.dot(y_axis), -to.dot(x_axis.cross(y_axis)).abs());
    let (x1, y1) = (x0 + width, y0 + height);
    let corners = [Vec3::new(x0, y0, z0), Vec3::new(x1, y0, z0), Vec3::new(x1, y1, z0), Vec3::new(x0, y1, z0)];
    let normal = |i: usize| corners[i].cross(corners[(i + 1) % 4]).normalize();
    (0..4).map(|i| acos(-normal(i).dot(normal((i + 1) % 4)))).sum::<f32>() - 2.0 * PI
}

/// Solid angle of a sphere as 2 pi (1 - cos): 7% off where the radius is a thousandth of the distance, 0
/// at a ten-thousandth, so that densities there are infinite.
#[must_use]
pub fn cone_solid_angle(radius: f32, distance: f32) -> f32 {
    let sin2 = radius * radius / (distance * distance);
    2.0 * PI * (1.0 - safe_sqrt(1.0 - sin2))
}

/// Density per solid angle of a choice uniform over an area, in the order it is usually written: the
/// square overflows for distances above 1e19, and the cosine may be 0.
#[must_use]
pub fn area_pdf(distance: f32, cos: f32, area: f32) -> f32 {
    distance * distance / (cos * area)
}

/// What a group of lights of this power may matter, as light trees often have it: the squared distance is
/// clamped by half the diagonal of the group's bounds, which is a length. In a scene measured in
/// millimetres the clamp rules less than in the same scene measured in metres. Compare
/// [`super::group_importance`].
#[must_use]
pub fn mixed_importance(power: f32, distance2: f32, diagonal: f32) -> f32 {
    power / distance2.max(0.5 * diagonal)
}
