//! Whole images against answers known in closed form, and methods against each other.

use std::path::Path;

use common::{
    film::Moments,
    mesh::{Encoding, Picture},
    method::{Aim, Direct, LightPick, LightSampling, Method, Only, Reuse, Roulette, Sampler},
    pass::{Work, batch_for},
    scene::SceneFile,
    tile::Rect,
};
use serde_json::{Value, json};

use crate::{
    Assets, Loaded,
    testing::{Image, render, render_rect, settings},
};

/// The scene of `json` with an 8 x 8 image unless it says otherwise.
fn scene(mut json: Value) -> SceneFile {
    let map = json.as_object_mut().unwrap();
    map.entry("tessera").or_insert(json!(1));
    map.entry("film").or_insert(json!({ "width": 8, "height": 8 }));
    SceneFile::parse(json.to_string().as_bytes()).unwrap()
}

fn samples(n: u32) -> Work {
    Work::Uniform { first: 0, samples: n }
}

fn with(change: impl FnOnce(&mut Method)) -> Method {
    let mut method = Method::default();
    change(&mut method);
    method
}

/// Two images agree: their means within `z` standard errors of the difference (and rounding), since a test of pixels
/// alone is blind to a small bias of them all; and each pixel within what Student's distribution allows it, since a
/// mean alone is blind to errors that cancel.
fn assert_agree(a: &Image, b: &Image, z: f64, what: &str) {
    let pixels = a.film.moments.iter().zip(&b.film.moments);
    for (i, (p, q)) in pixels.enumerate() {
        let error = (p.variance_of_mean().unwrap() + q.variance_of_mean().unwrap()).sqrt();
        let off = (p.luminance() - q.luminance()).abs();
        assert!(off <= 7.0 * error + 1e-5, "{what}: pixel {i} is {} and {}, ± {error}", p.luminance(), q.luminance());
    }
    let ((a, ea), (b, eb)) = (a.mean_and_error(), b.mean_and_error());
    let allowed = z * (ea * ea + eb * eb).sqrt() + 1e-5 * a.abs();
    assert!((a - b).abs() <= allowed, "{what}: {a} ± {ea} against {b} ± {eb}");
}

/// A room with a lamp, a second, round lamp, a mirror, a block of glass and a glossy floor.
fn room() -> SceneFile {
    let quad = |material: &str, vertices: Value| json!({ "type": "quad", "material": material, "vertices": vertices });
    let mut shapes = vec![
        quad("floor", json!([[-1, -1, -1], [-1, -1, 1], [1, -1, 1], [1, -1, -1]])),
        quad("white", json!([[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]])),
        quad("white", json!([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]])),
        quad("red", json!([[-1, -1, -1], [-1, 1, -1], [-1, 1, 1], [-1, -1, 1]])),
        quad("mirror", json!([[1, -1, -1], [1, -1, 1], [1, 1, 1], [1, 1, -1]])),
    ];
    shapes.push(json!({ "type": "quad", "emission": [4, 3, 2],
        "vertices": [[-0.6, 0.98, -0.6], [0.6, 0.98, -0.6], [0.6, 0.98, 0.6], [-0.6, 0.98, 0.6]] }));
    shapes.push(json!({ "type": "sphere", "center": [-0.5, -0.2, -0.4], "radius": 0.3, "emission": [1, 2, 3] }));
    shapes.push(json!({ "type": "sphere", "center": [0.4, -0.6, 0.2], "radius": 0.35, "material": "glass" }));
    scene(json!({
        "camera": { "position": [0, 0, 3], "target": [0, 0, 0], "fov": 40 },
        "materials": {
            "white": { "type": "diffuse", "reflectance": 0.7 },
            "red": { "type": "diffuse", "reflectance": [0.6, 0.1, 0.1] },
            "floor": { "type": "plastic", "reflectance": 0.4, "roughness": 0.3 },
            "mirror": { "type": "mirror", "reflectance": 0.8 },
            "glass": { "type": "dielectric" }
        },
        "shapes": shapes
    }))
}

