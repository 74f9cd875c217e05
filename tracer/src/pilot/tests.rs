//! What is chosen where one knows what must be.

use common::{
    job::Quality,
    method::{Aim, LightPick, LightSampling, MethodChoices, Roulette},
    pass::Work,
    plan::Facts,
    scene::SceneFile,
    tile::Rect,
};
use serde_json::{Value, json};

use super::*;
use crate::{
    special::{Special, Without},
    testing::{prepare, render, settings},
};

fn scene(rest: Value) -> SceneFile {
    let mut scene = json!({
        "tessera": 1, "camera": { "position": [0, 1, 6], "target": [0, 1, 0], "fov": 50 },
        "film": { "width": 128, "height": 128 },
        "shapes": [{ "type": "quad", "vertices": [[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]] },
                   { "type": "sphere", "center": [0, 0.6, 0], "radius": 0.6 }]
    });
    for (key, value) in rest.as_object().unwrap() {
        match (scene.get_mut(key), value) {
            (Some(Value::Array(old)), Value::Array(new)) => old.extend(new.iter().cloned()),
            _ => scene[key] = value.clone(),
        }
    }
    SceneFile::parse(scene.to_string().as_bytes()).unwrap()
}

fn plan_for(scene: &SceneFile, method: &Method, named: MethodChoices) -> MethodPlan {
    let region = Rect::frame(scene.film.width, scene.film.height);
    choose(&prepare(scene, method), &settings(scene, method, 16), &Trial { region, named, quality: None })
}

fn plan(scene: &SceneFile) -> MethodPlan {
    plan_for(scene, &Method::default(), MethodChoices::default())
}

fn small_lamp() -> SceneFile {
    scene(json!({ "shapes": [{ "type": "disk", "center": [0, 3, 0], "normal": [0, -1, 0], "radius": 0.1,
        "emission": 100 }] }))
}

#[test]
fn a_small_lamp_is_sampled_and_a_white_sky_is_run_into() {
    let lamp = plan(&small_lamp());
    assert!(matches!(lamp.method.direct, Direct::Light | Direct::Mis), "{lamp:?}");
    let bsdf = lamp.considered.iter().find(|tried| tried.name.starts_with("bsdf")).unwrap();
    assert!(bsdf.efficiency < 0.5, "{lamp:?}");
    let sky = plan(&scene(json!({ "environment": { "type": "constant", "radiance": 1 } })));
    assert_eq!(sky.method.direct, Direct::Bsdf, "a sample of a white sky costs a ray and tells nothing: {sky:?}");
}

#[test]
fn what_is_chosen_has_the_best_efficiency_of_what_was_tried_or_nearly() {
    for scene in [small_lamp(), scene(json!({ "environment": { "type": "constant", "radiance": 1 } }))] {
        let plan = plan(&scene);
        assert!(plan.considered.iter().any(|tried| tried.name == plan.chosen && tried.efficiency == 1.0), "{plan:?}");
        // A first look at few pixels may flatter what a second found no better.
        // To share paths must gain more than that.
        let most = |tried: &Considered| if tried.name.contains("reuse") { 1.6 } else { 1.3 };
        assert!(plan.considered.iter().all(|tried| tried.efficiency < most(tried)), "{plan:?}");
    }
}

