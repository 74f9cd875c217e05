//! Fresnel reflectance at smooth boundaries: exact, and Schlick's approximation for comparison.
//!
//! Cosines are of the angle between a direction and the normal on its own side, 0 to 1.

pub mod metals;

use common::method::Fresnel;

use crate::math::{Rgb, Vec3};

/// How a dielectric boundary splits unpolarised light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Split {
    /// Share reflected, 0 to 1.
    pub reflected: f32,
    /// Cosine of the refracted direction; 0 under total reflection.
    pub cos_t: f32,
}

/// Cosine of the refracted direction by Snell's law, or `None` under total reflection.
///
/// `eta` is the index on the far side over the index on the near side. The square of the cosine is
/// ((eta - 1)(eta + 1) + cos^2) / eta^2: unlike 1 - (1 - cos^2) / eta^2 it does not cancel where the
/// indices nearly match, so that light at grazing angles passes a boundary between equal media.
#[inline]
#[must_use]
pub fn refracted_cosine(cos_i: f32, eta: f32) -> Option<f32> {
    let cos2 = ((eta - 1.0) * (eta + 1.0) + cos_i * cos_i) / (eta * eta);
    (cos2 > 0.0).then(|| cos2.sqrt().min(1.0))
}

/// Fresnel's equations for unpolarised light that meets a dielectric at cosine `cos_i`; `eta` is the
/// index on the far side over the index on the near side.
#[inline]
#[must_use]
pub fn dielectric(cos_i: f32, eta: f32) -> Split {
    let Some(cos_t) = refracted_cosine(cos_i, eta) else {
        return Split { reflected: 1.0, cos_t: 0.0 };
    };
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    Split { reflected: 0.5 * (perpendicular * perpendicular + parallel * parallel), cos_t }
}

/// Schlick's approximation (1994): F0 + (1 - F0) (1 - cos)^5.
#[inline]
#[must_use]
pub fn schlick(f0: f32, cos_i: f32) -> f32 {
    f0 + (1.0 - f0) * schlick_weight(cos_i)
}