/// The analytic scenes that are shipped: every description ends with what to expect.
fn shipped() -> Vec<(String, SceneFile, f64, bool)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/analytic");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.retain(|path| path.extension().is_some_and(|e| e == "json"));
    let read = |path: std::path::PathBuf| {
        let scene = SceneFile::parse(&std::fs::read(&path).unwrap()).unwrap();
        let (_, expected) = scene.description.split_once("Expected: ").unwrap();
        let (value, place) = expected.split_once(' ').unwrap();
        let value = value.parse().unwrap();
        (path.file_name().unwrap().to_string_lossy().into_owned(), scene.clone(), value, place.starts_with("in every"))
    };
    files.into_iter().map(read).collect()
}

#[test]
fn shipped_analytic_scenes_have_their_expected_values() {
    let scenes = shipped();
    assert!(scenes.len() >= 8);
    for (name, scene, expected, everywhere) in scenes {
        let count = match scene.settings.quality {
            Some(common::job::Quality::Samples { samples }) => samples,
            _ => 256,
        };
        let method = scene.settings.method.clone().resolve();
        let image = render(&scene, &method, samples(count), batch_for(count));
        assert_eq!(image.statistics.rejected, 0, "{name}");
        let (mean, error) = image.mean_and_error();
        // Known to 0.2%, and right within what is known.
        assert!(error <= 2e-3 * expected, "{name}: {mean} ± {error}");
        let allowed = 4.5 * error + 3e-5 * expected;
        assert!((mean - expected).abs() <= allowed, "{name}: {mean} ± {error}, expected {expected}");
        if everywhere {
            for pixel in &image.film.moments {
                let off = (pixel.luminance() - expected).abs();
                let error = pixel.standard_error().unwrap();
                // With roulette few-batch errors are skewed: low where the mean is low.
                assert!(off <= 9.0 * error + 1e-3 * expected, "{name}: a pixel is {} ± {error}", pixel.luminance());
            }
        }
    }
}

#[test]
fn every_estimator_of_direct_light_finds_the_expected_values() {
    for (name, scene, expected, _) in shipped() {
        let black_is_all = expected == 0.0;
        for direct in [Direct::Hemisphere, Direct::Light, Direct::Mis] {
            for light_sampling in [LightSampling::Area, LightSampling::SolidAngle] {
                let method =
                    Method { direct, light_sampling: Some(light_sampling), ..scene.settings.method.clone().resolve() };
                let image = render(&scene, &method, samples(128), 16);
                let (mean, error) = image.mean_and_error();
                // Light from the area of walls one stands at has heavy tails; its error bar is not to be trusted.
                let z = if light_sampling == LightSampling::Area && name.starts_with("furnace") { 20.0 } else { 5.0 };
                assert!(
                    (mean - expected).abs() <= z * error + 2e-3 * expected,
                    "{name} by {direct}, {light_sampling}: {mean} ± {error}, expected {expected}"
                );
                assert!(!black_is_all || mean == 0.0, "{name}");
            }
        }
    }
}

#[test]
fn a_white_furnace_has_no_variance() {
    let (_, scene, ..) = shipped().into_iter().find(|(name, ..)| name == "white-furnace.json").unwrap();
    let method = with(|m| m.roulette = Roulette::Off);
    let image = render(&scene, &method, samples(64), 16);
    for pixel in &image.film.moments {
        assert!((pixel.luminance() - 1.0).abs() < 1e-5 && pixel.standard_error().unwrap() < 1e-6, "{pixel:?}");
    }
}

