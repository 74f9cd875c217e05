//! The choice of the light: do probabilities add up, are they met, and do they keep when the scene scales?

use super::*;
use crate::math::uniform_sphere;

/// Small lights of many kinds in a box about 10 wide, some in one place.
fn scattered(count: usize, scale: f32) -> LightSources {
    let mut rng = Rng::new(17);
    let mut sources = LightSources { scene_radius: 10.0 * scale, ..LightSources::default() };
    for i in 0..count {
        let at = (Vec3::new(rng.next(), rng.next(), rng.next()) * 10.0 - 5.0) * scale;
        let at = if i % 10 == 0 { Vec3::splat(scale) } else { at };
        let (x, y) = (uniform_sphere(rng.next_2d()), uniform_sphere(rng.next_2d()));
        let size = (0.05 + 0.4 * rng.next()) * scale;
        let emitter = match i % 4 {
            0 => Emitter::Triangle { p: [at, at + x * size, at + y * size] },
            1 => Emitter::Sphere { center: at, radius: size },
            2 => Emitter::Disk { center: at, normal: x, radius: size },
            _ => {
                let y = x.cross(y).normalize();
                Emitter::Rectangle { corner: at, edge_u: x * size, edge_v: y * size }
            }
        };
        let radiance = Vec3::splat(0.1 + 10.0 * rng.next() * rng.next());
        sources.areas.push(AreaLight { emitters: vec![emitter], radiance, two_sided: i % 3 == 0 });
    }
    // W/sr grows with the square of the scene, as the power of a surface of fixed radiance does.
    let intensity = Vec3::splat(0.5) * scale * scale;
    sources.deltas.push(DeltaLight::Point { position: Vec3::X * scale, intensity });
    sources.deltas.push(DeltaLight::Spot {
        position: Vec3::Y * scale,
        axis: Vec3::Z,
        intensity,
        cos_beam: 0.9,
        cos_cutoff: 0.7,
    });
    sources
}

fn places() -> Vec<Reference> {
    let mut rng = Rng::new(23);
    (0..30)
        .map(|i| Reference {
            p: uniform_sphere(rng.next_2d()) * [1.0, 6.0, 40.0, 1000.0][i % 4],
            n: if i % 3 == 0 { Vec3::ZERO } else { uniform_sphere(rng.next_2d()) },
        })
        .collect()
}

fn tree_of(lights: &Lights) -> &TreeChoice {
    match &lights.choice {
        Choice::Tree(tree) => tree,
        _ => unreachable!("built with a tree"),
    }
}

#[test]
fn tree_probabilities_add_up_and_are_met_to_the_bit() {
    for count in [1, 2, 3, 40, 300] {
        let lights = Lights::build(scattered(count, 1.0), &method(LightPick::Tree, LightSampling::Area));
        let tree = tree_of(&lights);
        for reference in places() {
            let mut rng = Rng::new(29);
            let samples = 20_000;
            let mut counts = vec![0; count + 3];
            for _ in 0..samples {
                let u = alias::lengthen(rng.next(), rng.next_2d());
                let Some((source, probability)) = tree.pick(&reference, u) else {
                    counts[count + 2] += 1;
                    continue;
                };
                assert_eq!(probability, tree.probability(&reference, source), "{source:?}");
                counts[match source {
                    Source::Emitter(i) => i as usize,
                    Source::Delta(i) => count + i as usize,
                    Source::Environment => unreachable!("there is none"),
                }] += 1;
            }
            let mut expected: Vec<f64> = (0..count as u32)
                .map(Source::Emitter)
                .chain([Source::Delta(0), Source::Delta(1)])
                .map(|source| f64::from(tree.probability(&reference, source)))
                .collect();
            let sum: f64 = expected.iter().sum();
            // Less than 1 where a walk may end between two children that do not matter.
            assert!(sum < 1.0 + 1e-5, "{sum}");
            expected.push((1.0 - sum).max(0.0));
            if expected[count + 2] < 1e-5 {
                assert_eq!(counts[count + 2], 0);
            }
            let expected: Vec<f64> = expected.iter().map(|p| p * f64::from(samples)).collect();
            if expected.iter().filter(|e| **e > 10.0).count() > 4 {
                check_counts(&format!("tree of {count} at {reference:?}"), &counts, &expected);
            }
        }
    }
}

#[test]
fn a_tree_never_gives_up_on_light_that_arrives() {
    let sources = scattered(200, 1.0);
    let lights = Lights::build(sources.clone(), &method(LightPick::Tree, LightSampling::Area));
    let tree = tree_of(&lights);
    let mut rng = Rng::new(31);
    for reference in places() {
        for (i, area) in sources.areas.iter().enumerate() {
            for _ in 0..20 {
                let Some(sample) =
                    area.emitters[0].sample(LightSampling::Area, reference.p, rng.next_2d(), Stratum::ONLY)
                else {
                    continue;
                };
                let shines = area.two_sided || sample.ng.dot(sample.wi) < 0.0;
                let lit = reference.n == Vec3::ZERO || reference.n.dot(sample.wi) > 0.0;
                if shines && lit {
                    assert!(tree.probability(&reference, Source::Emitter(i as u32)) > 0.0, "{i} at {reference:?}");
                }
            }
        }
    }
}

