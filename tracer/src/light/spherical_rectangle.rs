//! Directions uniform over the solid angle of a rectangle.
//!
//! After Urena, Fajardo and King, "An Area-Preserving Parametrization for Spherical Rectangles" (2013). As
//! published, the solid angle is a sum of four angles less 2 pi, which leaves nothing of a small one. Here
//! it is the sum of those of two triangles (Van Oosterom and Strackee 1983), and the angle of the inverse
//! map is kept as the sine and cosine of a fixed part and of the part that `u` moves. Precision as for
//! triangles: products and roots in f64, sines and arc tangents in f32.

use crate::math::{DVec3, Vec2, Vec3, select, sin_cos_half_turn, upper_angle};

/// Least solid angle, and least distance from the plane in lengths of the farther corner: below, area
/// sampling takes over.
const LEAST: f64 = 1e-11;

/// A rectangle as seen from a reference point. x and y run along its edges, the reference point is 0, and
/// the plane is at distance z.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphericalRectangle {
    x: [f64; 2],
    y: [f64; 2],
    z: f64,
    solid_angle: f32,
}

/// What of a rectangle does not depend on who looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    corner: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    x_axis: DVec3,
    y_axis: DVec3,
    width: f64,
    height: f64,
    normal: DVec3,
}

impl Plane {
    #[inline(always)]
    pub(super) fn new(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> Self {
        let (edge_u, edge_v) = (edge_u.as_dvec3(), edge_v.as_dvec3());
        let (width, height) = (edge_u.length(), edge_v.length());
        Self {
            corner: corner.as_dvec3(),
            edge_u,
            edge_v,
            x_axis: edge_u / width,
            y_axis: edge_v / height,
            width,
            height,
            normal: edge_u.cross(edge_v),
        }
    }

    /// Unit normal.
    pub(super) fn unit_normal(&self) -> Vec3 {
        self.normal.normalize_or_zero().as_vec3()
    }

    /// Whether `p` is on the side that the normal points to.
    #[inline(always)]
    pub(super) fn faces(&self, p: Vec3) -> bool {
        self.normal.dot(p.as_dvec3() - self.corner) > 0.0
    }

    /// The rectangle seen from `from`, and whether its solid angle can be told precisely: if not, the
    /// rest means nothing.
    #[inline(always)]
    pub(super) fn seen_from(&self, from: Vec3) -> (SphericalRectangle, bool) {
        let Self { edge_u, edge_v, width, height, .. } = *self;
        let to = self.corner - from.as_dvec3();
        let (x0, y0) = (to.dot(self.x_axis), to.dot(self.y_axis));
        let (x, y) = ([x0, x0 + width], [y0, y0 + height]);
        let product = to.dot(self.normal).abs();
        let z = product / (width * height);
        // The corners as they are, not as they would be were the edges exactly square: near an edge that
        // shows.
        let corners = [to, to + edge_u, to + edge_u + edge_v, to + edge_v];
        let lengths = corners.map(DVec3::length);
        // The tangent of half the solid angle of a triangle of corners is product / share.
        let share = |i: usize, j: usize, k: usize| {
            lengths[i] * lengths[j] * lengths[k]
                + corners[i].dot(corners[j]) * lengths[k]
                + corners[j].dot(corners[k]) * lengths[i]
                + corners[k].dot(corners[i]) * lengths[j]
        };
        let (a, b) = (share(0, 1, 2), share(0, 2, 3));
        // Half angles add when complex numbers multiply.
        let (imaginary, real) = (product * (a + b), a * b - product * product);
        let larger = |a: f64, b: f64| select(a > b, a, b);
        let longest = larger(imaginary.abs(), real.abs());
        let solid_angle = 2.0 * upper_angle((imaginary.abs() / longest) as f32, (real / longest) as f32);
        let farthest = larger(larger(lengths[0], lengths[1]), larger(lengths[2], lengths[3]));
        // False for NaN too: no edges, or the reference point at a corner.
        let precise = (f64::from(solid_angle) >= LEAST) & (z >= LEAST * farthest);
        (SphericalRectangle { x, y, z, solid_angle }, precise)
    }
}

impl SphericalRectangle {
    /// The rectangle seen from `from`; `None` where its solid angle cannot be told precisely.
    #[inline]
    pub(super) fn new(corner: Vec3, edge_u: Vec3, edge_v: Vec3, from: Vec3) -> Option<Self> {
        let (seen, precise) = Plane::new(corner, edge_u, edge_v).seen_from(from);
        precise.then_some(seen)
    }