#[test]
fn methods_agree_with_each_other() {
    let scene = room();
    let reference = render(&scene, &Method::default(), samples(1024), 16);
    let cases: [(&str, Method); 22] = [
        ("bsdf", with(|m| m.direct = Direct::Bsdf)),
        ("late roulette", with(|m| m.roulette = Roulette::Late)),
        ("hemisphere", with(|m| m.direct = Direct::Hemisphere)),
        ("hemisphere, 3 directions", with(|m| (m.direct, m.light_samples) = (Direct::Hemisphere, 3))),
        ("light", with(|m| m.direct = Direct::Light)),
        ("four ways", with(|m| m.splits = 4)),
        ("two ways, bsdf", with(|m| (m.splits, m.direct) = (2, Direct::Bsdf))),
        ("eight ways, light", with(|m| (m.splits, m.direct, m.roulette) = (8, Direct::Light, Roulette::Late))),
        ("all lights, 2 samples each", with(|m| (m.light_pick, m.light_samples) = (Some(LightPick::All), 2))),
        ("one light", with(|m| m.light_pick = Some(LightPick::One))),
        ("lights by power, 3 samples", with(|m| (m.light_pick, m.light_samples) = (Some(LightPick::Power), 3))),
        ("light tree", with(|m| m.light_pick = Some(LightPick::Tree))),
        ("area", with(|m| m.light_sampling = Some(LightSampling::Area))),
        ("stratified area", with(|m| (m.light_sampling, m.light_samples) = (Some(LightSampling::Stratified), 5))),
        ("fixed roulette", with(|m| m.roulette = Roulette::Fixed)),
        ("no roulette", with(|m| m.roulette = Roulette::Off)),
        ("stratified points", with(|m| m.sampler = Sampler::Stratified)),
        ("aimed", with(|m| m.aim = Aim::Delta)),
        ("aimed, bsdf", with(|m| (m.aim, m.direct) = (Aim::Delta, Direct::Bsdf))),
        ("aimed, light, four ways", with(|m| (m.aim, m.direct, m.splits) = (Aim::Delta, Direct::Light, 4))),
        ("aimed, hemisphere", with(|m| (m.aim, m.direct) = (Aim::Delta, Direct::Hemisphere))),
        ("independent points", with(|m| m.sampler = Sampler::Independent)),
    ];
    for (name, method) in cases {
        let image = render(&scene, &method, samples(512), 16);
        assert_eq!(image.statistics.rejected, 0, "{name}");
        assert_agree(&image, &reference, 4.5, name);
    }
}

/// Errors of pixels that share paths have much in common, so how far a mean is off is told by pictures of other samples.
#[test]
fn shared_paths_find_what_lone_paths_find() {
    let scene = room();
    let reference = render(&scene, &Method::default(), samples(8192), 16);
    let (expected, of_expected) = reference.mean_and_error();
    for (splits, direct, roulette) in [(1, Direct::Mis, Roulette::Throughput), (4, Direct::Light, Roulette::Fixed)] {
        let method = with(|m| (m.reuse, m.splits, m.direct, m.roulette) = (Reuse::Paths, splits, direct, roulette));
        let prepared = crate::testing::prepare(&scene, &method);
        let frame = Rect::frame(scene.film.width, scene.film.height);
        let part = |k: u32| {
            let work = Work::Uniform { first: 64 * k, samples: 64 };
            render_rect(&prepared, &settings(&scene, &method, 16), frame, work).mean_and_error().0
        };
        let means: Vec<f64> = (0..48).map(part).collect();
        let n = means.len() as f64;
        let mean = means.iter().sum::<f64>() / n;
        let error = (means.iter().map(|m| (m - mean) * (m - mean)).sum::<f64>() / (n - 1.0) / n).sqrt();
        let off = (mean - expected) / (error * error + of_expected * of_expected).sqrt();
        assert!(error < 4e-3 * mean && off.abs() < 4.0, "{mean} ± {error}, expected {expected} ± {of_expected}: {off}");
    }
}