#[test]
fn pixels_share_paths_where_most_light_comes_by_way_of_walls() {
    let wall = |vertices: Value| json!({ "type": "quad", "vertices": vertices });
    let room = |mask: f64| {
        let mut room = scene(json!({
            "shapes": [
                wall(json!([[-3, 4, -3], [3, 4, -3], [3, 4, 3], [-3, 4, 3]])),
                wall(json!([[-3, 0, -3], [3, 0, -3], [3, 4, -3], [-3, 4, -3]])),
                wall(json!([[-3, 0, 3], [-3, 0, -3], [-3, 4, -3], [-3, 4, 3]])),
                wall(json!([[3, 0, -3], [3, 0, 3], [3, 4, 3], [3, 4, -3]])),
                // It shines on the ceiling.
                { "type": "quad", "vertices": [[-1, 3, 1], [1, 3, 1], [1, 3, -1], [-1, 3, -1]], "emission": 10 }
            ],
            "materials": { "wall": { "type": "diffuse", "reflectance": 0.7, "opacity": mask } }
        }));
        room.shapes.iter_mut().for_each(|shape| shape.material = Some("wall".into()));
        room
    };
    let noise = || Quality::Noise { relative_error: 1e-3, confidence: 0.95, max_samples: 65_536 };
    let of = |scene: &SceneFile, quality: Quality, named: MethodChoices| {
        let region = Rect::frame(scene.film.width, scene.film.height);
        let trial = Trial { region, named: named.clone(), quality: Some(quality) };
        let method = named.resolve();
        let plan = choose(&prepare(scene, &method), &settings(scene, &method, 16), &trial);
        (plan, ruled_out(prepare(scene, &method).facts(), &trial))
    };
    let (plan, _) = of(&room(1.0), noise(), MethodChoices::default());
    assert_eq!(plan.method.reuse, Reuse::Paths, "{plan:?}");
    assert!(plan.chosen.contains("reuse=paths"), "{plan:?}");
    let best = plan.considered.iter().filter(|one| !one.name.contains("reuse")).map(|one| one.efficiency);
    assert!(best.fold(0.0, f64::max) < 0.7, "{plan:?}");
    let alone = |plan: &MethodPlan| plan.method.reuse == Reuse::Off;
    let counted = Quality::Samples { samples: 4096 };
    assert!(alone(&of(&room(1.0), counted, MethodChoices::default()).0), "a sample would be dearer");
    let named = MethodChoices { reuse: Some(Reuse::Off), ..MethodChoices::default() };
    assert!(alone(&of(&room(1.0), noise(), named).0), "it is named");
    let (plan, why) = of(&room(0.9), noise(), MethodChoices::default());
    assert!(alone(&plan) && why.iter().any(|one| one.what.contains("reuse") && one.why.contains("mask")), "{why:?}");
    // What the lamp gives directly is not shared.
    let (plan, _) = of(&small_lamp(), noise(), MethodChoices::default());
    assert!(alone(&plan), "{plan:?}");
}

#[test]
fn paths_split_where_that_pays_for_what_is_asked() {
    let sky = scene(json!({ "environment": { "type": "constant", "radiance": 1 } }));
    let splits = |quality: Option<Quality>| {
        let region = Rect::frame(sky.film.width, sky.film.height);
        let trial = Trial { region, named: MethodChoices::default(), quality };
        let method = Method::default();
        choose(&prepare(&sky, &method), &settings(&sky, &method, 16), &trial).method.splits
    };
    let noise = |relative_error| Quality::Noise { relative_error, confidence: 0.95, max_samples: 4096 };
    assert!(splits(None) > 1, "more ways are spread more evenly, and share a camera ray");
    assert!(splits(Some(noise(1e-4))) > 1);
    assert_eq!(splits(Some(noise(0.5))), 1, "the first samples do for that");
    assert_eq!(splits(Some(Quality::Samples { samples: 64 })), 1, "a number of samples is a price");
}

#[test]
fn the_choice_depends_on_neither_threads_nor_turns() {
    let scene = small_lamp();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(alone.install(|| plan(&scene)), plan(&scene));
}

