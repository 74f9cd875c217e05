use common::{
    film::Moments,
    method::{Bvh, Method, Only, Reuse},
    pass::Work,
    protocol::RenderSettings,
    scene::SceneFile,
    tile::Rect,
};
use serde_json::json;

use crate::{
    Assets, Prepared,
    math::Vec3,
    special::{Special, Without},
    testing::{prepare, render, render_rect, settings},
};

/// A lamp over a ball on a floor; the upper part of the image is void.
fn scene() -> SceneFile {
    let scene = json!({
        "tessera": 1,
        "camera": { "position": [0, 1, 6], "target": [0, 1, 0], "fov": 60, "lens_radius": 0.1 },
        "film": { "width": 24, "height": 20, "filter": "gaussian" },
        "shapes": [
            { "type": "quad", "vertices": [[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]] },
            { "type": "sphere", "center": [0, 0.6, 0], "radius": 0.6 },
            { "type": "disk", "center": [0, 3, 0], "normal": [0, -1, 0], "radius": 0.7, "emission": 5 }
        ]
    });
    SceneFile::parse(scene.to_string().as_bytes()).unwrap()
}

#[test]
fn any_split_of_pixels_and_samples_gives_the_same_bits() {
    for reuse in [Reuse::Off, Reuse::Paths] {
        let method = Method { reuse, ..Method::default() };
        let prepared = prepare(&scene(), &method);
        let in_waves = split_anyhow(&prepared, &method);
        let one_by_one = split_anyhow(&prepared.without(Without::all(&[Special::Waves])).unwrap(), &method);
        assert!(in_waves == one_by_one, "{reuse}");
    }
}

fn split_anyhow(prepared: &Prepared, method: &Method) -> Vec<Moments> {
    let settings = settings(&scene(), method, 16);
    let frame = Rect::frame(24, 20);
    let of = |rect, work| render_rect(prepared, &settings, rect, work).film;
    let whole = of(frame, Work::Uniform { first: 16, samples: 48 });
    for rect in frame.split(50).into_iter().chain([Rect { x: 7, y: 3, w: 5, h: 9 }]) {
        let part = of(rect, Work::Uniform { first: 16, samples: 48 });
        for (i, (x, y)) in rect.pixels().enumerate() {
            let j = (y * 24 + x) as usize;
            assert_eq!((part.moments[i], part.features[i]), (whole.moments[j], whole.features[j]), "{rect}");
        }
    }
    // The same samples as batches of each pixel; and a pixel that gets none is left as it is.
    let pixels = frame.area();
    let by_pixel =
        Work::PerPixel { first: vec![1; pixels], batches: (0..pixels).map(|i| 3 * (i as u32 % 2)).collect() };
    let by_pixel = of(frame, by_pixel);
    for i in 0..pixels {
        let expected = if i % 2 == 0 { Default::default() } else { whole.moments[i] };
        assert_eq!(by_pixel.moments[i], expected);
    }
    whole.moments
}

#[test]
fn pixels_that_share_paths_err_less_and_alike() {
    // The floor under a ball, lit by way of a wall: what is found by two scatterings.
    let mut scene = scene();
    let wall = json!({ "type": "quad", "vertices": [[-3, 0, -2], [3, 0, -2], [3, 4, -2], [-3, 4, -2]] });
    scene.shapes.push(serde_json::from_value(wall).unwrap());
    let of = |reuse| {
        let method = Method { reuse, only: Some(Only::Indirect), ..Method::default() };
        render(&scene, &method, Work::Uniform { first: 0, samples: 512 }, 8).film.moments
    };
    let (alone, shared) = (of(Reuse::Off), of(Reuse::Paths));
    // What the light reaches, and shadow of the ball.
    let pixels: Vec<usize> = (0..alone.len()).filter(|i| alone[*i].luminance() > 0.01).collect();
    assert!(pixels.len() > 50, "{}", pixels.len());
    let variance = |all: &[Moments]| pixels.iter().map(|i| all[*i].variance_of_mean().unwrap()).sum::<f64>();
    let ratio = variance(&alone) / variance(&shared);
    assert!(ratio > 2.0, "variance is {ratio} times less");
    // Neighbours hold 1/16 of each other's errors at least: their differences vary less than if they knew nothing of each other.
    let mut worst = 0.0f64;
    for i in &pixels {
        let (a, b) = (&alone[*i], &shared[*i]);
        let error = (a.variance_of_mean().unwrap() + b.variance_of_mean().unwrap()).sqrt();
        worst = worst.max((a.luminance() - b.luminance()).abs() / error);
    }
    assert!(worst < 5.5, "a pixel is {worst} standard errors off");
}