/// A mirror throws a small lamp's image at a ceiling: light of closed form, which chance alone seldom finds.
#[test]
fn caustics_are_aimed_at_without_bias() {
    let caustic = |radius: f64| {
        scene(json!({
            "camera": { "type": "orthographic", "height": 1e-3, "position": [0.5, 1, 0], "target": [0.5, 4, 0], "up": [0, 0, 1] },
            "materials": {
                "mirror": { "type": "mirror", "reflectance": 0.8 }, "wall": { "type": "diffuse", "reflectance": 0.5 },
                "black": { "type": "diffuse", "reflectance": 0 }
            },
            "shapes": [
                { "type": "quad", "material": "mirror", "vertices": [[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]] },
                { "type": "disk", "material": "black", "center": [0, 2, 0], "normal": [0, -1, 0], "radius": radius,
                  "emission": { "radiance": 40 } },
                { "type": "quad", "material": "wall", "vertices": [[-4, 4, -4], [4, 4, -4], [4, 4, 4], [-4, 4, 4]] }
            ]
        }))
    };
    let radius = 0.1;
    // The ceiling sees the disk's image, 6 below it and 0.5 aside: rho / pi x 0.8 L x area cos^2 / d^2 with d^2 = 36.25.
    let expected = 0.5 * 0.8 * 40.0 * radius * radius * 36.0 / (36.25 * 36.25);
    let scene = caustic(radius);
    let image = |aim, direct, splits| {
        let method = with(|m| (m.aim, m.direct, m.splits, m.max_depth) = (aim, direct, splits, 3));
        render(&scene, &method, samples(4096), 16).mean_and_error()
    };
    for (direct, splits) in [(Direct::Mis, 1), (Direct::Bsdf, 1), (Direct::Light, 1), (Direct::Mis, 4)] {
        let ((mean, error), (_, chance)) = (image(Aim::Delta, direct, splits), image(Aim::Off, direct, splits));
        assert!((mean - expected).abs() <= 4.5 * error + 2e-3 * expected, "{direct}: {mean} ± {error}, not {expected}");
        assert!(error < 0.02 * expected && error < 0.25 * chance, "{direct}: {error} against {chance} by chance");
    }
}

/// With nothing but a sky of 1 whatever reflects all light is 1 to look at, mirrors and glass too.
#[test]
fn a_white_furnace_stays_white_where_directions_are_aimed() {
    let ball =
        |material: &str, x: f64| json!({ "type": "sphere", "material": material, "center": [x, 0, 0], "radius": 0.9 });
    let scene = scene(json!({
        "camera": { "position": [0, 2, 6], "target": [0, 0, 0], "fov": 60 },
        "materials": { "mirror": { "type": "mirror" }, "glass": { "type": "dielectric" },
                       "white": { "type": "diffuse", "reflectance": 1 } },
        "shapes": [ball("mirror", -2.0), ball("white", 0.0), ball("glass", 2.0)],
        "environment": { "type": "constant", "radiance": 1 }
    }));
    for splits in [1, 4] {
        let method = with(|m| (m.aim, m.splits, m.max_depth) = (Aim::Delta, splits, 200));
        let (mean, error) = render(&scene, &method, samples(1024), 16).mean_and_error();
        assert!((mean - 1.0).abs() < 4.5 * error + 1e-4 && error < 2e-3, "{mean} ± {error}");
    }
}

#[test]
fn parts_of_the_light_transport_add_up() {
    let scene = room();
    for direct in [Direct::Bsdf, Direct::Hemisphere, Direct::Light, Direct::Mis] {
        let image = |only, max_depth| {
            let method = with(|m| (m.direct, m.only, m.max_depth) = (direct, only, max_depth));
            render(&scene, &method, samples(16), 16).film.moments
        };
        let whole = image(None, 8);
        let parts = [image(None, 0), image(Some(Only::Direct), 8), image(Some(Only::Indirect), 8)];
        for (i, pixel) in whole.iter().enumerate() {
            let sum: f64 = parts.iter().map(|part| part[i].luminance()).sum();
            assert!((sum - pixel.luminance()).abs() <= 1e-5 * pixel.luminance(), "{direct}, pixel {i}");
        }
        assert!(parts.iter().all(|part| part.iter().any(|pixel| pixel.luminance() > 0.0)));
    }
}