#[test]
fn what_is_named_is_kept_and_what_facts_rule_out_is_not_tried() {
    let named = MethodChoices {
        light_sampling: Some(Some(LightSampling::Area)),
        light_samples: Some(1),
        roulette: Some(Roulette::Off),
        ..MethodChoices::default()
    };
    let plan_of = |named: MethodChoices| plan_for(&small_lamp(), &named.clone().resolve(), named);
    let plan = plan_of(named.clone());
    assert!(plan.considered.len() > 1 && plan.considered.iter().all(|tried| !tried.name.contains("solid")), "{plan:?}");
    assert_eq!((plan.method.light_samples, plan.method.roulette), (1, Roulette::Off));
    let all = plan_of(MethodChoices { direct: Some(Direct::Mis), ..named });
    assert_eq!((all.untried.as_deref(), all.considered.len()), (Some("the method is named"), 0));

    let point = json!({ "lights": [{ "type": "point", "position": [0, 3, 1], "intensity": 9 }] });
    let plan = self::plan(&scene(point));
    assert_eq!(plan.method.direct, Direct::Light, "no ray can hit a point");
    assert!(plan.considered.iter().all(|tried| tried.name.starts_with("light")), "{plan:?}");
    assert_eq!(self::plan(&scene(json!({}))).untried.as_deref(), Some("there is no light"));
    let tiny = scene(json!({ "film": { "width": 16, "height": 16 },
        "environment": { "type": "constant", "radiance": 1 } }));
    assert!(self::plan(&tiny).untried.unwrap().contains("small"));
}

#[test]
fn a_scene_for_another_method_has_the_bits_of_one_loaded_for_it() {
    let scene = scene(json!({ "shapes": [
        { "type": "disk", "center": [0, 3, 0], "normal": [0, -1, 0], "radius": 0.4, "emission": 9 },
        { "type": "sphere", "center": [2, 2, 0], "radius": 0.2, "emission": 9 }] }));
    let old = Method::default();
    let prepared = prepare(&scene, &old);
    for (light_pick, light_sampling, direct) in [
        (LightPick::Power, LightSampling::Area, Direct::Mis),
        (LightPick::All, LightSampling::SolidAngle, Direct::Light),
        (LightPick::One, LightSampling::Stratified, Direct::Bsdf),
    ] {
        let method =
            Method { direct, light_pick: Some(light_pick), light_sampling: Some(light_sampling), ..old.clone() };
        let settings = settings(&scene, &method, 16);
        let again = prepared.with_method(&old, &method).unwrap();
        let work = Work::Uniform { first: 0, samples: 4 };
        let shared = crate::testing::render_rect(&again, &settings, Rect::frame(128, 128), work.clone());
        assert!(shared.film.moments == render(&scene, &method, work, 16).film.moments, "{method:?}");
    }
    let schlick = Method { fresnel: common::method::Fresnel::Schlick, ..old.clone() };
    assert!(prepared.with_method(&old, &schlick).is_none(), "materials depend on it");
}

/// The choice must not be made by the very samples of the picture, and the mean must not depend on it.
#[test]
fn the_picture_by_the_chosen_method_has_the_mean_of_the_others() {
    let scene = small_lamp();
    let plan = plan(&scene);
    let n = Work::Uniform { first: 0, samples: 64 };
    let chosen = render(&scene, &plan.method, n.clone(), 16);
    let other = render(&scene, &Method { direct: Direct::Mis, roulette: Roulette::Off, ..Method::default() }, n, 16);
    let ((a, ea), (b, eb)) = (chosen.mean_and_error(), other.mean_and_error());
    assert!((a - b).abs() < 4.0 * (ea * ea + eb * eb).sqrt(), "{a} ± {ea}, {b} ± {eb}");
}

fn plan_of(scene: &SceneFile, quality: Quality) -> MethodPlan {
    let region = Rect::frame(scene.film.width, scene.film.height);
    let trial = Trial { region, named: MethodChoices::default(), quality: Some(quality) };
    let method = Method::default();
    choose(&prepare(scene, &method), &settings(scene, &method, 16), &trial)
}