#[test]
fn no_bit_depends_on_how_the_tree_is_split() {
    let mut scene = scene();
    // Enough, and uneven enough, that splits differ.
    for i in 0..60 {
        let size = 0.9f64.powi(i);
        let ball =
            json!({ "type": "sphere", "center": [2.0 * size, 0.3 * size, -2.0 + 3.0 * size], "radius": 0.1 * size });
        scene.shapes.push(serde_json::from_value(ball).unwrap());
    }
    let image = |bvh| {
        let method = Method { bvh, ..Method::default() };
        let image = render(&scene, &method, Work::Uniform { first: 0, samples: 16 }, 16);
        (image.film.moments, image.statistics.node_tests)
    };
    let (sah, node_tests) = image(Bvh::Sah);
    let mut differ = false;
    for bvh in [Bvh::MeanCentroid, Bvh::Midpoint] {
        let (other, tests) = image(bvh);
        assert!(sah == other, "{bvh}");
        differ |= tests != node_tests;
    }
    assert!(differ, "the choice reaches the tree");
}

#[test]
fn a_short_last_batch_weighs_by_its_samples() {
    let image = render(&scene(), &Method::default(), Work::Uniform { first: 0, samples: 37 }, 16);
    assert!(image.film.moments.iter().all(|pixel| (pixel.samples, pixel.batches) == (37, 3)));
}

#[test]
fn the_textbook_rule_stops_where_nothing_varies_and_goes_on_where_light_does() {
    let work = Work::Textbook { batch: 32, tolerance: 0.05, max_samples: 320 };
    let image = render(&scene(), &Method::default(), work, 16);
    let counts: Vec<u32> = image.film.moments.iter().map(|pixel| pixel.samples).collect();
    assert!(counts.iter().all(|n| n % 32 == 0 && (32..=320).contains(n)));
    assert_eq!(counts[0], 32, "the void in the corner stops at the first look");
    assert!(counts.contains(&320), "the edge of a shadow does not");
    for pixel in &image.film.moments {
        assert_eq!(pixel.batches, pixel.samples / 32);
    }
    let last = render(&scene(), &Method::default(), Work::Textbook { batch: 32, tolerance: 1e-9, max_samples: 50 }, 16);
    assert!(last.film.moments.iter().any(|pixel| (pixel.samples, pixel.batches) == (50, 2)), "the cap is kept");
}

#[test]
fn a_replayed_sample_has_the_bits_of_the_image() {
    let scene = scene();
    for reuse in [Reuse::Off, Reuse::Paths] {
        let method = Method { reuse, ..Method::default() };
        replays_are_those_of_the_image(&prepare(&scene, &method), &settings(&scene, &method, 1));
    }
}

fn replays_are_those_of_the_image(prepared: &Prepared, settings: &RenderSettings) {
    for sample in 0..4 {
        let row = Rect { x: 0, y: 13, w: 24, h: 1 };
        let image = render_rect(prepared, settings, row, Work::Uniform { first: sample, samples: 1 });
        let mut alone = Vec::new();
        prepared.samples(settings, 13, sample..sample + 1, |x, _, radiance| alone.push((x, radiance)));
        alone.sort_by_key(|(x, _)| *x);
        for (x, pixel) in image.film.moments.iter().enumerate() {
            let replay = prepared.sample(settings, [x as u32, 13], sample);
            assert_eq!(alone[x], (x as u32, replay.radiance));
            assert_eq!(replay.radiance.as_dvec3().to_array(), pixel.mean);
            assert_eq!(replay.to_string().lines().count(), replay.vertices.len() + 1);
        }
    }
}