#[test]
fn every_further_bounce_adds_its_share_in_a_furnace() {
    let (_, scene, ..) = shipped().into_iter().find(|(name, ..)| name == "furnace-box.json").unwrap();
    for depth in 0..4 {
        // rho = 0.5, Le = 1: (1 - rho^(d+1)) / (1 - rho).
        let expected = 2.0 * (1.0 - 0.5f64.powi(depth as i32 + 1));
        let image = render(&scene, &with(|m| m.max_depth = depth), samples(512), 16);
        let (mean, error) = image.mean_and_error();
        assert!(error <= 2.5e-4 * expected, "depth {depth}: {error} is too coarse");
        assert!((mean - expected).abs() <= 1e-3 * expected, "depth {depth}: {mean} ± {error}");
    }
}

#[test]
fn roulette_keeps_the_energy_of_long_paths() {
    // Le = 1 and rho = 0.99 in a closed sphere: 100, and 1000 bounces leave out 0.004% of it.
    let scene = scene(json!({
        "camera": { "position": [0.3, 0.2, 0.5], "target": [0, 0, 0] },
        "materials": { "wall": { "type": "diffuse", "reflectance": 0.99 } },
        "shapes": [{ "type": "sphere", "material": "wall", "radius": 2, "emission": { "radiance": 1, "two_sided": true } }]
    }));
    for (roulette, n) in [(Roulette::Throughput, 256), (Roulette::Late, 128), (Roulette::Off, 64)] {
        let image = render(&scene, &with(|m| (m.roulette, m.max_depth) = (roulette, 1000)), samples(n), 16);
        let (mean, error) = image.mean_and_error();
        assert!((mean - 100.0).abs() <= 4.5 * error + 0.005, "{roulette}: {mean} ± {error}");
    }
}

#[test]
fn lamps_without_a_surface_light_by_their_laws() {
    // The plane reflects 0.5; the camera looks straight down at the origin.
    let plane = |lights: Value| {
        scene(json!({
            "camera": { "type": "orthographic", "height": 1e-4, "position": [0, 5, 0], "target": [0, 0, 0], "up": [0, 0, 1] },
            "materials": { "plane": { "type": "diffuse", "reflectance": 0.5 } },
            "shapes": [{ "type": "quad", "material": "plane",
                "vertices": [[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9]] }],
            "lights": lights
        }))
    };
    let inv_pi = std::f64::consts::FRAC_1_PI;
    let cases = [
        // rho / pi x I cos / d^2 with d^2 = 25, cos = 4/5.
        (json!([{ "type": "point", "position": [3, 4, 0], "intensity": 50 }]), 0.5 * inv_pi * 50.0 * 0.8 / 25.0),
        // rho / pi x E cos 45.
        (
            json!([{ "type": "directional", "direction": [1, -1, 0], "irradiance": 2 }]),
            0.5 * inv_pi * 2.0 / 2f64.sqrt(),
        ),
        // On the axis of a spot, at full strength.
        (
            json!([{ "type": "spot", "position": [0, 2, 0], "target": [0, 0, 0], "intensity": 8, "beam_angle": 10 }]),
            0.5 * inv_pi * 8.0 / 4.0,
        ),
    ];
    for (lights, expected) in cases {
        let image = render(&plane(lights.clone()), &Method::default(), samples(16), 4);
        for pixel in &image.film.moments {
            assert!((pixel.luminance() / expected - 1.0).abs() < 1e-4, "{lights}: {}", pixel.luminance());
        }
    }
}

#[test]
fn no_light_leaks_through_smoothed_normals() {
    // A closed cube whose vertex normals point along its diagonals, in bright surroundings, seen from inside.
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|bit| 2.0 * f64::from(bit) - 1.0);
    let scene = scene(json!({
        "camera": { "position": [0.1, 0.2, 0.3], "target": [1, -0.4, -1], "fov": 120 },
        "shapes": [{ "type": "mesh", "normals": "smooth", "positions": (0..8).map(corner).collect::<Vec<_>>(),
            "triangles": [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
                          [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]] }],
        "environment": { "type": "constant", "radiance": 1 },
        "film": { "width": 24, "height": 24 }
    }));
    for direct in [Direct::Hemisphere, Direct::Light, Direct::Mis] {
        let image = render(&scene, &with(|m| m.direct = direct), samples(64), 16);
        // At the cube's edges the rounded start of one ray in a million may lie beyond the other face.
        let (mean, _) = image.mean_and_error();
        assert!(mean < 1e-5, "{direct}: {mean}");
    }
}

