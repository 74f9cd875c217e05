//! Vectors, frames, elementary functions and maps from the unit square: all that pixels are made with.
//!
//! Everything here has the same bits on every processor: additions, products, quotients, roots,
//! comparisons, and functions built from them. The standard library's sines and exponentials differ
//! between systems and are not used by anything that makes pixels.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

pub use glam::{DAffine3, DVec3, Vec2, Vec3};

/// Linear Rec. 709 radiance, reflectance or throughput.
pub type Rgb = Vec3;

/// 1/pi.
pub const INV_PI: f32 = std::f32::consts::FRAC_1_PI;
/// 2 pi.
pub const TAU: f32 = std::f32::consts::TAU;
/// The largest f32 below 1.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// Bound of the relative error of `n` successive f32 roundings (Higham 2002, section 3.1).
#[must_use]
pub const fn gamma(n: u32) -> f32 {
    const UNIT_ROUNDOFF: f32 = f32::EPSILON / 2.0;
    (n as f32 * UNIT_ROUNDOFF) / (1.0 - n as f32 * UNIT_ROUNDOFF)
}

/// The next f32 towards +infinity.
#[inline]
#[must_use]
pub fn next_up(x: f32) -> f32 {
    x.next_up()
}

/// The next f32 towards -infinity.
#[inline]
#[must_use]
pub fn next_down(x: f32) -> f32 {
    x.next_down()
}

/// A number that [`select`] chooses.
pub trait Selectable: Copy {
    /// `yes` or `no`, by their bits.
    fn choose(condition: bool, yes: Self, no: Self) -> Self;
}

impl Selectable for f32 {
    #[inline(always)]
    fn choose(condition: bool, yes: Self, no: Self) -> Self {
        let mask = u32::from(condition).wrapping_neg();
        f32::from_bits(yes.to_bits() & mask | no.to_bits() & !mask)
    }
}

impl Selectable for f64 {
    #[inline(always)]
    fn choose(condition: bool, yes: Self, no: Self) -> Self {
        let mask = u64::from(condition).wrapping_neg();
        f64::from_bits(yes.to_bits() & mask | no.to_bits() & !mask)
    }
}

/// `yes` or `no`, both computed: unlike `if`, never a branch, which would keep a loop from becoming vector code.
#[inline(always)]
#[must_use]
pub fn select<T: Selectable>(condition: bool, yes: T, no: T) -> T {
    T::choose(condition, yes, no)
}

/// [`select`], coordinate by coordinate.
#[inline(always)]
#[must_use]
pub fn select3(condition: bool, yes: Vec3, no: Vec3) -> Vec3 {
    Vec3::new(select(condition, yes.x, no.x), select(condition, yes.y, no.y), select(condition, yes.z, no.z))
}

/// Root of `x`, 0 where rounding made it negative.
#[inline]
#[must_use]
pub fn safe_sqrt(x: f32) -> f32 {
    x.max(0.0).sqrt()
}

/// Relative luminance of linear Rec. 709.
#[inline]
#[must_use]
pub fn luminance(c: Rgb) -> f32 {
    0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z
}

/// Sine and cosine of `x` radians.
#[inline]
#[must_use]
pub fn sin_cos(x: f32) -> (f32, f32) {
    libm::sincosf(x)
}

/// e^x.
#[inline]
#[must_use]
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// Natural logarithm.
#[inline]
#[must_use]
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// `x` to the power `y`.
#[inline]
#[must_use]
pub fn powf(x: f32, y: f32) -> f32 {
    libm::powf(x, y)
}

/// Angle of (x, y) from the x axis, -pi to pi.
#[inline]
#[must_use]
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// Arc tangent.
#[inline]
#[must_use]
pub fn atan(x: f32) -> f32 {
    libm::atanf(x)
}

/// Tangent of `x` radians.
#[inline]
#[must_use]
pub fn tan(x: f32) -> f32 {
    libm::tanf(x)
}