/// Variance of irradiance relative to its square at a few places, for a scene and its places scaled.
fn relative_variance(pick: LightPick, scale: f32) -> Vec<f64> {
    let lights = Lights::build(scattered(60, scale), &method(pick, LightSampling::SolidAngle));
    let mut rng = Rng::new(37);
    places()
        .iter()
        .filter(|reference| reference.n != Vec3::ZERO)
        .map(|reference| {
            let reference = Reference { p: reference.p * scale, n: reference.n };
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..4000 {
                let sample = lights.sample(&reference, rng.next(), rng.next_2d());
                let value = sample.map_or(0.0, |s| f64::from(s.radiance.x * reference.n.dot(s.wi).max(0.0) / s.pdf));
                sum += value;
                squares += value * value;
            }
            4000.0 * squares / (sum * sum).max(1e-300)
        })
        .collect()
}

#[test]
fn the_unit_of_length_changes_nothing() {
    for pick in [LightPick::Tree, LightPick::Power] {
        let (reference, mut all) = (relative_variance(pick, 1.0), 0);
        // Powers of 2 round nothing: the same walk to the bit. Others differ by rounding alone.
        for scale in [1.0 / 1024.0, 1024.0, 1e-3, 1e3] {
            for (a, b) in reference.iter().zip(relative_variance(pick, scale)).filter(|(a, _)| **a > 0.0) {
                assert!((a / b - 1.0).abs() < 0.02, "{pick} at {scale}: {a} {b}");
                all += 1;
            }
        }
        assert!(all > 50);
    }
    // The mixed clamp, for two groups: as likely in metres, 4 to 1 in millimetres.
    let odds = |unit: f32| {
        let importance =
            |distance: f32, diagonal: f32| textbook::mixed_importance(1.0, (distance * unit).powi(2), diagonal * unit);
        importance(1.0, 8.0) / importance(2.0, 8.0)
    };
    assert_eq!((odds(1.0), odds(1000.0)), (1.0, 4.0));
    let odds = |unit: f32| {
        let importance = |distance: f32| group_importance(1.0, (distance * unit).powi(2), (4.0 * unit).powi(2));
        importance(1.0) / importance(5.0)
    };
    assert!((odds(1.0) / odds(1000.0) - 1.0).abs() < 1e-6);
}

#[test]
fn a_tree_finds_the_lamp_overhead_in_a_long_corridor() {
    // 200 lamps in a row; each lights little but the floor below it.
    let lamp = |i: usize| {
        let corner = Vec3::new(i as f32, 0.0, 1.0);
        Emitter::Rectangle { corner, edge_u: Vec3::Y * 0.3, edge_v: Vec3::X * 0.3 }
    };
    let areas: Vec<AreaLight> =
        (0..200).map(|i| AreaLight { emitters: vec![lamp(i)], radiance: Vec3::ONE, two_sided: false }).collect();
    // Mean square over square mean: 1 is no variance.
    let spread = |pick| {
        let sources = LightSources { areas: areas.clone(), ..LightSources::default() };
        let lights = Lights::build(sources, &method(pick, LightSampling::SolidAngle));
        let reference = Reference { p: Vec3::new(77.3, 0.2, 0.0), n: Vec3::Z };
        let mut rng = Rng::new(47);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..100_000 {
            let sample = lights.sample(&reference, rng.next(), rng.next_2d());
            let value = sample.map_or(0.0, |s| f64::from(s.radiance.x * s.wi.z.max(0.0) / s.pdf));
            sum += value;
            squares += value * value;
        }
        100_000.0 * squares / (sum * sum)
    };
    let (tree, power) = (spread(LightPick::Tree), spread(LightPick::Power));
    assert!(power > 50.0 && tree < 2.0, "tree {tree}, power {power}");
}

/// A flat grid of `n` x `n` x 2 triangles that grow along x.
fn grid(n: usize) -> Vec<Emitter> {
    let at = |i: usize, j: usize| {
        let x = i as f32 / n as f32;
        Vec3::new(x * (0.2 + 0.8 * x), j as f32 / n as f32, 0.0)
    };
    (0..n * n)
        .flat_map(|k| {
            let (i, j) = (k / n, k % n);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [Emitter::Triangle { p: [a, b, c] }, Emitter::Triangle { p: [a, c, d] }]
        })
        .collect()
}

