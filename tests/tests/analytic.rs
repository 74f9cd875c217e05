//! Scenes whose answer is known: what the tracer makes of scenes/analytic, held to the value that each file
//! derives in its description.

use std::collections::BTreeSet;

use common::{job::Quality, method::MethodChoices, scene::SceneFile};
use tessera_tests::direct::{Picture, render, render_by_auto, scene};

/// What the mean of an image may be off, of what its file expects. Standard errors are at most a quarter of it, so
/// that a renderer that is right passes and one that is wrong by half as much again does not.
const RELATIVE: f64 = 0.001;

/// Render a scene and compare: the mean of the image within [`RELATIVE`] of what its file expects and within 4.5
/// standard errors, and every pixel within 6 of its own where the file speaks of every pixel.
fn check(name: &str, samples: u32) {
    let path = format!("analytic/{name}.json");
    let scene = scene(&path);
    let picture = render(&path, &scene, samples, MethodChoices::default());
    let expected = hold(name, samples, &scene, &picture);
    if scene.description.contains(" in every pixel") {
        for (i, pixel) in picture.moments.iter().enumerate() {
            let bound = 6.0 * pixel.standard_error().unwrap() + 1e-5 * expected;
            let off = (pixel.luminance() - expected).abs();
            assert!(off <= bound, "{name}: pixel {i} is {}, expected {expected}", pixel.luminance());
        }
    }
}

/// Hold the mean of a picture to what its file expects, and tell that.
fn hold(name: &str, samples: u32, scene: &SceneFile, picture: &Picture) -> f64 {
    let (_, answer) = scene.description.split_once("Expected: ").expect("an analytic scene says what is expected");
    let expected: f64 = answer.split(' ').next().unwrap().parse().unwrap();
    assert_eq!(picture.rejected, 0, "{name}: samples that are not finite");
    let pixels = picture.moments.len() as f64;
    let mean = picture.moments.iter().map(|pixel| pixel.luminance()).sum::<f64>() / pixels;
    let variance: f64 = picture.moments.iter().filter_map(|pixel| pixel.variance_of_mean()).sum();
    let error = variance.sqrt() / pixels;
    let off = (mean - expected).abs();
    assert!(off <= RELATIVE * expected, "{name}: {mean} +- {error} at {samples} samples, expected {expected}");
    assert!(4.0 * error <= RELATIVE * expected, "{name}: {error}: {samples} samples are too few");
    assert!(off <= 4.5 * error + 1e-6 * expected, "{name}: {mean} is {} standard errors off", off / error);
    expected
}

#[test]
fn furnaces() {
    check("furnace-box", 4096);
    // Roulette ends these paths at any length: their sum has the spread of a geometric distribution.
    check("furnace-sphere", 20_480);
    check("furnace-truncated", 1024);
}

#[test]
fn a_white_body_in_white_surroundings_cannot_be_seen() {
    check("white-furnace", 256);
}

#[test]
fn a_sphere_light_over_a_plane() {
    check("sphere-light", 4096);
}

#[test]
fn lamberts_polygon_in_full_view_and_behind_a_half_plane() {
    check("polygon-light", 8192);
    check("half-plane", 16_384);
}

/// What `auto` chooses is no more biased than any method, though it looked at samples of the scene before: frames large
/// enough that methods are tried.
#[test]
fn what_auto_chooses_is_not_biased() {
    let mut chosen = BTreeSet::new();
    for (name, samples) in [
        ("sphere-light", 32),
        ("polygon-light", 32),
        ("half-plane", 64),
        ("white-furnace", 32),
        ("furnace-truncated", 32),
    ] {
        let path = format!("analytic/{name}.json");
        let mut scene = scene(&path);
        (scene.film.width, scene.film.height) = (128, 128);
        let (picture, plan) = render_by_auto(&path, &scene, samples);
        assert!(plan.untried.is_none() && plan.considered.len() > 1, "{name}: methods were tried: {plan:?}");
        hold(name, samples, &scene, &picture);
        chosen.insert(plan.chosen);
    }
    assert!(chosen.len() > 1, "scenes differ in what serves them: {chosen:?}");
}

#[test]
fn form_factors_of_a_cube() {
    check("cube-opposite", 1024);
    check("cube-adjacent", 4096);
}

#[test]
fn without_light_there_is_no_light() {
    check("black", 64);
}

/// What the files ask for is what a user gets by rendering them: enough for the value to be recognised.
#[test]
fn the_files_ask_for_samples() {
    for name in ["furnace-box", "furnace-sphere", "polygon-light", "half-plane", "sphere-light", "black"] {
        let quality = scene(&format!("analytic/{name}.json")).settings.quality;
        assert!(matches!(quality, Some(Quality::Samples { .. })), "{name}");
    }
}

/// An object placed twice keeps the materials of its shapes: the same picture as with the shapes written out.
#[test]
fn instances_look_like_copies() {
    let parse = |middle: &str| {
        let text = format!(
            r#"{{"tessera":1,"camera":{{"position":[0,0,6],"target":[0,0,0],"fov":40}},"film":{{"width":24,"height":16}},
            "materials":{{"red":{{"type":"diffuse","reflectance":[0.8,0.1,0.05]}},"blue":{{"type":"diffuse","reflectance":[0.1,0.2,0.8]}}}},
            {middle},"environment":{{"type":"constant","radiance":1}}}}"#
        );
        SceneFile::parse(text.as_bytes()).unwrap()
    };
    let tent = |material: &str, x: f64| {
        format!(
            r#"{{"type":"mesh","material":"{material}","positions":[[-0.5,-0.5,0],[0.5,-0.5,0],[0,0.5,0.5]],
            "triangles":[[0,1,2]],"transform":[{{"translate":[{x},0,0]}}]}}"#
        )
    };
    let group = |x: f64| format!("{},{}", tent("red", x - 0.6), tent("blue", x + 0.6));
    let copies = parse(&format!(r#""shapes":[{},{}]"#, group(-1.25), group(1.25)));
    let place = |x: f64| format!(r#"{{"type":"instance","object":"pair","transform":[{{"translate":[{x},0,0]}}]}}"#);
    let instances =
        parse(&format!(r#""objects":{{"pair":[{}]}},"shapes":[{},{}]"#, group(0.0), place(-1.25), place(1.25)));
    let (copies, instances) =
        [copies, instances].map(|scene| render("inline.json", &scene, 64, MethodChoices::default()).moments).into();
    for (i, (a, b)) in copies.iter().zip(&instances).enumerate() {
        for c in 0..3 {
            assert!((a.mean[c] - b.mean[c]).abs() < 0.02, "pixel {i}: {:?} copied, {:?} placed", a.mean, b.mean);
        }
    }
}