#[test]
fn features_are_those_of_the_first_hit() {
    let image = render(&scene(), &Method::default(), Work::Uniform { first: 0, samples: 64 }, 16);
    // The middle of the ball: 0.5 grey, normal towards the camera, near z = 0.6.
    let middle = image.film.features[11 * 24 + 12];
    assert!((middle.albedo[0] - 0.5).abs() < 1e-6, "{middle:?}");
    assert!(Vec3::from_array(middle.normal).dot(Vec3::Z) > 0.9, "{middle:?}");
    assert!((middle.depth - 5.45).abs() < 0.2, "{middle:?}");
    assert_eq!(image.film.features[0], Default::default(), "the void has none");
}

#[test]
fn samples_that_are_not_finite_are_counted_named_and_left_out() {
    let scene = json!({
        "tessera": 1, "camera": { "position": [0, 0, 3], "target": [0, 0, 0] }, "film": { "width": 8, "height": 8 },
        "shapes": [{ "type": "sphere", "radius": 0.4, "emission": 1e60 }]
    });
    let scene = SceneFile::parse(scene.to_string().as_bytes()).unwrap();
    let image = render(&scene, &Method::default(), Work::Uniform { first: 0, samples: 16 }, 4);
    assert!(image.statistics.rejected > 0 && image.statistics.rejected < image.statistics.samples);
    assert!(image.film.moments.iter().all(|pixel| pixel.mean.iter().all(|c| c.is_finite()) && pixel.samples == 16));
    let [x, y, sample] = image.first_rejected.unwrap();
    let replay = prepare(&scene, &Method::default()).sample(&settings(&scene, &Method::default(), 4), [x, y], sample);
    assert!(!replay.radiance.is_finite());
}

#[test]
fn what_is_missing_is_an_error_and_what_is_odd_a_warning() {
    let dark = json!({ "tessera": 1, "camera": { "position": [0, 0, 3], "target": [0, 0, 0] },
        "shapes": [{ "type": "sphere" },
                   { "type": "mesh", "positions": [[0, 0, 0], [1, 0, 0], [2, 0, 0]], "triangles": [[0, 1, 2]] }] });
    let dark = SceneFile::parse(dark.to_string().as_bytes()).unwrap();
    let loaded = crate::Loaded::new(&dark, &Assets::default(), &Method::default(), [8, 8]).unwrap();
    assert!(loaded.warnings()[0].contains("shapes[1]: 1 of 1 triangles"), "{:?}", loaded.warnings());
    assert!(loaded.warnings()[1].contains("no light"), "{:?}", loaded.warnings());
    let masked = json!({ "tessera": 1, "camera": { "position": [0, 0, 3], "target": [0, 0, 0] },
        "materials": { "lace": { "type": "diffuse", "opacity": 0.5 } },
        "shapes": [{ "type": "sphere", "material": "lace" }, { "type": "sphere", "center": [0, 3, 0], "emission": 1 }] });
    let masked = SceneFile::parse(masked.to_string().as_bytes()).unwrap();
    let shared = Method { reuse: Reuse::Paths, ..Method::default() };
    let loaded = crate::Loaded::new(&masked, &Assets::default(), &shared, [8, 8]).unwrap();
    assert_eq!(loaded.warnings(), ["--reuse paths shares nothing: the scene has opacity masks"]);
    let error = |shape: serde_json::Value| {
        let scene =
            json!({ "tessera": 1, "camera": { "position": [0, 0, 3], "target": [0, 0, 0] }, "shapes": [shape] });
        let scene = SceneFile::parse(scene.to_string().as_bytes()).unwrap();
        crate::Loaded::new(&scene, &Assets::default(), &Method::default(), [8, 8]).unwrap_err().field
    };
    let quad = |vertices| json!({ "type": "quad", "vertices": vertices });
    assert_eq!(error(quad(json!([[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 0]]))), "shapes[0].vertices");
    assert_eq!(error(quad(json!([[0, 0, 0], [1, 0, 0], [0.1, 0.1, 0], [0, 1, 0]]))), "shapes[0].vertices");
    let stretched = json!({ "type": "sphere", "emission": 1, "transform": [{ "scale": [1, 2, 1] }] });
    assert_eq!(error(stretched), "shapes[0].transform");
    assert_eq!(error(json!({ "type": "mesh", "file": "gone.obj" })), "shapes[0].file");
}
