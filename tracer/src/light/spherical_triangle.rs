//! Directions uniform over the solid angle of a triangle.
//!
//! Solid angle after Van Oosterom and Strackee (1983), sampling after Peters, "BRDF Importance Sampling
//! for Polygonal Lights" (2021): tangents of half angles throughout, so nothing is a small difference of
//! angles. Vectors and their products are f64, which costs a processor no more than f32 and keeps solid
//! angles of 1e-11 exact; sines and arc tangents are f32, whose error amounts to one of `u` of 1e-7.

use crate::math::{DVec3, Vec2, Vec3, atan2, sin_cos};

/// Volume spanned by the unit vectors to the vertices below which area sampling takes over: the triangle is
/// smaller than about 1e-11 sr, or the reference point lies in its plane.
const LEAST_VOLUME: f64 = 1e-11;

/// A triangle as seen from a reference point.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphericalTriangle {
    /// From the reference point to the vertices.
    to: [DVec3; 3],
    /// The same, unit vectors.
    unit: [DVec3; 3],
    volume: f64,
    /// 1 + cos of the side from vertex 0 to vertex 1.
    side_01: f64,
    /// Sum of the cosines of the other two sides.
    sides_02_12: f64,
    solid_angle: f32,
}

impl SphericalTriangle {
    /// The triangle `p` seen from `from`; `None` where its solid angle cannot be told precisely.
    #[inline]
    pub(super) fn new(p: &[Vec3; 3], from: Vec3) -> Option<Self> {
        let from = from.as_dvec3();
        // Exact, or nearly: differences of f32.
        let to = p.map(|p| p.as_dvec3() - from);
        let lengths = to.map(DVec3::length);
        let unit = [to[0] / lengths[0], to[1] / lengths[1], to[2] / lengths[2]];
        // The product of the unit vectors would lose the digits of a small triangle; that of its edges
        // does not.
        let product = to[0].dot((to[1] - to[0]).cross(to[2] - to[0])).abs();
        let volume = product / (lengths[0] * lengths[1] * lengths[2]);
        let side_01 = 0.5 * (unit[0] + unit[1]).length_squared();
        let sides_02_12 = unit[0].dot(unit[2]) + unit[1].dot(unit[2]);
        let solid_angle = 2.0 * atan2(volume as f32, (side_01 + sides_02_12) as f32);
        // False for NaN too: a vertex at the reference point.
        (volume >= LEAST_VOLUME).then_some(Self { to, unit, volume, side_01, sides_02_12, solid_angle })
    }

    /// Solid angle, 0 to 2 pi.
    #[inline]
    pub(super) fn solid_angle(&self) -> f32 {
        self.solid_angle
    }

    /// Barycentrics (b1, b2) of the point in the direction that `u` chooses.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Vec2 {
        let [pivot, start, end] = self.unit;
        // Move `end` along its arc from `start` until the triangle has the share u.x of the solid angle.
        let (sin, cos) = sin_cos(0.5 * u.x * self.solid_angle);
        let (sin, cos) = (f64::from(sin), f64::from(cos));
        let half = start * (self.volume * cos - self.sides_02_12 * sin) + end * (self.side_01 * sin);
        let length2 = half.length_squared();
        let moved = if length2 > 0.0 { half * (2.0 * start.dot(half) / length2) - start } else { end };
        // Then go along the arc from `pivot` to it until the share u.y of the height of the cap about
        // `pivot` is reached. `height` is 1 - cos of the arc, from the chord, so that it never cancels.
        let v = f64::from(u.y);
        let height = 0.5 * (moved - pivot).length_squared();
        let across = moved - pivot * (1.0 - height);
        let along = (v * (2.0 - v * height) / (2.0 - height).max(1e-30)).sqrt();
        let direction = pivot * (1.0 - v * height) + across * along;
        self.barycentrics(direction)
    }

    /// Where the ray along `direction` meets the triangle.
    #[inline]
    fn barycentrics(&self, direction: DVec3) -> Vec2 {
        let [to, b, c] = self.to;
        let (edge_1, edge_2) = (b - to, c - to);
        let normal = edge_1.cross(edge_2);
        let inside = direction * (to.dot(normal) / direction.dot(normal)) - to;
        let scale = 1.0 / normal.length_squared();
        let b1 = inside.cross(edge_2).dot(normal) * scale;
        let b2 = edge_1.cross(inside).dot(normal) * scale;
        // Rounding may step over an edge.
        let b1 = if b1 > 0.0 { b1.min(1.0) } else { 0.0 };
        let b2 = if b2 > 0.0 { b2.min(1.0 - b1) } else { 0.0 };
        Vec2::new(b1 as f32, b2 as f32)
    }
}
