//! What every BSDF keeps to, and what single ones are known for.

use std::collections::HashMap;

use common::method::Fresnel;
use proptest::prelude::*;

use super::*;
use crate::{
    material::Material,
    testing::{ChiSquare, Directions, Rng, chi_square},
    texture::Pictures,
};

/// The BSDF of a material as a scene file writes it.
fn bsdf(json: &str) -> Bsdf {
    bsdf_by(json, Fresnel::Exact)
}

fn bsdf_by(json: &str, fresnel: Fresnel) -> Bsdf {
    let scene = serde_json::from_str(json).expect("the test's own JSON");
    let files = HashMap::new();
    let material = Material::compile("materials.m", &scene, &mut Pictures::new(&files), fresnel);
    material.expect("constants compile").bsdf(Vec2::ZERO)
}

/// The direction at an angle from the normal, and some azimuth.
fn at(degrees: f64) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    // The last digits of a right angle are not those of a cosine.
    Vec3::new(sin as f32, 0.0, if degrees == 0.0 { 1.0 } else { cos as f32 })
}

fn turned(w: Vec3, turns: f32) -> Vec3 {
    let (sin, cos) = (turns * std::f32::consts::TAU).sin_cos();
    Vec3::new(w.x * cos - w.y * sin, w.x * sin + w.y * cos, w.z)
}

/// One of every kind, smooth and rough.
const CATALOGUE: &[&str] = &[
    r#"{"type":"diffuse","reflectance":[0.2,0.5,0.9]}"#,
    r#"{"type":"mirror","reflectance":0.9}"#,
    r#"{"type":"dielectric"}"#,
    r#"{"type":"dielectric","roughness":0.3,"reflectance":[1,0.5,0],"transmittance":[0.2,0.9,1]}"#,
    r#"{"type":"dielectric","roughness":[0.05,0.4],"ior":1.33}"#,
    r#"{"type":"dielectric","roughness":0.8,"ior":1.0,"exterior_ior":1.8}"#,
    r#"{"type":"conductor","metal":"Au"}"#,
    r#"{"type":"conductor","metal":"Al","roughness":0.2}"#,
    r#"{"type":"conductor","eta":[0.2,1,3],"k":[4,2,3],"roughness":[0.1,0.6]}"#,
    r#"{"type":"conductor","reflectance":1.0,"roughness":1.0}"#,
    r#"{"type":"plastic","reflectance":[0.1,0.5,1]}"#,
    r#"{"type":"plastic","reflectance":[0.1,0.5,1],"roughness":0.3,"ior":1.9}"#,
    r#"{"type":"plastic","reflectance":1,"roughness":[0.1,0.5]}"#,
    r#"{"type":"phong","reflectance":[0.3,0.6,1],"exponent":20}"#,
    r#"{"type":"blinn_phong","reflectance":[0.1,0.6,1],"exponent":50}"#,
    r#"{"type":"blinn_microfacet","reflectance":[0.1,0.6,1],"exponent":50}"#,
    r#"{"type":"blinn_phong","reflectance":1,"exponent":0}"#,
    r#"{"type":"blinn_microfacet","reflectance":1,"exponent":0}"#,
    r#"{"type":"blinn_microfacet","reflectance":1,"exponent":2}"#,
    r#"{"type":"blinn_microfacet","reflectance":1,"exponent":100000}"#,
    r#"{"type":"metallic_roughness","base_color":[0.1,0.6,1],"metallic":0,"roughness":0.5}"#,
    r#"{"type":"metallic_roughness","base_color":[0.9,0.6,0.1],"metallic":1,"roughness":0.3}"#,
    r#"{"type":"metallic_roughness","base_color":1,"metallic":0.5,"roughness":0}"#,
];