/// Arc cosine of `x`, clamped to -1..1.
#[inline]
#[must_use]
pub fn acos(x: f32) -> f32 {
    libm::acosf(x.clamp(-1.0, 1.0))
}

/// Arc sine of `x`, clamped to -1..1.
#[inline]
#[must_use]
pub fn asin(x: f32) -> f32 {
    libm::asinf(x.clamp(-1.0, 1.0))
}

/// Sine and cosine for |x| <= pi/4 (a little more is harmless), within 2e-7: the minimax polynomials of
/// the Cephes library's sinf and cosf.
#[inline(always)]
#[must_use]
pub fn sin_cos_quarter(x: f32) -> (f32, f32) {
    let x2 = x * x;
    let sin = x + x * x2 * (-1.666_665_5e-1 + x2 * (8.332_161e-3 + x2 * -1.951_529_6e-4));
    let cos = 1.0 - 0.5 * x2 + x2 * x2 * (4.166_664_6e-2 + x2 * (-1.388_731_6e-3 + x2 * 2.443_315_7e-5));
    (sin, cos)
}

/// Angle of (x, y) from the x axis for y >= 0, 0 to pi, within 3e-7 of itself: the polynomial of Abramowitz
/// and Stegun 4.4.49. Without branches, so that loops over it become vector code.
#[inline(always)]
#[must_use]
pub fn upper_angle(y: f32, x: f32) -> f32 {
    let along = x.abs();
    let steep = y > along;
    let (less, more) = (select(steep, along, y), select(steep, y, along));
    let t = less / more;
    let s = t * t;
    let tail = 0.106_562_64 + s * (-0.075_289_64 + s * (0.042_909_614 + s * (-0.016_165_737 + s * 0.002_866_225_7)));
    let angle = t + t * s * (-0.333_331_45 + s * (0.199_935_51 + s * (-0.142_089 + s * tail)));
    let angle = select(steep, FRAC_PI_2 - angle, angle);
    select(x < 0.0, PI - angle, angle)
}

/// Sine and cosine for 0 <= x <= pi, within 3e-7. Without branches.
#[inline(always)]
#[must_use]
pub fn sin_cos_half_turn(x: f32) -> (f32, f32) {
    let (past_first, past_second) = (x > FRAC_PI_4, x > 3.0 * FRAC_PI_4);
    let quadrant = select(past_second, 2.0, select(past_first, 1.0, 0.0));
    // pi/2 in two parts, the first short enough for its multiples to be exact.
    let (sin, cos) = sin_cos_quarter((x - quadrant * 1.570_312_5) - quadrant * 4.838_268e-4);
    let (a, b) = (select(past_first, cos, sin), select(past_first, -sin, cos));
    (select(past_second, -sin, a), select(past_second, -cos, b))
}

/// Sine and cosine of `u` full turns, 0 <= u <= 1, within 3e-7: for azimuths. Without branches.
#[inline(always)]
#[must_use]
pub fn sin_cos_turns(u: f32) -> (f32, f32) {
    let quadrant = (4.0 * u + 0.5) as i32;
    let (sin, cos) = sin_cos_quarter((4.0 * u - quadrant as f32) * FRAC_PI_2);
    let odd = quadrant & 1 != 0;
    let (a, b) = (select(odd, cos, sin), select(odd, sin, cos));
    (select(quadrant & 2 != 0, -a, a), select((quadrant + 1) & 2 != 0, -b, b))
}

/// The unit square onto the unit disk, area to area (Shirley and Chiu 1997).
#[inline(always)]
#[must_use]
pub fn concentric_disk(u: Vec2) -> Vec2 {
    let (a, b) = (2.0 * u.x - 1.0, 2.0 * u.y - 1.0);
    // By selection, not by branches: loops over this become vector code.
    let wide = a.abs() > b.abs();
    let (radius, other) = (select(wide, a, b), select(wide, b, a));
    let ratio = select(radius == 0.0, 0.0, other / radius);
    let (sin, cos) = sin_cos_quarter(FRAC_PI_4 * ratio);
    Vec2::new(radius * select(wide, cos, sin), radius * select(wide, sin, cos))
}