/// (1 - cos)^5.
#[inline]
#[must_use]
pub fn schlick_weight(cos_i: f32) -> f32 {
    let m = (1.0 - cos_i).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Reflectance of a dielectric at normal incidence.
#[inline]
#[must_use]
pub fn normal_reflectance(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// How a dielectric boundary splits light by the chosen method.
///
/// Schlick's form takes the cosine on the side the light comes from, as in the textbooks, on both sides.
/// From the denser side it is therefore far too low up to the critical angle; past it, where no refracted
/// direction exists, it too reflects everything.
#[inline]
#[must_use]
pub fn split(method: Fresnel, cos_i: f32, eta: f32) -> Split {
    match method {
        Fresnel::Exact => dielectric(cos_i, eta),
        Fresnel::Schlick => match refracted_cosine(cos_i, eta) {
            Some(cos_t) => Split { reflected: schlick(normal_reflectance(eta), cos_i), cos_t },
            None => Split { reflected: 1.0, cos_t: 0.0 },
        },
    }
}

/// Fresnel's equations for unpolarised light that meets, from a medium of index 1, one of the complex
/// index `eta + i k`.
#[inline]
#[must_use]
pub fn conductor(cos_i: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos_i * cos_i;
    let sin2 = (1.0 - cos2).max(0.0);
    // sqrt((eta + i k)^2 - sin^2) = a + i b.
    let re = (eta - k) * (eta + k) - sin2;
    let modulus = (re * re + 4.0 * eta * eta * k * k).sqrt();
    // Of the two roots (modulus +- re) / 2 one cancels; a b = eta k gives it from the other.
    let a = if re >= 0.0 {
        (0.5 * (modulus + re)).sqrt()
    } else {
        let b = (0.5 * (modulus - re)).sqrt();
        if b > 0.0 { eta * k / b } else { 0.0 }
    };
    let twice = 2.0 * a * cos_i;
    let perpendicular = ratio(modulus + cos2 - twice, modulus + cos2 + twice);
    let (p, q) = (cos2 * modulus + sin2 * sin2, twice * sin2);
    let parallel = perpendicular * ratio(p - q, p + q);
    (0.5 * (perpendicular + parallel)).clamp(0.0, 1.0)
}

/// a / b, 1 where both vanish: light that only grazes is reflected.
#[inline]
fn ratio(a: f32, b: f32) -> f32 {
    if b > 0.0 { a / b } else { 1.0 }
}

/// A complex index of refraction per channel, relative to the medium outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComplexIndex {
    /// Real part.
    pub eta: Vec3,
    /// Imaginary part.
    pub k: Vec3,
}

impl ComplexIndex {
    /// Exact reflectance per channel.
    #[inline]
    #[must_use]
    pub fn reflectance(&self, cos_i: f32) -> Rgb {
        Rgb::new(
            conductor(cos_i, self.eta.x, self.k.x),
            conductor(cos_i, self.eta.y, self.k.y),
            conductor(cos_i, self.eta.z, self.k.z),
        )
    }
}

/// Schlick's approximation per channel.
#[inline]
#[must_use]
pub fn schlick_rgb(f0: Rgb, cos_i: f32) -> Rgb {
    f0 + (Rgb::ONE - f0) * schlick_weight(cos_i)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The textbook form in f64.
    fn reference(cos_i: f64, eta: f64) -> f64 {
        let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
        if sin2_t >= 1.0 {
            return 1.0;
        }
        let cos_t = (1.0 - sin2_t).sqrt();
        let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
        let p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
        0.5 * (s * s + p * p)
    }

    #[test]
    fn the_known_points_of_glass() {
        let eta = 1.5f32;
        assert!((dielectric(1.0, eta).reflected - 0.04).abs() < 1e-7);
        assert_eq!(dielectric(0.0, eta).reflected, 1.0);
        // Brewster's angle, tan = eta: the parallel part vanishes, half of ((eta^2 - 1)/(eta^2 + 1))^2 is left.
        let brewster = 1.0 / (1.0 + eta * eta).sqrt();
        let s = (eta * eta - 1.0) / (eta * eta + 1.0);
        assert!((dielectric(brewster, eta).reflected - 0.5 * s * s).abs() < 1e-6);
        // The critical angle from inside, sin = 1 / eta.
        let critical = (1.0 - 1.0 / (eta * eta)).sqrt();
        assert_eq!(dielectric(critical * 0.999, 1.0 / eta), Split { reflected: 1.0, cos_t: 0.0 });
        assert!(dielectric(critical * 1.001, 1.0 / eta).reflected < 1.0);
    }

    #[test]
    fn both_sides_agree_along_a_refracted_path_and_with_f64() {
        for eta in [1.0f32, 1.0001, 1.33, 1.5, 2.4, 10.0, 0.7] {
            for i in 1..=1000 {
                let cos_i = i as f32 / 1000.0;
                let there = dielectric(cos_i, eta);
                // At the critical angle the curve is vertical.
                let bound = 2e-6 + 2e-7 / f64::from(there.cos_t.max(1e-2));
                assert!(
                    (f64::from(there.reflected) - reference(cos_i.into(), eta.into())).abs() < bound,
                    "{eta} {cos_i}"
                );
                // The way back divides a difference of squares, rounded to f32, by the small cosine.
                if there.cos_t > 0.2 && cos_i > 0.2 {
                    let back = dielectric(there.cos_t, 1.0 / eta);
                    assert!((back.reflected - there.reflected).abs() < 1e-4, "{eta} {cos_i}");
                    assert!((back.cos_t - cos_i).abs() < 1e-4, "{eta} {cos_i}");
                }
            }
        }
    }

    #[test]
    fn equal_media_reflect_nothing_at_any_angle() {
        // 1 - (1 - cos^2) / eta^2 in f32 is 0 here: total reflection where there is no boundary.
        for cos_i in [1.0, 0.1, 1e-3, 1e-5, 1e-10] {
            assert_eq!(dielectric(cos_i, 1.0), Split { reflected: 0.0, cos_t: cos_i });
        }
    }

    #[test]
    fn a_metal_without_absorption_is_a_dielectric() {
        for eta in [0.6f32, 1.0, 1.5, 3.0] {
            for i in 0..=200 {
                let cos = i as f32 / 200.0;
                let (metal, glass) = (conductor(cos, eta, 0.0), dielectric(cos, eta).reflected);
                let bound = if (eta - 1.0).abs() < 1e-6 && cos < 0.1 { 1.0 } else { 2e-3 };
                assert!((metal - glass).abs() < bound, "{eta} {cos}: {metal} {glass}");
            }
        }
    }

    #[test]
    fn metals_agree_with_complex_arithmetic_in_f64() {
        for (eta, k) in [(0.05f32, 3.6f32), (0.13, 4.1), (1.5, 7.6), (3.2, 3.3), (10.0, 0.01), (1e-3, 20.0)] {
            for i in 0..=200 {
                let cos = f64::from(i) / 200.0;
                // w = sqrt(n^2 - sin^2) with n = eta + i k.
                let (e, m) = (f64::from(eta), f64::from(k));
                let n2 = (e * e - m * m, 2.0 * e * m);
                let (re, im) = (n2.0 - 1.0 + cos * cos, n2.1);
                let r = re.hypot(im);
                let w = ((0.5 * (r + re)).max(0.0).sqrt(), (0.5 * (r - re)).max(0.0).sqrt());
                let square = |re: f64, im: f64| re * re + im * im;
                let s = square(cos - w.0, w.1) / square(cos + w.0, w.1);
                let p = square(n2.0 * cos - w.0, n2.1 * cos - w.1) / square(n2.0 * cos + w.0, n2.1 * cos + w.1);
                let found = f64::from(conductor(cos as f32, eta, k));
                assert!((found - 0.5 * (s + p)).abs() < 3e-6, "{eta} {k} {cos}: {found} {}", 0.5 * (s + p));
            }
        }
    }

    #[test]
    fn schlick_fails_where_it_is_known_to() {
        let worst = |eta: f32| {
            let error = |i: i32| {
                let cos = i as f32 / 100_000.0;
                // The raw form, without the total reflection that a path tracer adds to it.
                (schlick(normal_reflectance(eta), cos) - dielectric(cos, eta).reflected).abs()
            };
            (0..=100_000).map(error).fold(0.0, f32::max)
        };
        assert!((worst(1.5) - 0.036).abs() < 1e-3, "{}", worst(1.5));
        assert!((worst(1.0 / 1.5) - 0.96).abs() < 2e-3, "{}", worst(1.0 / 1.5));
        let relative = (0..=1000)
            .map(|i| i as f32 / 1000.0)
            .map(|cos| (schlick(0.04, cos) / dielectric(cos, 1.5).reflected - 1.0).abs())
            .fold(0.0, f32::max);
        assert!((relative - 0.23).abs() < 0.01, "{relative}");
    }
}