/// What a scene file may say, however little sense it makes.
const HOSTILE: &[&str] = &[
    r#"{"type":"dielectric","ior":1e300,"exterior_ior":1e-300}"#,
    r#"{"type":"dielectric","ior":1e-300,"roughness":1}"#,
    r#"{"type":"dielectric","ior":1e300,"roughness":[1e-300,0.001]}"#,
    r#"{"type":"dielectric","ior":1.0000001,"roughness":1}"#,
    r#"{"type":"dielectric","reflectance":0,"transmittance":0,"roughness":0.5}"#,
    r#"{"type":"dielectric","reflectance":0,"transmittance":0}"#,
    r#"{"type":"dielectric","reflectance":1,"transmittance":0,"roughness":0.5}"#,
    r#"{"type":"conductor","eta":0,"k":0,"roughness":0.1}"#,
    r#"{"type":"conductor","eta":1,"k":0,"roughness":0.1}"#,
    r#"{"type":"conductor","eta":1e300,"k":1e300}"#,
    r#"{"type":"conductor","eta":1e-30,"k":1e30,"roughness":0.001}"#,
    r#"{"type":"plastic","reflectance":1,"ior":0.5}"#,
    r#"{"type":"plastic","reflectance":1,"ior":0.5,"roughness":0.4}"#,
    r#"{"type":"plastic","reflectance":1,"ior":1e300}"#,
    r#"{"type":"plastic","reflectance":1,"ior":1e-300}"#,
    r#"{"type":"plastic","reflectance":1,"ior":1}"#,
    r#"{"type":"plastic","reflectance":0,"ior":1,"roughness":1}"#,
    r#"{"type":"phong","reflectance":1,"exponent":1e300}"#,
    r#"{"type":"blinn_phong","reflectance":1,"exponent":1e300}"#,
    r#"{"type":"blinn_microfacet","reflectance":0,"exponent":1e300}"#,
    r#"{"type":"metallic_roughness","ior":1e300,"roughness":0.03163,"metallic":0}"#,
    r#"{"type":"metallic_roughness","ior":1,"base_color":0}"#,
];

/// Mean weight of a sampler over a grid of its random numbers: the directional albedo. With `eta`, what
/// radiance gains or loses by refraction is taken out.
fn albedo(bsdf: &Bsdf, wo: Vec3) -> glam::DVec3 {
    const N: u32 = 32;
    let mut sum = glam::DVec3::ZERO;
    let mut rng = Rng::new(7);
    for i in 0..N * N * 8 {
        let (x, y, z) = (i % N, i / N % N, i / (N * N));
        let u = Vec2::new((x as f32 + rng.next()) / N as f32, (y as f32 + rng.next()) / N as f32);
        if let Some(sample) = bsdf.sample(wo, (z as f32 + rng.next()) / 8.0, u) {
            sum += (sample.weight * (sample.eta * sample.eta)).as_dvec3();
        }
    }
    sum / f64::from(N * N * 8)
}