#[test]
fn masks_let_their_share_pass_along_paths_and_to_lights() {
    let veil = json!({ "veil": { "type": "diffuse", "reflectance": 0, "opacity": 0.25 }, "white": { "type": "diffuse", "reflectance": 1 } });
    let sheet = |y: f64, material: &str| json!({ "type": "quad", "material": material, "vertices": [[-9, y, -9], [-9, y, 9], [9, y, 9], [9, y, -9]] });
    let down = json!({ "position": [0, 5, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 20 });
    // Two veils before a background of 1: 0.75^2.
    let through = scene(json!({ "camera": down, "materials": veil, "shapes": [sheet(1.0, "veil"), sheet(0.0, "veil")],
        "environment": { "type": "constant", "radiance": 1 } }));
    let image = render(&through, &Method::default(), samples(256), 16);
    let (mean, error) = image.mean_and_error();
    assert!((mean - 0.5625).abs() < 5.0 * error && error < 0.01, "{mean} ± {error}");
    // Sun of irradiance pi on white under one veil, the veil above the camera: 0.75 for certain.
    let under = scene(json!({ "camera": down, "materials": veil, "shapes": [sheet(0.0, "white"), sheet(8.0, "veil")],
        "lights": [{ "type": "directional", "direction": [0, -1, 0], "irradiance": std::f64::consts::PI }] }));
    for pixel in &render(&under, &with(|m| m.max_depth = 1), samples(16), 4).film.moments {
        assert!((pixel.luminance() - 0.75).abs() < 1e-5, "{}", pixel.luminance());
    }
}

#[test]
fn instances_look_like_copies_and_stretched_spheres_like_ellipsoids() {
    let tetrahedron = json!([{ "type": "mesh", "material": "red", "normals": "smooth",
        "positions": [[0.5, 0.5, 0.5], [-0.5, -0.5, 0.5], [-0.5, 0.5, -0.5], [0.5, -0.5, -0.5]],
        "triangles": [[0, 1, 3], [0, 2, 1], [0, 3, 2], [1, 2, 3]] }]);
    let places = [
        json!([{ "scale": [1, 2, 1] }, { "translate": [-1, 0, 0] }]),
        json!([{ "rotate": { "axis": [1, 2, 3], "degrees": 70 } }, { "translate": [1, 0, 0] }]),
    ];
    let of = |shapes: Vec<Value>| {
        scene(json!({
            "camera": { "position": [0, 1, 5], "target": [0, 0, 0], "fov": 40 },
            "materials": { "red": { "type": "diffuse", "reflectance": [0.8, 0.2, 0.2] } },
            "objects": { "thing": tetrahedron },
            "shapes": shapes,
            "environment": { "type": "constant", "radiance": 1 }
        }))
    };
    let instances =
        of(places.iter().map(|t| json!({ "type": "instance", "object": "thing", "transform": t })).collect());
    let copies = of(places
        .iter()
        .map(|t| {
            let mut copy = tetrahedron[0].clone();
            copy["transform"] = t.clone();
            copy
        })
        .collect());
    let image = |scene| render(scene, &Method::default(), samples(64), 16);
    let (a, b) = (image(&instances), image(&copies));
    for (a, b) in a.film.moments.iter().zip(&b.film.moments) {
        let allowed = 5.0 * (a.variance_of_mean().unwrap() + b.variance_of_mean().unwrap()).sqrt() + 2e-3;
        assert!((a.luminance() - b.luminance()).abs() < allowed, "{a:?} {b:?}");
    }
    // A white ellipsoid is convex: in a white furnace it cannot be seen.
    let mut ellipsoid = of(vec![json!({ "type": "sphere", "transform": [{ "scale": [1, 0.3, 0.7] }] })]);
    let white = serde_json::from_value(json!({ "type": "diffuse", "reflectance": 1 })).unwrap();
    ellipsoid.materials.insert("red".into(), white);
    ellipsoid.shapes[0].material = Some("red".into());
    for pixel in &render(&ellipsoid, &with(|m| m.roulette = Roulette::Off), samples(16), 4).film.moments {
        assert!((pixel.luminance() - 1.0).abs() < 1e-4, "{}", pixel.luminance());
    }
}

#[test]
fn emission_that_varies_over_a_lamp_is_found_alike_by_all() {
    let scene = scene(json!({
        "camera": { "position": [0, 1, 4], "target": [0, 0.6, 0], "fov": 40 },
        "shapes": [
            { "type": "quad", "vertices": [[-2, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]] },
            { "type": "quad", "vertices": [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]],
              "emission": { "radiance": { "type": "checkerboard", "color0": [5, 0, 1], "color1": 0.1,
                                          "uv": { "scale": [3, 2] } } } },
            { "type": "sphere", "center": [0, 0.5, 0], "radius": 0.3,
              "emission": { "radiance": { "type": "checkerboard", "color0": [0, 4, 1], "color1": 0,
                                          "uv": { "scale": [4, 3] } } } }
        ]
    }));
    let reference = render(&scene, &Method::default(), samples(512), 16);
    for direct in [Direct::Hemisphere, Direct::Light] {
        let image = render(&scene, &with(|m| m.direct = direct), samples(512), 16);
        assert_agree(&image, &reference, 4.5, direct.name());
    }
}

