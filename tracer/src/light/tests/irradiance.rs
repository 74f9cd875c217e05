//! Whole lights: irradiance by sampling against closed forms, for every way to choose lights and points.

use std::f64::consts::PI;

use super::*;
use crate::math::DVec3;

const PICKS: [LightPick; 4] = [LightPick::All, LightPick::One, LightPick::Power, LightPick::Tree];

/// Irradiance at `reference` by light sampling, with its standard error. On the way every sample is checked
/// against the density evaluated for it.
fn irradiance(lights: &Lights, reference: &Reference, rounds: u32) -> (f64, f64) {
    let mut rng = Rng::new(7);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..rounds {
        let mut value = 0.0;
        lights.for_each(
            reference,
            Stratum::ONLY,
            || (rng.next(), rng.next_2d()),
            |sample| {
                assert!(sample.pdf > 0.0 && sample.pdf.is_finite() && sample.wi.is_finite());
                let evaluated = match sample.emitter {
                    Some(emitter) => lights.pdf(reference, emitter, sample.point),
                    None if sample.delta => sample.pdf,
                    None => lights.environment_pdf(reference, sample.wi),
                };
                assert_eq!(sample.pdf, evaluated, "{sample:?}");
                value += f64::from(sample.radiance.x * reference.n.dot(sample.wi).max(0.0) / sample.pdf);
            },
        );
        sum += value;
        squares += value * value;
    }
    let n = f64::from(rounds);
    (sum / n, ((squares / n - (sum / n) * (sum / n)).max(0.0) / n).sqrt())
}

fn check(name: &str, lights: &Lights, reference: &Reference, expected: f64) {
    let (mean, error) = irradiance(lights, reference, 40_000);
    assert!((mean - expected).abs() <= 4.5 * error + 2e-5 * expected, "{name}: {mean} +- {error}, expected {expected}");
}

fn area(emitters: Vec<Emitter>, two_sided: bool) -> AreaLight {
    AreaLight { emitters, radiance: Vec3::splat(2.0), two_sided }
}

fn build(areas: Vec<AreaLight>, pick: LightPick, sampling: LightSampling) -> Lights {
    Lights::build(LightSources { areas, scene_radius: 10.0, ..LightSources::default() }, &method(pick, sampling))
}

/// Lambert's formula: L / 2 times the sum over the edges of angle times cosine between the normal and the
/// edge's plane. The polygon must lie above the horizon.
fn lambert(corners: &[Vec3], reference: &Reference, radiance: f64) -> f64 {
    let v: Vec<DVec3> = corners.iter().map(|c| (c.as_dvec3() - reference.p.as_dvec3()).normalize()).collect();
    let sum: f64 = (0..v.len())
        .map(|i| {
            let (a, b) = (v[i], v[(i + 1) % v.len()]);
            let cross = a.cross(b);
            cross.length().atan2(a.dot(b)) * cross.normalize().dot(reference.n.as_dvec3())
        })
        .sum();
    0.5 * radiance * sum.abs()
}

#[test]
fn a_sphere_gives_pi_l_r2_over_d2_cos() {
    let p = Vec3::new(0.3, -0.2, 0.1);
    let n = Vec3::new(0.6, 0.0, 0.8);
    for (radius, distance) in [(0.5f32, 2.0f32), (0.6, 1.0), (0.01, 3.0)] {
        for sampling in SAMPLINGS {
            let sphere = Emitter::Sphere { center: p + Vec3::Z * distance, radius };
            let lights = build(vec![area(vec![sphere], false)], LightPick::One, sampling);
            // Whole above the horizon: sin of its half angle is at most cos 36.9 degrees = 0.8.
            let expected = 2.0 * PI * f64::from(radius / distance).powi(2) * 0.8;
            check(&format!("{sampling} {radius}/{distance}"), &lights, &Reference { p, n }, expected);
        }
    }
}

