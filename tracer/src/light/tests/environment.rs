//! Pictures of the surroundings: orientation, density, and light that adds up.

use std::{f64::consts::PI, sync::Arc};

use super::*;
use crate::{
    integrator::power_heuristic,
    math::{DAffine3, DVec3, Frame, INV_PI, cosine_hemisphere, uniform_sphere},
    testing::{ChiSquare, Directions, chi_square},
};

/// A picture with a small sun, a gradient and black parts.
fn picture(width: usize, height: usize) -> Vec<Rgb> {
    (0..width * height)
        .map(|i| {
            let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
            let sun = if i == height / 3 * width + width / 5 { 400.0 } else { 0.0 };
            let sky = if y < 0.5 { 1.0 + x } else { 0.0 };
            Vec3::new(sky, sky * y, sky * 0.5) + sun
        })
        .collect()
}

fn rotation() -> DAffine3 {
    DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.8)
}

fn image(width: usize, height: usize, to_world: &DAffine3) -> ImageEnvironment {
    ImageEnvironment::new(width, height, picture(width, height), Vec3::ONE, to_world).unwrap()
}

#[test]
fn the_middle_looks_along_minus_z_the_right_along_plus_x_and_the_top_up() {
    // One bright pixel in 8 x 4; looked up at the centres of pixels.
    let bright = |x: usize, y: usize, to_world: &DAffine3, wi: Vec3| {
        let mut pixels = vec![Vec3::ZERO; 32];
        pixels[y * 8 + x] = Vec3::ONE;
        ImageEnvironment::new(8, 4, pixels, Vec3::splat(3.0), to_world).unwrap();
        let mut pixels = vec![Vec3::ZERO; 32];
        pixels[y * 8 + x] = Vec3::ONE;
        let image = ImageEnvironment::new(8, 4, pixels, Vec3::splat(3.0), to_world).unwrap();
        Environment::Image(Arc::new(image)).radiance(wi.normalize()).x
    };
    let none = DAffine3::IDENTITY;
    let turn = |x: f64| (x * 2.0 * PI) as f32;
    // Column 4 is centred half a column (22.5 degrees) right of -z; row 1 at a polar angle of 67.5 degrees.
    let direction =
        |azimuth: f32, polar: f32| Vec3::new(azimuth.sin() * polar.sin(), polar.cos(), -azimuth.cos() * polar.sin());
    let polar = 67.5f32.to_radians();
    assert!((bright(4, 1, &none, direction(turn(1.0 / 16.0), polar)) - 3.0).abs() < 1e-5);
    // A quarter turn right of -z is +x: columns 5 and 6 meet there.
    assert!((bright(5, 1, &none, direction(turn(0.25), polar)) - 1.5).abs() < 1e-5);
    assert!((bright(6, 1, &none, direction(turn(0.25), polar)) - 1.5).abs() < 1e-5);
    // The seam is at +z, and wraps.
    assert!((bright(7, 1, &none, direction(turn(0.5), polar)) - 1.5).abs() < 1e-5);
    assert!((bright(0, 1, &none, direction(turn(0.5), polar)) - 1.5).abs() < 1e-5);
    assert!(bright(2, 0, &none, Vec3::new(-0.3, 1.0, 0.0)) > 0.0);
    assert!(bright(2, 3, &none, Vec3::new(-0.3, -1.0, 0.0)) > 0.0);
    // A quarter turn about y carries -z to -x.
    let to_world = DAffine3::from_rotation_y(PI / 2.0);
    let seen = bright(4, 1, &to_world, direction(turn(1.0 / 16.0 - 0.25), polar));
    assert!((seen - 3.0).abs() < 1e-5, "{seen}");
}

