//! Fresnel reflectance at smooth boundaries: exact, and Schlick's approximation for comparison.
//!
//! Cosines are of the angle between a direction and the normal on its own side, 0 to 1.

use common::method::Fresnel;

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
}