#[test]
fn inside_a_sphere_that_shines_inwards_irradiance_is_pi_l() {
    for sampling in SAMPLINGS {
        let sphere = Emitter::Sphere { center: Vec3::ZERO, radius: 1.0 };
        let reference = Reference { p: Vec3::new(0.4, 0.3, 0.2), n: Vec3::Z };
        let lights = build(vec![area(vec![sphere], true)], LightPick::One, sampling);
        check("inside", &lights, &reference, 2.0 * PI);
        let outwards = build(vec![area(vec![sphere], false)], LightPick::One, sampling);
        assert_eq!(irradiance(&outwards, &reference, 1000).0, 0.0);
        assert_eq!(outwards.pdf(&reference, 0, Vec3::Z), 0.0);
    }
}

#[test]
fn triangles_and_rectangles_follow_lamberts_formula() {
    let corners =
        [Vec3::new(-1.0, -0.5, 1.2), Vec3::new(-1.0, 1.5, 1.2), Vec3::new(2.0, 1.5, 1.8), Vec3::new(2.0, -0.5, 1.8)];
    let reference = Reference { p: Vec3::new(0.2, 0.1, -0.3), n: Vec3::Z };
    let [a, b, c, d] = corners;
    let triangles = vec![Emitter::Triangle { p: [a, b, c] }, Emitter::Triangle { p: [a, c, d] }];
    let rectangle = Emitter::from_quad(corners);
    assert_eq!(rectangle.len(), 1);
    let expected = lambert(&corners, &reference, 2.0);
    for sampling in SAMPLINGS {
        for pick in PICKS {
            for emitters in [triangles.clone(), rectangle.clone()] {
                let lights = build(vec![area(emitters.clone(), false)], pick, sampling);
                check(&format!("{pick} {sampling}"), &lights, &reference, expected);
                // The back is dark unless both sides shine.
                let behind = Reference { p: Vec3::new(0.2, 0.1, 4.0), n: -Vec3::Z };
                assert_eq!(irradiance(&lights, &behind, 100).0, 0.0);
                let lights = build(vec![area(emitters, true)], pick, sampling);
                check(&format!("{pick} {sampling} back"), &lights, &behind, lambert(&corners, &behind, 2.0));
            }
        }
    }
}

#[test]
fn a_disk_overhead_gives_pi_l_r2_over_r2_plus_d2() {
    let disk = Emitter::Disk { center: Vec3::new(1.0, 2.0, 3.0), normal: -Vec3::Z, radius: 1.5 };
    let reference = Reference { p: Vec3::new(1.0, 2.0, 1.0), n: Vec3::Z };
    for sampling in SAMPLINGS {
        let lights = build(vec![area(vec![disk], false)], LightPick::One, sampling);
        check("disk", &lights, &reference, 2.0 * PI * 2.25 / (2.25 + 4.0));
    }
}

#[test]
fn lights_without_a_surface_follow_the_inverse_square_and_the_cone() {
    let reference = Reference { p: Vec3::new(1.0, 0.0, 0.0), n: Vec3::Z };
    let lit = |light: DeltaLight| {
        let sources = LightSources { deltas: vec![light], scene_radius: 1.0, ..LightSources::default() };
        irradiance(&Lights::build(sources, &Method::default()), &reference, 10).0
    };
    // 3 / 25 x cos, cos = 4/5.
    let point = DeltaLight::Point { position: Vec3::new(4.0, 0.0, 4.0), intensity: Vec3::splat(3.0) };
    assert!((lit(point) - 3.0 / 25.0 * 0.8).abs() < 1e-7);
    assert!((lit(DeltaLight::Directional { direction: -Vec3::Z, irradiance: Vec3::splat(5.0) }) - 5.0).abs() < 1e-6);
    let spot = |target: [f64; 3], cutoff_angle: f64, beam_angle: f64| {
        let light = serde_json::json!({
            "type": "spot", "position": [1, 0, 2], "target": target, "intensity": 3,
            "cutoff_angle": cutoff_angle, "beam_angle": beam_angle,
        });
        lit(DeltaLight::from_scene(&serde_json::from_value(light).unwrap()).unwrap())
    };
    // Straight above: full strength on the axis; half of it where the cosine is midway; dark past the edge.
    assert!((spot([1.0, 0.0, 0.0], 20.0, 10.0) - 0.75).abs() < 1e-6);
    let midway = ((10f64.to_radians().cos() + 20f64.to_radians().cos()) / 2.0).acos();
    assert!((spot([1.0 + 2.0 * midway.tan(), 0.0, 0.0], 20.0, 10.0) - 0.375).abs() < 1e-4);
    assert_eq!(spot([3.0, 0.0, 0.0], 20.0, 10.0), 0.0);
    assert!((spot([1.5, 0.0, 0.0], 20.0, 20.0) - 0.75).abs() < 1e-4);
}