#[test]
fn directions_fall_where_the_density_says() {
    for (width, height) in [(1, 1), (2, 1), (4, 2), (16, 8), (37, 19)] {
        for to_world in [DAffine3::IDENTITY, rotation()] {
            let environment = Environment::Image(Arc::new(image(width, height, &to_world)));
            // Steps at the cells' edges are beyond an adaptive integral: cells of the test are those of the
            // picture, cut in four, in its own space.
            let (columns, rows) = (2 * width, 2 * height);
            let inverse = to_world.inverse();
            let mut counts = vec![0; columns * rows];
            let mut rng = Rng::new(11);
            let samples = 200_000;
            for _ in 0..samples {
                let wi = environment.sample(Vec3::ZERO, rng.next_2d());
                assert!(environment.pdf(Vec3::ZERO, wi) > 0.0);
                assert!((wi.length() - 1.0).abs() < 1e-5);
                let d = inverse.transform_vector3(wi.as_dvec3());
                let turn = d.x.atan2(-d.z) / (2.0 * PI) + 0.5;
                let polar = d.y.clamp(-1.0, 1.0).acos() / PI;
                let cell = |t: f64, n: usize| ((t * n as f64) as usize).min(n - 1);
                counts[cell(polar, rows) * columns + cell(turn, columns)] += 1;
            }
            let mut total = 0.0;
            let expected: Vec<f64> = (0..columns * rows)
                .map(|i| {
                    let (x, y) = (i % columns, i / columns);
                    let polar = |y: f64| PI * y / rows as f64;
                    let solid = 2.0 * PI / columns as f64 * (polar(y as f64).cos() - polar(y as f64 + 1.0).cos());
                    let (sin, cos) = polar(y as f64 + 0.5).sin_cos();
                    let azimuth = 2.0 * PI * ((x as f64 + 0.5) / columns as f64 - 0.5);
                    let d = DVec3::new(sin * azimuth.sin(), cos, -sin * azimuth.cos());
                    let wi = to_world.transform_vector3(d).as_vec3();
                    let share = f64::from(environment.pdf(Vec3::ZERO, wi)) * solid;
                    total += share;
                    share * f64::from(samples)
                })
                .collect();
            assert!((total - 1.0).abs() < 1e-5, "{width} x {height}: {total}");
            // Rounding may carry a sample over the edge of a cell that is black.
            let stray: u32 = counts.iter().zip(&expected).filter(|(_, e)| **e == 0.0).map(|(c, _)| c).sum();
            assert!(stray <= 5, "{stray}");
            let (counts, expected): (Vec<u32>, Vec<f64>) =
                counts.iter().zip(&expected).filter(|(_, e)| **e > 0.0).unzip();
            if width * height > 1 {
                check_counts(&format!("{width} x {height}"), &counts, &expected);
            }
        }
    }
}

#[test]
fn light_sampling_finds_all_that_the_lookup_shows() {
    for (width, height) in [(1, 1), (3, 2), (16, 8), (64, 32)] {
        let environment = Environment::Image(Arc::new(image(width, height, &rotation())));
        let mut rng = Rng::new(12);
        let n = 400_000;
        let (mut by_light, mut squares, mut by_chance) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let wi = environment.sample(Vec3::ZERO, rng.next_2d());
            let value = f64::from(environment.radiance(wi).x / environment.pdf(Vec3::ZERO, wi));
            by_light += value;
            squares += value * value;
            let wi = uniform_sphere(rng.next_2d());
            let radiance = environment.radiance(wi);
            by_chance += f64::from(radiance.x) * 4.0 * PI;
            assert!(radiance.max_element() == 0.0 || environment.pdf(Vec3::ZERO, wi) > 0.0, "{wi} is never sampled");
        }
        let n = f64::from(n);
        let deviation = (squares / n - (by_light / n).powi(2)).max(0.0).sqrt();
        // A cell of a tiny picture is so large that the picture varies within it.
        let bound = if height >= 8 { 0.6 } else { 1.0 };
        assert!(deviation < bound * by_light / n, "{width} x {height}: deviation {deviation} of {}", by_light / n);
        assert!((by_light / by_chance - 1.0).abs() < 0.06, "{width} x {height}: {by_light} {by_chance}");
    }
}

/// Irradiance by light and cosine sampling under MIS: the picture's mean left to the cosine changes no mean, and
/// lessens the noise where a lamp stands in a bright sky.
#[test]
fn what_compensation_leaves_out_is_found_by_the_other_way() {
    let (width, height) = (32, 16);
    let mut pixels = vec![Vec3::ONE; width * height];
    pixels[5 * width + 20] = Vec3::splat(100.0);
    let plain = ImageEnvironment::new(width, height, pixels, Vec3::ONE, &DAffine3::IDENTITY).unwrap();
    let estimate = |image: ImageEnvironment| {
        let environment = Environment::Image(Arc::new(image));
        let n = Vec3::new(0.0, 0.8, 0.6);
        let mut rng = Rng::new(21);
        let (mut sum, mut squares, mut never) = (0.0, 0.0, 0);
        let count = 200_000;
        for _ in 0..count {
            let cosine = |wi: Vec3| n.dot(wi).max(0.0) * INV_PI;
            let weight = |wi: Vec3| environment.radiance(wi).x * n.dot(wi).max(0.0);
            let (light, chance) = (environment.sample(n, rng.next_2d()), cosine_hemisphere(rng.next_2d()));
            let chance = Frame::from_normal(n).to_world(chance);
            let (p, q) = (environment.pdf(n, light), environment.pdf(n, chance));
            never += i32::from(q == 0.0);
            let by_light = power_heuristic(p, cosine(light)) * weight(light) / p;
            let by_chance = power_heuristic(cosine(chance), q) * weight(chance) / cosine(chance);
            let value = f64::from(by_light + by_chance);
            sum += value;
            squares += value * value;
        }
        let mean = sum / f64::from(count);
        (mean, (squares / f64::from(count) - mean * mean) / f64::from(count), never)
    };
    let ((a, va, none), (b, vb, some)) = (estimate(plain.clone()), estimate(plain.compensated()));
    assert!((a - b).abs() < 4.5 * (va + vb).sqrt(), "{a} {b}");
    assert!(none == 0 && some > 1000, "{none} {some}");
    assert!(vb < 0.8 * va, "variances {vb} and {va}");
    // The same all over: nothing stands out, and nothing is left out.
    let even = ImageEnvironment::new(8, 4, vec![Vec3::splat(0.3); 32], Vec3::ONE, &DAffine3::IDENTITY).unwrap();
    let (_, _, never) = estimate(even.compensated());
    assert_eq!(never, 0);
}