#[test]
fn a_trial_takes_a_small_part_of_the_picture() {
    let scene = small_lamp();
    let area = Rect::frame(128, 128).area() as f64;
    let spent = |plan: &MethodPlan| plan.considered.iter().map(|tried| tried.samples as f64 * tried.cost).sum::<f64>();
    let quick = plan_of(&scene, Quality::Samples { samples: 8 });
    assert!(quick.untried.as_ref().is_some_and(|why| why.contains("quick")), "{quick:?}");
    let mut before = 0.0;
    for samples in [256, 1024] {
        let plan = plan_of(&scene, Quality::Samples { samples });
        let picture = area * f64::from(samples) * plan.considered[0].cost;
        let share = spent(&plan) / picture;
        assert!(plan.considered.len() > 2 && share > 0.25 * PART && share < 1.25 * PART, "{share}: {plan:?}");
        assert!(spent(&plan) > 1.5 * before, "more is tried where more is at stake");
        before = spent(&plan);
    }
    let noise = |relative_error| {
        spent(&plan_of(&scene, Quality::Noise { relative_error, confidence: 0.95, max_samples: 4096 }))
    };
    assert!(noise(0.002) > 1.5 * noise(0.02));
    let time = |cpu_seconds| spent(&plan_of(&scene, Quality::Time { cpu_seconds, max_samples: 65536 }));
    assert!(time(20.0) > 1.5 * time(0.5));
}

#[test]
fn what_ways_bring_is_the_same_of_many_paths_and_of_one() {
    let scene = small_lamp();
    let method = Method { splits: 4, direct: Direct::Light, ..Method::default() };
    let prepared = prepare(&scene, &method);
    let alone = prepared.without(Without::all(&[Special::Waves])).unwrap();
    let sampler = Sampler::new(method.sampler, 1, 1, 16);
    let pixels = [[64, 80], [64, 100], [30, 90], [2, 2]];
    let of = |prepared: &Prepared| group(&Integrator::new(prepared.scene(), &method), &sampler, &pixels, 4);
    assert!(Integrator::new(prepared.scene(), &method).has_wave());
    let ((waves, _), (single, _)) = (of(&prepared), of(&alone));
    for (one, other) in waves.iter().zip(&single) {
        assert_eq!((one.mean, one.variance, one.among_ways), (other.mean, other.variance, other.among_ways));
    }
    assert!(waves[0].among_ways > 0.0 && waves[3].among_ways == 0.0, "floor and black sky");
}

#[test]
fn caustics_are_aimed_at_where_there_are_any() {
    // A mirror on the floor throws the lamp's image at a wall that the lamp itself does not light.
    let caustic = scene(json!({
        "materials": { "mirror": { "type": "mirror" }, "black": { "type": "diffuse", "reflectance": 0 } },
        "shapes": [
            { "type": "disk", "material": "mirror", "center": [-1.5, 0.05, 0], "normal": [0, 1, 0], "radius": 1 },
            { "type": "disk", "material": "black", "center": [-1.5, 2, 0], "normal": [0, -1, 0], "radius": 0.5, "emission": 40 },
            { "type": "quad", "vertices": [[-3, 2, -3], [3, 2, -3], [3, 5, -3], [-3, 5, -3]] }
        ]
    }));
    let found = plan(&caustic);
    assert_eq!(found.method.aim, Aim::Delta, "{found:?}");
    let named = plan_for(&caustic, &Method::default(), MethodChoices { aim: Some(Aim::Off), ..Default::default() });
    assert!(named.considered.iter().all(|tried| !tried.name.contains("aim")), "{named:?}");
    let without = plan(&small_lamp());
    assert!(without.considered.iter().all(|tried| !tried.name.contains("aim")), "{without:?}");
    let trial = |named| Trial { region: Rect::frame(128, 128), named, quality: None };
    let why = |facts: &Facts, named| {
        let all = ruled_out(facts, &trial(named));
        all.iter().find(|one| one.what.starts_with("aim")).map(|one| one.why.clone())
    };
    assert_eq!(why(&found.facts, MethodChoices::default()), None);
    assert!(why(&without.facts, MethodChoices::default()).unwrap().contains("mirror"));
    let named = MethodChoices { aim: Some(Aim::Off), ..MethodChoices::default() };
    assert!(why(&found.facts, named).unwrap().contains("named"));
}