#[test]
fn a_masked_lamp_gives_light_where_it_is_not_cut_out() {
    let lit = |opacity: Value, shape: Value| {
        let mut lamp = shape;
        lamp["material"] = json!("lamp");
        scene(json!({
            "camera": { "position": [0, 1, 4], "target": [0, 0.2, 0], "fov": 30 },
            "materials": { "lamp": { "type": "diffuse", "reflectance": 0, "opacity": opacity } },
            "shapes": [{ "type": "quad", "vertices": [[-2, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]] }, lamp]
        }))
    };
    let squares = json!({ "type": "checkerboard", "color0": 1, "color1": 0, "uv": { "scale": [3, 2] } });
    let quad = json!({ "type": "quad", "vertices": [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]], "emission": 5 });
    let textured = json!({ "type": "checkerboard", "color0": [5, 0, 1], "color1": 2, "uv": { "scale": [5, 5] } });
    let sphere =
        json!({ "type": "sphere", "center": [0, 1.2, 0], "radius": 0.5, "emission": { "radiance": textured } });
    let triangle = json!({ "type": "mesh", "positions": [[-1, 2, -1], [1, 2, -1], [0, 2, 1]],
        "triangles": [[0, 1, 2]], "uvs": [[0, 0], [1, 0], [0.5, 1]], "emission": 5 });
    for shape in [quad.clone(), sphere, triangle] {
        let scene = lit(squares.clone(), shape);
        // Rays that meet the lamp by chance know of its mask, and of nothing else.
        let image = |direct| render(&scene, &with(|m| m.direct = direct), samples(1024), 16);
        let reference = image(Direct::Hemisphere);
        for direct in [Direct::Light, Direct::Mis] {
            assert_agree(&image(direct), &reference, 4.5, direct.name());
        }
    }
    // A quarter of a lamp gives a quarter of its light; what else it does is left out here.
    for direct in [Direct::Light, Direct::Mis] {
        let of = |opacity| {
            let method = with(|m| (m.direct, m.only) = (direct, Some(Only::Direct)));
            render(&lit(json!(opacity), quad.clone()), &method, samples(1024), 16).mean_and_error()
        };
        let ((whole, e1), (quarter, e2)) = (of(1.0), of(0.25));
        let allowed = 4.5 * (e2 * e2 + e1 * e1 / 16.0).sqrt();
        assert!((quarter - 0.25 * whole).abs() <= allowed, "{direct}: {quarter} of {whole}");
        assert!(allowed < 0.03 * quarter, "{direct}: {allowed} is too coarse for {quarter}");
    }
}