#[test]
fn smooth_glass_loses_nothing_and_refracts_by_snell() {
    for fresnel in [Fresnel::Exact, Fresnel::Schlick] {
        for eta in [1.0, 1.33, 1.5, 0.8] {
            let bsdf = bsdf_by(&format!(r#"{{"type":"dielectric","ior":{eta}}}"#), fresnel);
            let eta = eta as f32;
            for i in -1000..=1000i32 {
                let z = i as f32 / 1000.0;
                let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                let reflected = bsdf.sample(wo, 0.0, Vec2::ZERO);
                let refracted = bsdf.sample(wo, 0.999_999_9, Vec2::ZERO);
                let Some((reflected, refracted)) = reflected.zip(refracted) else {
                    assert_eq!(z, 0.0);
                    continue;
                };
                for sample in [reflected, refracted] {
                    assert!(sample.delta && sample.pdf == 0.0);
                    assert!((sample.wi.length() - 1.0).abs() < 1e-5, "{eta} {z}");
                    // Chance times weight sums to R + T when each weight, freed of 1 / eta^2, is 1.
                    assert!((sample.weight.x * sample.eta * sample.eta - 1.0).abs() < 1e-6, "{eta} {z}");
                }
                if refracted.transmission {
                    assert!(refracted.wi.z * z < 0.0);
                    let ratio = if z > 0.0 { eta } else { 1.0 / eta };
                    assert_eq!(refracted.eta, ratio);
                    assert!((refracted.wi.x * ratio + wo.x).abs() < 1e-6);
                }
            }
        }
    }
}

#[test]
fn a_one_sided_surface_is_black_from_behind() {
    let (up, down) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.6, 0.0, -0.8));
    let one = bsdf(r#"{"type":"diffuse","two_sided":false}"#);
    assert!(one.sample(down, 0.5, Vec2::splat(0.5)).is_none() && one.eval(down, down) == Rgb::ZERO);
    let two = bsdf(r#"{"type":"diffuse"}"#);
    assert_eq!(two.eval(down, down), two.eval(up, up));
    assert!(two.sample(down, 0.5, Vec2::splat(0.25)).unwrap().wi.z < 0.0);
    assert_eq!((two.eval(up, down), two.pdf(up, down)), (Rgb::ZERO, 0.0));
}

/// A comparison to make: name, BSDF, direction, map of directions, agreement of densities.
type Comparison = (String, Bsdf, Vec3, Directions, f32);

fn compare(
    comparisons: Vec<Comparison>,
    samples: u32,
    counts: impl Fn(&BsdfSample) -> bool,
    inside: fn(Vec3, Vec3) -> bool,
) {
    let n = comparisons.len() as u32;
    for (name, bsdf, wo, directions, agreement) in comparisons {
        chi_square(
            ChiSquare { name: &name, directions, samples, comparisons: n, agreement },
            |rng| {
                let sample = bsdf.sample(wo, rng.next(), rng.next_2d())?;
                (!sample.delta && counts(&sample)).then_some((sample.wi, sample.pdf))
            },
            |wi| if inside(wo, wi) { bsdf.pdf(wo, wi) } else { 0.0 },
        );
    }
}

const THETAS: [f64; 4] = [0.0, 60.0, 89.0, 89.99];
const ALPHAS: [f64; 4] = [1e-3, 0.01, 0.1, 1.0];

/// How well the density told with a sample and the one evaluated at its rounded direction agree.
fn agreement(alpha: f64) -> f32 {
    (2e-5 / alpha).clamp(1e-3, 0.05) as f32
}

#[test]
fn facets_reflect_as_their_density_says() {
    let mut comparisons = Vec::new();
    for alpha in ALPHAS {
        for theta in THETAS {
            for json in [
                format!(r#"{{"type":"conductor","roughness":{alpha}}}"#),
                format!(r#"{{"type":"dielectric","roughness":{alpha}}}"#),
                format!(r#"{{"type":"plastic","roughness":{alpha}}}"#),
                format!(r#"{{"type":"metallic_roughness","metallic":0.2,"roughness":{}}}"#, alpha.sqrt() * 1.000_001),
            ] {
                let wo = at(theta);
                let width = alpha.min(0.5);
                comparisons.push((
                    format!("{json} at {theta}"),
                    bsdf(&json),
                    wo,
                    Directions::reflections(wo, width),
                    agreement(alpha),
                ));
            }
        }
    }
    compare(comparisons, 100_000, |sample| !sample.transmission, |wo, wi| wo.z * wi.z > 0.0);
}

#[test]
fn facets_refract_as_their_density_says() {
    let mut comparisons = Vec::new();
    for alpha in ALPHAS {
        for theta in THETAS {
            for (ior, up) in [(1.5, true), (1.5, false), (2.4, true)] {
                let json = format!(r#"{{"type":"dielectric","roughness":{alpha},"ior":{ior}}}"#);
                let wo = at(theta) * Vec3::new(1.0, 1.0, if up { 1.0 } else { -1.0 });
                let eta = if up { ior as f32 } else { 1.0 / ior as f32 };
                let sin = (wo.x / eta).min(1.0);
                let mean = Vec3::new(-sin, 0.0, -wo.z.signum() * (1.0 - sin * sin).sqrt().max(1e-3));
                let directions = Directions::about(mean, (0.5 * alpha).clamp(5e-4, 0.5));
                comparisons.push((
                    format!("{json} at {theta} {up}"),
                    bsdf(&json),
                    wo,
                    directions,
                    agreement(alpha) * 4.0,
                ));
            }
        }
    }
    compare(comparisons, 20_000, |sample| sample.transmission, |wo, wi| wo.z * wi.z < 0.0);
}

#[test]
fn the_other_lobes_scatter_as_their_density_says() {
    let mut comparisons = Vec::new();
    for theta in THETAS {
        let wo = at(theta);
        let mut add = |json: &str, wo: Vec3, directions: Directions, agreement: f32| {
            comparisons.push((format!("{json} at {theta}"), bsdf(json), wo, directions, agreement));
        };
        let wide = Directions::about(Vec3::Z, 1.0);
        add(r#"{"type":"diffuse"}"#, wo, wide, 1e-3);
        add(r#"{"type":"plastic"}"#, wo, wide, 1e-3);
        add(r#"{"type":"metallic_roughness","metallic":0.2,"roughness":0}"#, wo, wide, 1e-3);
        for exponent in [0.0, 1.0, 30.0, 1e4, 2e6] {
            let alpha = (2.0f64 / (exponent + 2.0)).sqrt();
            let agreement = agreement(alpha);
            let mirror = Vec3::new(-wo.x, 0.0, wo.z);
            let phong = format!(r#"{{"type":"phong","exponent":{exponent}}}"#);
            add(&phong, wo, Directions::about(mirror, 0.7 * alpha), agreement);
            for kind in ["blinn_phong", "blinn_microfacet"] {
                let json = format!(r#"{{"type":"{kind}","exponent":{exponent}}}"#);
                add(&json, wo, Directions::reflections(wo, 0.7 * alpha), agreement);
            }
        }
        // Rougher one way than the other, from the side.
        for wo in [turned(wo, 0.1), turned(wo, 0.3)] {
            let directions = Directions::reflections(wo, 0.15);
            add(r#"{"type":"conductor","roughness":[0.05,0.4]}"#, wo, directions, 1e-2);
        }
    }
    compare(comparisons, 20_000, |_| true, |_, _| true);
}

#[test]
fn a_weight_is_f_cos_over_density() {
    let mut rng = Rng::new(3);
    for json in CATALOGUE {
        let bsdf = bsdf(json);
        for i in 0..4000 {
            let mut wo = crate::math::uniform_sphere(rng.next_2d());
            if i % 4 == 0 {
                wo = turned(at(89.9), rng.next());
            }
            let Some(sample) = bsdf.sample(wo, rng.next(), rng.next_2d()) else { continue };
            assert!((sample.wi.length() - 1.0).abs() < 1e-5, "{json} {wo} {sample:?}");
            assert_eq!(sample.transmission, sample.wi.z * wo.z < 0.0, "{json}");
            if sample.delta {
                continue;
            }
            let eval = bsdf.evaluate(wo, sample.wi);
            let ratio = eval.f_cos / eval.pdf;
            // Near the critical angle f changes faster than directions can be told apart.
            let error = (ratio - sample.weight).abs().max_element();
            assert!(error <= 0.02 * sample.weight.max_element() + 1e-3, "{json} {wo} {sample:?} {ratio}");
        }
    }
}

#[test]
fn scattering_is_reciprocal() {
    let mut rng = Rng::new(5);
    for (json, fresnel) in CATALOGUE.iter().flat_map(|json| [Fresnel::Exact, Fresnel::Schlick].map(|f| (json, f))) {
        if json.contains(r#""phong""#) {
            continue;
        }
        let bsdf = bsdf_by(json, fresnel);
        let mut compared = 0;
        for i in 0..4000 {
            let wo = crate::math::uniform_sphere(rng.next_2d());
            let mut wi = crate::math::uniform_sphere(rng.next_2d());
            if i % 2 == 0 {
                // Narrow lobes are met by their own samples alone.
                let Some(sample) = bsdf.sample(wo, rng.next(), rng.next_2d()) else { continue };
                wi = sample.wi;
            }
            // Schlick's polynomial of the angle on one side is not that of the angle on the other.
            if fresnel == Fresnel::Schlick && wo.z * wi.z < 0.0 {
                continue;
            }
            let (there, back) = (bsdf.eval(wo, wi), bsdf.eval(wi, wo));
            // Blinn and Phong's lobe is symmetric with the cosine in it.
            let (mut a, mut b) =
                if json.contains("blinn_phong") { (there, back) } else { (there / wi.z.abs(), back / wo.z.abs()) };
            if wo.z * wi.z < 0.0 {
                // Radiance over the square of the index is what is symmetric.
                let Lobes::RoughDielectric(lobe) = &bsdf.lobes else {
                    assert_eq!((there, back), (Rgb::ZERO, Rgb::ZERO), "{json}");
                    continue;
                };
                let n2 = |w: Vec3| if w.z > 0.0 { 1.0 } else { lobe.eta * lobe.eta };
                (a, b) = (a / n2(wo), b / n2(wi));
            }
            let scale = a.max_element().max(b.max_element());
            // At the edge of total reflection each side knows the facet's angle to f32's digits only.
            let bound = if wo.z * wi.z < 0.0 { 0.03 } else { 2e-3 };
            assert!((a - b).abs().max_element() <= bound * scale + 1e-6, "{json} {wo} {wi}: {a} {b}");
            compared += usize::from(scale > 0.0);
        }
        assert!(bsdf.is_delta() || compared > 500, "{json}: {compared}");
    }
}

#[test]
fn nothing_reflects_more_than_it_receives() {
    for fresnel in [Fresnel::Exact, Fresnel::Schlick] {
        for json in CATALOGUE.iter().chain(HOSTILE) {
            let bsdf = bsdf_by(json, fresnel);
            for theta in [0.0, 20.0, 45.0, 60.0, 75.0, 85.0, 89.0, 89.9] {
                for wo in [at(theta), turned(at(theta), 0.25), at(theta) * Vec3::new(1.0, 1.0, -1.0)] {
                    let albedo = albedo(&bsdf, wo);
                    // What a coat below an index of 1 lets through has a kink that its table rounds.
                    let bound = if HOSTILE.contains(json) { 0.02 } else { 3e-3 };
                    assert!(albedo.max_element() < 1.0 + bound, "{json} {fresnel:?} {theta}: {albedo}");
                }
            }
        }
    }
}

#[test]
fn a_white_base_under_a_coat_returns_everything() {
    for (json, bound) in [
        (r#"{"type":"plastic","reflectance":1}"#, 0.005),
        (r#"{"type":"plastic","reflectance":1,"ior":2.5}"#, 0.005),
        (r#"{"type":"plastic","reflectance":1,"roughness":0.2}"#, 0.01),
        (r#"{"type":"plastic","reflectance":1,"roughness":1}"#, 0.01),
        (r#"{"type":"metallic_roughness","metallic":0,"roughness":0}"#, 0.005),
        (r#"{"type":"metallic_roughness","metallic":0,"roughness":0.33}"#, 0.01),
        (r#"{"type":"metallic_roughness","metallic":0,"roughness":1}"#, 0.01),
    ] {
        for theta in [0.0, 30.0, 60.0, 80.0, 88.0] {
            let albedo = albedo(&bsdf(json), at(theta)).x;
            assert!((albedo - 1.0).abs() < bound, "{json} {theta}: {albedo}");
        }
    }
}

#[test]
fn smooth_and_rough_agree_where_one_becomes_the_other() {
    let theta_range = [0.0, 30.0, 60.0, 80.0, 89.0];
    for (kind, rest) in
        [("conductor", r#""metal":"Cu""#), ("dielectric", r#""ior":1.5"#), ("plastic", r#""reflectance":0.5"#)]
    {
        let of = |alpha: f64| bsdf(&format!(r#"{{"type":"{kind}",{rest},"roughness":{alpha}}}"#));
        let (smooth, rough) = (of(0.000_999), of(0.001));
        for theta in theta_range {
            for sign in [1.0, -1.0] {
                let wo = at(theta) * Vec3::new(1.0, 1.0, sign);
                let (a, b) = (albedo(&smooth, wo), albedo(&rough, wo));
                assert!((a - b).abs().max_element() < 5e-3, "{kind} {theta} {sign}: {a} {b}");
                for u_lobe in [0.0, 0.999_999] {
                    let u = Vec2::new(0.25, 0.3);
                    let (Some(a), Some(b)) = (smooth.sample(wo, u_lobe, u), rough.sample(wo, u_lobe, u)) else {
                        continue;
                    };
                    if a.delta && a.transmission == b.transmission {
                        assert!(!b.delta && (a.wi - b.wi).length() < 0.02, "{kind} {theta}: {} {}", a.wi, b.wi);
                    }
                }
            }
        }
    }
    // 1e-3 itself is rough in metallic-roughness too: roughness^2.
    assert!(bsdf(r#"{"type":"metallic_roughness","metallic":1,"roughness":0.0316}"#).is_delta());
    assert!(!bsdf(r#"{"type":"metallic_roughness","metallic":1,"roughness":0.0317}"#).is_delta());
}

#[test]
fn the_coat_of_plastic_reflects_by_fresnel() {
    // Chance times weight of the one specular direction is F.
    let bsdf = bsdf(r#"{"type":"plastic","reflectance":0.5}"#);
    for theta in [0.0, 45.0, 56.3, 80.0] {
        let wo = at(theta);
        let sample = bsdf.sample(wo, 0.0, Vec2::splat(0.5)).unwrap();
        assert!(sample.delta);
        let diffuse = Directions::about(Vec3::Z, 1.0).integrate(1e-6, |wi| bsdf.pdf(wo, wi).into());
        let f = f64::from(sample.weight.x) * (1.0 - diffuse);
        let expected = f64::from(crate::fresnel::dielectric(wo.z, 1.5).reflected);
        assert!((f - expected).abs() < 2e-3, "{theta}: {f} {expected}");
    }
}

#[test]
fn black_plastic_and_metal_are_deltas_where_smooth() {
    assert!(bsdf(r#"{"type":"plastic","reflectance":0}"#).is_delta());
    assert!(!bsdf(r#"{"type":"plastic"}"#).is_delta());
    assert!(bsdf(r#"{"type":"conductor"}"#).is_delta());
    assert!(bsdf(r#"{"type":"dielectric","ior":1.0,"roughness":0.5}"#).is_delta(), "equal media bend nothing");
}

fn unit() -> impl Strategy<Value = f32> {
    prop_oneof![Just(0.0f32), Just(1.0 - f32::EPSILON / 2.0), Just(0.5f32), Just(1e-7f32), 0.0f32..1.0]
}

fn direction() -> impl Strategy<Value = Vec3> {
    let z = prop_oneof![
        Just(1.0f32),
        Just(0.0f32),
        Just(-0.0f32),
        Just(1e-7f32),
        Just(-1e-7f32),
        Just(1e-20f32),
        Just(f32::MIN_POSITIVE),
        Just(-1.0f32),
        -1.0f32..1.0,
        -1e-3f32..1e-3
    ];
    (z, 0.0f32..1.0).prop_map(|(z, turns)| turned(Vec3::new((1.0 - z * z).sqrt(), 0.0, z), turns))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
    #[test]
    fn numbers_stay_finite(
        which in 0..CATALOGUE.len() + HOSTILE.len(), wo in direction(), wi in direction(), opposite in any::<bool>(),
        u_lobe in unit(), x in unit(), y in unit(),
    ) {
        thread_local!(static BSDFS: Vec<Bsdf> = CATALOGUE.iter().chain(HOSTILE).map(|json| bsdf(json)).collect());
        let json = CATALOGUE.iter().chain(HOSTILE).nth(which).unwrap_or(&"");
        let bsdf = BSDFS.with(|all| all[which]);
        let wi = if opposite { Vec3::new(-wo.x, -wo.y, wo.z) } else { wi };
        let eval = bsdf.evaluate(wo, wi);
        prop_assert!(eval.f_cos.is_finite() && eval.f_cos.min_element() >= 0.0, "{} {eval:?}", json);
        prop_assert!(eval.pdf.is_finite() && eval.pdf >= 0.0, "{} {eval:?}", json);
        if let Some(sample) = bsdf.sample(wo, u_lobe, Vec2::new(x, y)) {
            prop_assert!(sample.wi.is_finite() && (sample.wi.length() - 1.0).abs() < 1e-4, "{sample:?}");
            prop_assert!(sample.weight.is_finite() && sample.weight.min_element() >= 0.0, "{sample:?}");
            prop_assert!(sample.pdf.is_finite() && (sample.pdf > 0.0) != sample.delta, "{} {sample:?}", json);
            prop_assert!(sample.eta.is_finite() && sample.eta > 0.0);
            let back = bsdf.evaluate(wo, sample.wi);
            prop_assert!(back.f_cos.is_finite() && back.pdf.is_finite(), "{back:?}");
            prop_assert!(sample.delta || back.pdf > 0.0, "{} {wo} {sample:?} {back:?}", json);
        }
        prop_assert!(bsdf.albedo().min_element() >= 0.0 && bsdf.albedo().max_element() <= 1.0);
    }

    #[test]
    fn directions_that_are_no_directions_scatter_nothing(which in 0..CATALOGUE.len(), x in unit(), y in unit()) {
        thread_local!(static BSDFS: Vec<Bsdf> = CATALOGUE.iter().map(|json| bsdf(json)).collect());
        let bsdf = BSDFS.with(|all| all[which]);
        let nan = Vec3::splat(f32::NAN);
        prop_assert!(bsdf.sample(nan, x, Vec2::new(x, y)).is_none());
        prop_assert_eq!(bsdf.evaluate(nan, Vec3::Z), Eval::ZERO);
        prop_assert_eq!(bsdf.evaluate(Vec3::Z, nan), Eval::ZERO);
    }
}