#[test]
fn a_mesh_of_10_000_triangles_is_one_light_and_uniform_over_its_area() {
    let emitters = grid(71);
    assert!(emitters.len() > 10_000);
    let areas: Vec<f64> = emitters.iter().map(Emitter::area).collect();
    let total: f64 = areas.iter().sum();
    let other = Emitter::Sphere { center: Vec3::new(0.0, 0.0, 9.0), radius: 0.1 };
    let radiance = Vec3::ONE;
    let sources = LightSources {
        areas: vec![
            AreaLight { emitters: vec![other], radiance, two_sided: false },
            AreaLight { emitters, radiance, two_sided: false },
        ],
        ..LightSources::default()
    };
    let lights = Lights::build(sources, &method(LightPick::One, LightSampling::Area));
    assert_eq!((lights.count(), lights.first_emitter(1)), (2, Some(1)));
    let reference = Reference { p: Vec3::new(0.5, 0.5, 1.0), n: -Vec3::Z };
    let mut rng = Rng::new(41);
    let mut counts = vec![0; areas.len()];
    let mut mesh = 0;
    for _ in 0..1_000_000 {
        let Some(sample) = lights.sample(&reference, rng.next(), rng.next_2d()) else { continue };
        let Some(emitter) = sample.emitter.filter(|&e| e > 0) else { continue };
        mesh += 1;
        counts[emitter as usize - 1] += 1;
        // distance^2 / (cos x area of the whole mesh), and one of two lights.
        let expected = 0.5 * f64::from(sample.distance).powi(2) / (-f64::from(sample.wi.z) * total);
        assert!((f64::from(sample.pdf) / expected - 1.0).abs() < 1e-4);
        assert_eq!(sample.pdf, lights.pdf(&reference, emitter, sample.point));
    }
    assert!((f64::from(mesh) / 500_000.0 - 1.0).abs() < 0.01);
    let expected: Vec<f64> = areas.iter().map(|a| a / total * f64::from(mesh)).collect();
    check_counts("mesh", &counts, &expected);
}

#[test]
fn an_alias_table_meets_its_weights_and_hands_on_a_uniform_rest() {
    let weights = [0.0, 3.0, 1e-3, 0.0, 7.0, f64::NAN, 1.0, -2.0, 1e-300, f64::INFINITY, 0.0];
    let table = AliasTable::new(&weights);
    let mut rng = Rng::new(43);
    let (mut counts, mut rests) = (vec![0; weights.len()], vec![0; 20]);
    let samples = 400_000;
    for _ in 0..samples {
        let (choice, probability, rest) = table.pick(alias::lengthen(rng.next(), rng.next_2d())).unwrap();
        assert_eq!(probability, table.probability(choice));
        assert!((0.0..1.0).contains(&rest));
        counts[choice as usize] += 1;
        rests[(rest * 20.0) as usize] += 1;
    }
    let expected: Vec<f64> =
        (0..weights.len() as u32).map(|i| f64::from(table.probability(i)) * f64::from(samples)).collect();
    check_counts("weights", &counts, &expected);
    check_counts("rest", &rests, &[f64::from(samples) / 20.0; 20]);
    assert!((f64::from(table.probability(4)) - 7.0 / 11.001).abs() < 1e-6);
    assert!(AliasTable::new(&[0.0, -1.0]).is_empty() && AliasTable::new(&[]).pick(0.5).is_none());
    let huge = AliasTable::new(&[f64::MAX, f64::MAX]);
    assert_eq!((huge.probability(0), huge.probability(1)), (0.5, 0.5));
}

#[test]
fn lights_in_one_place_and_in_a_long_row_make_a_tree_of_bounded_depth() {
    // A geometric progression defeats every cut but one at a time.
    let row = |i: usize| Vec3::X * 2f32.powi(i as i32 % 120 - 60) + Vec3::Y * (i / 120) as f32;
    for place in [&row as &dyn Fn(usize) -> Vec3, &|_| Vec3::ONE] {
        let deltas = (0..3000).map(|i| DeltaLight::Point { position: place(i), intensity: Vec3::ONE }).collect();
        let lights = Lights::build(
            LightSources { deltas, ..LightSources::default() },
            &method(LightPick::Tree, LightSampling::Area),
        );
        let tree = tree_of(&lights);
        let reference = Reference { p: Vec3::new(0.3, 0.2, 5.0), n: Vec3::ZERO };
        let sum: f64 = (0..3000).map(|i| f64::from(tree.probability(&reference, Source::Delta(i)))).sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
    }
}

#[test]
fn nothing_that_shines_is_no_light_and_one_light_is_certain() {
    let reference = Reference { p: Vec3::ZERO, n: Vec3::Z };
    for pick in [LightPick::All, LightPick::One, LightPick::Power, LightPick::Tree] {
        let none = Lights::build(LightSources::default(), &method(pick, LightSampling::Area));
        assert!(none.is_dark() && none.sample(&reference, 0.5, Vec2::splat(0.5)).is_none());
        let deltas = vec![DeltaLight::Point { position: Vec3::Z, intensity: Vec3::ONE }];
        let one = Lights::build(LightSources { deltas, ..LightSources::default() }, &method(pick, LightSampling::Area));
        assert_eq!(one.sample(&reference, 0.5, Vec2::splat(0.5)).unwrap().pdf, 1.0);
    }
}
