//! Whole lights: irradiance against closed forms, and densities against the samples that carry them.

use std::f64::consts::PI;

use common::method::{LightPick, LightSampling, Method};

use super::*;

/// SplitMix64: numbers for tests.
pub(super) struct Random(pub u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(super) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }

    pub(super) fn square(&mut self) -> Vec2 {
        Vec2::new(self.unit(), self.unit())
    }
}

fn method(pick: LightPick, sampling: LightSampling) -> Method {
    Method { light_pick: Some(pick), light_sampling: Some(sampling), ..Method::default() }
}

/// Irradiance at `reference` by light sampling, with its standard error.
fn irradiance(lights: &Lights, reference: &Reference, samples: u32) -> (f64, f64) {
    let mut random = Random(7);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..samples {
        let mut value = 0.0;
        lights.for_each(
            reference,
            Stratum::ONLY,
            || (random.unit(), random.square()),
            |sample| {
                assert!(sample.pdf > 0.0 && sample.pdf.is_finite() && sample.wi.is_finite());
                value += f64::from(sample.radiance.x * reference.n.dot(sample.wi).max(0.0) / sample.pdf);
            },
        );
        sum += value;
        squares += value * value;
    }
    let n = f64::from(samples);
    (sum / n, ((squares / n - (sum / n) * (sum / n)).max(0.0) / n).sqrt())
}

fn check_irradiance(lights: &Lights, reference: &Reference, expected: f64) {
    let (mean, error) = irradiance(lights, reference, 200_000);
    assert!((mean - expected).abs() <= 4.5 * error + 2e-5 * expected, "{mean} +- {error}, expected {expected}");
}

const SAMPLINGS: [LightSampling; 3] = [LightSampling::Area, LightSampling::Stratified, LightSampling::SolidAngle];

#[test]
fn a_sphere_light_gives_pi_l_r2_over_d2() {
    // Facing normal: E = pi L (r/d)^2 for any sphere outside.
    let reference = Reference { p: Vec3::new(0.3, -0.2, 0.1), n: Vec3::Z };
    for (radius, distance) in [(0.5f32, 2.0f32), (0.9, 1.0), (0.01, 3.0)] {
        for sampling in SAMPLINGS {
            let sphere = Emitter::Sphere { center: reference.p + Vec3::Z * distance, radius };
            let light = AreaLight { emitters: vec![sphere], radiance: Vec3::splat(2.0), two_sided: false };
            let sources = LightSources { areas: vec![light], ..LightSources::default() };
            let lights = Lights::build(sources, &method(LightPick::One, sampling));
            check_irradiance(&lights, &reference, 2.0 * PI * f64::from(radius / distance).powi(2));
        }
    }
}