#[test]
fn weights_stay_within_bounds_at_any_density() {
    let densities = [0.0, 1e-38, 1e-30, 1e-3, 1.0, 1e10, 1e30, f32::MAX];
    for a in densities {
        for b in densities {
            let (wa, wb) = (super::power_heuristic(a, b), super::power_heuristic(b, a));
            assert!((0.0..=1.0).contains(&wa), "{a} {b}: {wa}");
            if a > 0.0 || b > 0.0 {
                assert!((wa + wb - 1.0).abs() < 1e-6, "{a} {b}: {wa} + {wb}");
            }
        }
    }
}

#[test]
fn pixels_that_see_nothing_but_the_void_or_a_black_lamp_are_known() {
    let scene = scene(json!({
        "camera": { "position": [0, 0, 4], "target": [0, 0, 0], "fov": 60 },
        "materials": { "black": { "type": "diffuse", "reflectance": 0 } },
        "shapes": [{ "type": "sphere", "material": "black", "emission": 3, "center": [-1, 0, 0] },
                   { "type": "sphere", "center": [1, 0, 0] }],
        "film": { "width": 32, "height": 32 }
    }));
    let image = render(&scene, &Method::default(), samples(64), 16);
    let of = |f: &dyn Fn(&Moments) -> bool| image.film.moments.iter().filter(|pixel| pixel.known && f(pixel)).count();
    let (void, lamp) = (of(&|pixel| pixel.mean == [0.0; 3]), of(&|pixel| pixel.mean == [3.0; 3]));
    assert!(void > 500 && lamp > 30, "{void} {lamp}");
    assert_eq!(void + lamp, of(&|_| true), "an edge, or a surface that scatters, is never known");
}

/// With multiple importance sampling the picture's mean is left to BSDF sampling; light sampling alone must find it all.
#[test]
fn every_estimator_finds_the_light_of_a_picture() {
    let (width, height) = (16u32, 8u32);
    let sky = |i: u32| match i {
        20 => [90.0, 80.0, 60.0, 1.0],
        i if i < width * height / 2 => [0.4, 0.6, 1.0, 1.0],
        _ => [0.1, 0.05, 0.0, 1.0],
    };
    let pixels = (0..width * height).map(sky).collect();
    let picture = Picture { width, height, pixels, encoding: Encoding::Linear };
    let assets = Assets { pictures: [("sky.exr".to_owned(), picture)].into(), ..Assets::default() };
    let scene = scene(json!({
        "camera": { "position": [0, 1, 4], "target": [0, 0.4, 0], "fov": 35 },
        "materials": { "metal": { "type": "conductor", "metal": "Cu", "roughness": 0.3 },
                       "frosted": { "type": "dielectric", "roughness": 0.4 } },
        "shapes": [
            { "type": "quad", "vertices": [[-2, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]] },
            { "type": "sphere", "center": [-0.5, 0.5, 0], "radius": 0.5, "material": "metal" },
            { "type": "sphere", "center": [0.6, 0.4, 0.3], "radius": 0.4, "material": "frosted" }
        ],
        "environment": { "type": "image", "file": "sky.exr" }
    }));
    let image = |direct| {
        let method = with(|m| m.direct = direct);
        let prepared = Loaded::new(&scene, &assets, &method, [8, 8]).unwrap().build();
        render_rect(&prepared, &settings(&scene, &method, 16), Rect::frame(8, 8), samples(1024))
    };
    let reference = image(Direct::Auto);
    for direct in [Direct::Hemisphere, Direct::Light, Direct::Mis] {
        assert_agree(&image(direct), &reference, 4.5, direct.name());
    }
}