/// A direction about +z with density cos/pi (Malley's method). Its z is never 0.
#[inline(always)]
#[must_use]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = concentric_disk(u);
    let z2 = 1.0 - d.x * d.x - d.y * d.y;
    Vec3::new(d.x, d.y, select(z2 > 1e-12, z2, 1e-12).sqrt())
}

/// A direction about +z with density 1/(2 pi): the disk lifted area to area, so strata stay compact.
#[inline]
#[must_use]
pub fn uniform_hemisphere(u: Vec2) -> Vec3 {
    let d = concentric_disk(u);
    let r2 = (d.x * d.x + d.y * d.y).min(1.0);
    let d = d * (2.0 - r2).sqrt();
    Vec3::new(d.x, d.y, 1.0 - r2)
}

/// A direction with density 1/(4 pi).
#[inline]
#[must_use]
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = safe_sqrt(1.0 - z * z);
    let (sin, cos) = sin_cos_turns(u.y);
    Vec3::new(r * cos, r * sin, z)
}

/// A right-handed orthonormal basis: tangent, bitangent, normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Local x.
    pub t: Vec3,
    /// Local y.
    pub b: Vec3,
    /// Local z.
    pub n: Vec3,
}

impl Frame {
    /// A basis about the unit vector `n` (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    #[inline(always)]
    #[must_use]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            t: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            b: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// A basis about the unit vector `n` whose x lies along the part of `tangent` that is square to `n`;
    /// any basis about `n` where that part vanishes.
    #[inline]
    #[must_use]
    pub fn from_normal_tangent(n: Vec3, tangent: Vec3) -> Self {
        let square = tangent - n * n.dot(tangent);
        let length2 = square.length_squared();
        // Below this the direction is mostly rounding error.
        if !(length2 > 1e-10 * tangent.length_squared() && length2.is_finite()) {
            return Self::from_normal(n);
        }
        let t = square / length2.sqrt();
        // Once more: a tangent near the normal left a remainder as small as its own rounding error.
        let t = (t - n * n.dot(t)).normalize();
        Self { t, b: n.cross(t), n }
    }

    /// World to local.
    #[inline(always)]
    #[must_use]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.t), v.dot(self.b), v.dot(self.n))
    }

    /// Local to world.
    #[inline(always)]
    #[must_use]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.t * v.x + self.b * v.y + self.n * v.z
    }
}

/// Area density of [`uniform_hemisphere`].
pub const UNIFORM_HEMISPHERE_PDF: f32 = 1.0 / (2.0 * PI);
/// Area density of [`uniform_sphere`].
pub const UNIFORM_SPHERE_PDF: f32 = 1.0 / (4.0 * PI);

#[cfg(test)]
mod tests {
    use super::*;

    /// Centres of a fine grid over the unit square.
    fn grid(n: u32) -> impl Iterator<Item = Vec2> {
        (0..n * n).map(move |i| Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32)
    }

    #[test]
    fn polynomials_are_within_their_stated_errors() {
        for i in 0..=100_000 {
            let u = i as f32 / 100_000.0;
            let angle = f64::from(u) * std::f64::consts::TAU;
            let (sin, cos) = sin_cos_turns(u);
            assert!((f64::from(sin) - angle.sin()).abs() < 3e-7, "{u}");
            assert!((f64::from(cos) - angle.cos()).abs() < 3e-7, "{u}");
            let (sin, cos) = sin_cos_half_turn(u * PI);
            let half = f64::from(u * PI);
            assert!((f64::from(sin) - half.sin()).abs() < 3e-7 && (f64::from(cos) - half.cos()).abs() < 3e-7, "{u}");
            let found = f64::from(upper_angle(sin, cos));
            let expected = f64::from(sin.max(0.0)).atan2(f64::from(cos));
            assert!((found - expected).abs() <= 3e-7 * expected, "{u}: {found} {expected}");
            let x = (u - 0.5) * FRAC_PI_2;
            let (sin, cos) = sin_cos_quarter(x);
            assert!((f64::from(sin) - f64::from(x).sin()).abs() < 2e-7);
            assert!((f64::from(cos) - f64::from(x).cos()).abs() < 2e-7);
        }
    }