    /// Solid angle, 0 to 2 pi.
    #[inline(always)]
    pub(super) fn solid_angle(&self) -> f32 {
        self.solid_angle
    }

    /// Multiples of the edges that reach the point in the direction that `u` chooses.
    #[inline(always)]
    pub(super) fn sample(&self, u: Vec2) -> Vec2 {
        let Self { x: [x0, x1], y: [y0, y1], z, solid_angle } = *self;
        let z2 = z * z;
        // Of the normals of the planes through the reference point and the sides y0, y1 and x0 the z
        // coordinates, and 1 less their squares.
        let (s0, s1) = ((z2 + y0 * y0).sqrt(), (z2 + y1 * y1).sqrt());
        let (b0, b0_rest) = (-y0 / s0, z2 / (z2 + y0 * y0));
        let (b1, b1_rest) = (y1 / s1, z2 / (z2 + y1 * y1));
        let (c, c_rest) = (-x0 / (z2 + x0 * x0).sqrt(), z2 / (z2 + x0 * x0));
        // The fixed part: asin(-b1 c) + asin(-b0 c).
        let (sin_1, cos_1) = (-b1 * c, (b1_rest + b1 * b1 * c_rest).sqrt());
        let (sin_0, cos_0) = (-b0 * c, (b0_rest + b0 * b0 * c_rest).sqrt());
        let (fixed_sin, fixed_cos) = (sin_1 * cos_0 + cos_1 * sin_0, cos_1 * cos_0 - sin_1 * sin_0);
        let (moved_sin, moved_cos) = fine_sin_cos(u.x * solid_angle);
        let sin = fixed_sin * moved_cos + fixed_cos * moved_sin;
        let cos = fixed_cos * moved_cos - fixed_sin * moved_sin;
        // Equation 19 and the lines after it, without the division by the sine.
        // cos b0 + b1 is a small difference where both sides lie the same way and the plane is edge-on.
        let small = z2 * (y1 - y0) * (y0 + y1) / (s0 * s1 * (y1 * s0 + y0 * s1)) - b0 * sin * sin / (1.0 + cos);
        let f = select((y0 * y1 > 0.0) & (cos > 0.0), small, cos * b0 + b1);
        let root = at_least(f * f - b0_rest * sin * sin, f64::MIN_POSITIVE).sqrt();
        let x = within(z * sin * select(f.is_sign_negative(), -1.0, 1.0) / root, x0, x1);
        // Along y the solid angle grows with the sine of the elevation.
        let d2 = x * x + z2;
        let (h0, h1) = (y0 / (d2 + y0 * y0).sqrt(), y1 / (d2 + y1 * y1).sqrt());
        let h = h0 + f64::from(u.y) * (h1 - h0);
        let y = within(h * (d2 / at_least(1.0 - h * h, f64::MIN_POSITIVE)).sqrt(), y0, y1);
        Vec2::new(((x - x0) / (x1 - x0)) as f32, ((y - y0) / (y1 - y0)) as f32)
    }
}

/// The greater; `least` where `x` is not a number.
#[inline(always)]
fn at_least(x: f64, least: f64) -> f64 {
    select(x > least, x, least)
}

/// `x` brought between `low` and `high`; `low` where it is not a number.
#[inline(always)]
fn within(x: f64, low: f64, high: f64) -> f64 {
    let x = at_least(x, low);
    select(x < high, x, high)
}

/// Sine and cosine of an angle that is within f32's relative error of `x`, exact to f64: sin^2 + cos^2 = 1,
/// and 1 - cos is precise for small angles. 0 <= x <= 2 pi.
#[inline(always)]
fn fine_sin_cos(x: f32) -> (f64, f64) {
    let (sin, cos) = sin_cos_half_turn(0.5 * x);
    let (sin, cos) = (f64::from(sin), f64::from(cos));
    let scale = 1.0 / (sin * sin + cos * cos);
    (2.0 * sin * cos * scale, 1.0 - 2.0 * sin * sin * scale)
}