#[test]
fn many_lights_add_up_however_they_are_chosen() {
    let corners =
        [Vec3::new(-1.0, -1.0, 2.0), Vec3::new(-1.0, 1.0, 2.0), Vec3::new(1.0, 1.0, 2.0), Vec3::new(1.0, -1.0, 2.0)];
    let reference = Reference { p: Vec3::ZERO, n: Vec3::Z };
    let sphere = Emitter::Sphere { center: Vec3::new(3.0, 0.0, 4.0), radius: 0.5 };
    let below = Emitter::Sphere { center: Vec3::new(3.0, 0.0, -4.0), radius: 0.5 };
    let dark = AreaLight { radiance: Vec3::ZERO, ..area(vec![sphere], false) };
    let sources = LightSources {
        areas: vec![
            area(Emitter::from_quad(corners), false),
            dark,
            area(vec![sphere], false),
            area(vec![below], false),
        ],
        deltas: vec![
            DeltaLight::Point { position: Vec3::new(0.0, 3.0, 4.0), intensity: Vec3::splat(10.0) },
            DeltaLight::Directional { direction: -Vec3::Z, irradiance: Vec3::splat(1.0) },
        ],
        environment: Some(Environment::Constant(Vec3::splat(0.5))),
        scene_radius: 5.0,
    };
    let expected = lambert(&corners, &reference, 2.0) + 2.0 * PI * 0.01 * 0.8 + 10.0 / 25.0 * 0.8 + 1.0 + 0.5 * PI;
    for pick in PICKS {
        for sampling in SAMPLINGS {
            let lights = Lights::build(sources.clone(), &method(pick, sampling));
            check(&format!("{pick} {sampling}"), &lights, &reference, expected);
        }
    }
    // The default too, and `sample` where it chooses one.
    check("default", &Lights::build(sources.clone(), &Method::default()), &reference, expected);
    let lights = Lights::build(sources, &method(LightPick::All, LightSampling::Area));
    let (mut rng, mut sum) = (Rng::new(1), 0.0);
    for _ in 0..200_000 {
        if let Some(sample) = lights.sample(&reference, rng.next(), rng.next_2d()) {
            sum += f64::from(sample.radiance.x * sample.wi.z.max(0.0) / sample.pdf);
        }
    }
    assert!((sum / 200_000.0 / expected - 1.0).abs() < 0.02);
}

#[test]
fn an_area_density_does_not_overflow() {
    let triangle = Emitter::Triangle { p: [Vec3::ZERO, Vec3::X * 1e-10, Vec3::Y * 1e-10] };
    for distance in [1e10f32, 1e19, 1e25, 1e38] {
        for sampling in SAMPLINGS {
            let from = Vec3::new(0.0, 0.0, distance);
            let pdf = triangle.pdf(sampling, from, Vec3::ZERO);
            assert!(pdf > 0.0 && pdf.is_finite(), "{distance} {pdf}");
        }
    }
    assert_eq!(textbook::area_pdf(1e20, 1.0, 1.0), f32::INFINITY);
}