    #[test]
    fn frames_are_orthonormal_and_right_handed_for_every_direction() {
        let poles = [Vec3::Z, -Vec3::Z, Vec3::new(0.0, 1e-20, -1.0), Vec3::X, -Vec3::Y];
        for n in grid(64).map(uniform_sphere).chain(poles) {
            let n = n.normalize();
            for frame in [Frame::from_normal(n), Frame::from_normal_tangent(n, Vec3::new(0.3, -2.0, 0.1))] {
                let Frame { t, b, n } = frame;
                assert!((t.cross(b) - n).length() < 1e-5, "{n}");
                for (v, w, dot) in [(t, t, 1.0), (b, b, 1.0), (t, b, 0.0), (t, n, 0.0), (b, n, 0.0)] {
                    assert!((v.dot(w) - dot).abs() < 1e-5, "{n}");
                }
                let v = Vec3::new(0.2, -0.7, 0.4);
                assert!((frame.to_world(frame.to_local(v)) - v).length() < 1e-5);
            }
        }
    }

    #[test]
    fn a_tangent_along_the_normal_still_gives_a_frame() {
        for tangent in [Vec3::Z, Vec3::ZERO, Vec3::splat(f32::NAN)] {
            let frame = Frame::from_normal_tangent(Vec3::Z, tangent);
            assert!((frame.t.length() - 1.0).abs() < 1e-6, "{tangent}");
        }
    }

    #[test]
    fn maps_have_the_moments_of_their_densities() {
        let mean = |f: &dyn Fn(Vec2) -> f32| grid(512).map(|u| f64::from(f(u))).sum::<f64>() / (512.0 * 512.0);
        // E[z], E[z^2], E[x^2]: cosine 2/3, 1/2, 1/4; uniform hemisphere 1/2, 1/3, 1/3; sphere 0, 1/3, 1/3.
        type Map = fn(Vec2) -> Vec3;
        let maps: [(Map, [f64; 3]); 3] = [
            (cosine_hemisphere, [2.0 / 3.0, 0.5, 0.25]),
            (uniform_hemisphere, [0.5, 1.0 / 3.0, 1.0 / 3.0]),
            (uniform_sphere, [0.0, 1.0 / 3.0, 1.0 / 3.0]),
        ];
        for (map, [z, z2, x2]) in maps {
            assert!((mean(&|u| map(u).z) - z).abs() < 1e-4);
            assert!((mean(&|u| map(u).z * map(u).z) - z2).abs() < 1e-4);
            assert!((mean(&|u| map(u).x * map(u).x) - x2).abs() < 1e-4);
            assert!(mean(&|u| map(u).x * map(u).y).abs() < 1e-4);
            assert!(grid(64).all(|u| (map(u).length() - 1.0).abs() < 1e-5));
        }
        assert!((mean(&|u| concentric_disk(u).length_squared()) - 0.5).abs() < 1e-4);
    }

    #[test]
    fn corners_of_the_square_map_to_finite_directions() {
        for u in [Vec2::ZERO, Vec2::ONE, Vec2::X, Vec2::Y, Vec2::splat(0.5)] {
            for v in [cosine_hemisphere(u), uniform_hemisphere(u), uniform_sphere(u)] {
                assert!((v.length() - 1.0).abs() < 1e-5, "{u} {v}");
            }
            assert!(cosine_hemisphere(u).z > 0.0);
        }
    }

    #[test]
    fn gamma_bounds_roundings() {
        assert!(gamma(1) >= f32::EPSILON / 2.0 && gamma(3) > 3.0 * f32::EPSILON / 2.0 && gamma(3) < 1.9e-7);
    }
}