#[test]
fn a_large_picture_shares_cells_and_misses_nothing() {
    // 4099 is a prime: no block of pixels divides it.
    let (width, height) = (4099, 1031);
    let mut pixels = vec![Vec3::ZERO; width * height];
    for spot in [(0, 0), (4098, 1030), (2049, 500), (1234, 515)] {
        pixels[spot.1 * width + spot.0] = Vec3::splat(1000.0);
    }
    let image = ImageEnvironment::new(width, height, pixels, Vec3::ONE, &DAffine3::IDENTITY).unwrap();
    let environment = Environment::Image(Arc::new(image));
    for (x, y) in [(0, 0), (4098, 1030), (2049, 500), (1234, 515)] {
        for (dx, dy) in [(0.5, 0.5), (0.01, 0.5), (0.99, 0.01), (-0.4, 0.4), (1.4, 0.6)] {
            let azimuth = 2.0 * PI * ((f64::from(x) + dx) / width as f64 - 0.5);
            let polar = PI * (f64::from(y) + dy) / height as f64;
            let d = DVec3::new(polar.sin() * azimuth.sin(), polar.cos(), -polar.sin() * azimuth.cos()).as_vec3();
            assert!(environment.radiance(d).x == 0.0 || environment.pdf(Vec3::ZERO, d) > 0.0, "{x} {y} {dx} {dy}");
        }
    }
    let mut rng = Rng::new(2);
    let lit = (0..10_000).filter(|_| environment.radiance(environment.sample(Vec3::ZERO, rng.next_2d())).x > 0.0);
    assert!(lit.count() > 2_000);
}

#[test]
fn bad_pixels_are_dark_and_pictures_without_pixels_are_refused() {
    let pixels = vec![Vec3::splat(f32::NAN), Vec3::splat(-1.0), Vec3::splat(f32::INFINITY), Vec3::ONE];
    let image = ImageEnvironment::new(2, 2, pixels, Vec3::ONE, &DAffine3::IDENTITY).unwrap();
    let mut rng = Rng::new(1);
    for _ in 0..1000 {
        let wi = uniform_sphere(rng.next_2d());
        assert!(image.radiance(wi).is_finite() && image.radiance(wi).min_element() >= 0.0);
    }
    assert!(ImageEnvironment::new(0, 4, vec![], Vec3::ONE, &DAffine3::IDENTITY).is_none());
    assert!(ImageEnvironment::new(2, 4, vec![Vec3::ONE; 7], Vec3::ONE, &DAffine3::IDENTITY).is_none());
    // A black picture is no light.
    let black = ImageEnvironment::new(2, 1, vec![Vec3::ZERO; 2], Vec3::ONE, &DAffine3::IDENTITY).unwrap();
    let sources = LightSources { environment: Some(Environment::Image(Arc::new(black))), ..LightSources::default() };
    assert!(Lights::build(sources, &Method::default()).is_dark());
}

#[test]
fn a_constant_environment_is_sampled_by_cosine_on_surfaces_and_uniformly_elsewhere() {
    let environment = Environment::Constant(Vec3::splat(0.25));
    for n in [Vec3::ZERO, Vec3::new(0.6, 0.0, -0.8)] {
        let axis = if n == Vec3::ZERO { Vec3::Z } else { n };
        chi_square(
            ChiSquare {
                name: "constant",
                directions: Directions::about(axis, 1.0),
                samples: 100_000,
                comparisons: 2,
                agreement: 1e-4,
            },
            |rng| {
                let wi = environment.sample(n, rng.next_2d());
                Some((wi, environment.pdf(n, wi)))
            },
            |wi| environment.pdf(n, wi),
        );
    }
    // So a furnace without walls has no noise: radiance cos / pi over cos / pi.
    let mut rng = Rng::new(3);
    for _ in 0..1000 {
        let wi = environment.sample(Vec3::Z, rng.next_2d());
        let value = 0.25 * wi.z * INV_PI / environment.pdf(Vec3::Z, wi);
        assert!((value - 0.25).abs() < 1e-6);
    }
    assert!(cosine_hemisphere(Vec2::splat(0.3)).z > 0.0);
}
