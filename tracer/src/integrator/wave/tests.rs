//! Waves against one path at a time, bit for bit.

use std::collections::HashMap;

use common::{
    method::{Aim, Direct, LightPick, LightSampling, Method, Only, Reuse, Roulette, Sampler as Kind},
    scene::SceneFile,
};
use serde_json::json;

use super::*;
use crate::{
    geometry::spawn,
    integrator::{End, Probe, Together, Vertex},
    lanes::Flag,
    testing::prepare,
};

/// A box of walls with two blocks' worth of materials: what stages know, and what they do not.
fn scene(lights: serde_json::Value, extra: serde_json::Value) -> SceneFile {
    let mut shapes = vec![
        json!({ "type": "quad", "material": "wall", "vertices": [[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]] }),
        json!({ "type": "quad", "material": "red", "vertices": [[-3, 0, -3], [3, 0, -3], [3, 4, -3], [-3, 4, -3]] }),
        json!({ "type": "quad", "material": "one-sided", "vertices": [[-3, 0, 3], [-3, 0, -3], [-3, 4, -3], [-3, 4, 3]] }),
        json!({ "type": "sphere", "material": "wall", "center": [1, 0.7, 0], "radius": 0.7 }),
        json!({ "type": "disk", "material": "black", "center": [-1, 0.5, 1], "normal": [0.3, 1, 0.2], "radius": 0.6 }),
    ];
    shapes.extend(lights["shapes"].as_array().cloned().unwrap_or_default());
    shapes.extend(extra.as_array().cloned().unwrap_or_default());
    let mut scene = json!({
        "tessera": 1,
        "camera": { "position": [0, 1.5, 7], "target": [0, 1.2, 0], "fov": 50, "lens_radius": 0.05 },
        "film": { "width": 24, "height": 16 },
        "materials": {
            "wall": { "type": "diffuse", "reflectance": [0.7, 0.6, 0.5] },
            "red": { "type": "diffuse", "reflectance": [0.6, 0.1, 0.1] },
            "one-sided": { "type": "diffuse", "reflectance": 0.8, "two_sided": false },
            "black": { "type": "diffuse", "reflectance": 0 },
            "mirror": { "type": "mirror" },
            "glass": { "type": "dielectric" },
            "frosted": { "type": "dielectric", "roughness": 0.3 },
            "metal": { "type": "conductor", "metal": "Au", "roughness": 0.2 },
            "plate": { "type": "conductor", "reflectance": [0.9, 0, 0.5], "roughness": 0.02, "two_sided": false },
            "satin": { "type": "conductor", "metal": "Cu", "roughness": 0.4, "reflectance": [1, 0.9, 0.5] },
            "soot": { "type": "conductor", "reflectance": 0, "roughness": 0.5 },
            "coat": { "type": "plastic", "reflectance": 0.5, "roughness": 0.1 }
        },
        "shapes": shapes
    });
    for key in ["lights", "environment"] {
        if !lights[key].is_null() {
            scene[key] = lights[key].clone();
        }
    }
    SceneFile::parse(scene.to_string().as_bytes()).unwrap()
}

fn balls() -> serde_json::Value {
    let ball = |material: &str, x: f64| json!({ "type": "sphere", "material": material, "center": [x, 1.6, 0.5], "radius": 0.35 });
    json!([ball("mirror", -2.0), ball("glass", -1.0), ball("frosted", 0.0), ball("metal", 1.0), ball("coat", 2.0)])
}

/// Rough metals: seen from both sides, lit flatly, black.
fn metals() -> serde_json::Value {
    let ball = |material: &str, x: f64| json!({ "type": "sphere", "material": material, "center": [x, 1.6, 0.5], "radius": 0.35 });
    let quad = |material: &str, x: f64, turned: bool| {
        let mut vertices = [[x, 0.1, 1.5], [x + 1.0, 0.1, 1.5], [x + 1.0, 0.9, 0.7], [x, 0.9, 0.7]];
        if turned {
            vertices.reverse();
        }
        json!({ "type": "quad", "material": material, "vertices": vertices })
    };
    json!([
        ball("metal", -1.5),
        ball("satin", -0.5),
        ball("soot", 0.5),
        ball("plate", 1.5),
        quad("plate", -2.0, false),
        quad("plate", -0.8, true),
        quad("satin", 0.4, true)
    ])
}

fn lamp() -> serde_json::Value {
    json!({ "type": "quad", "vertices": [[-1, 3.9, -1], [1, 3.9, -1], [1, 3.9, 1], [-1, 3.9, 1]], "emission": [9, 7, 5] })
}

/// What a probe sees of the first hit.
#[derive(Default)]
struct First(Option<FirstHit>);

impl Probe for First {
    fn vertex(&mut self, vertex: &Vertex) {
        let Vertex { albedo, ns, camera_depth, .. } = *vertex;
        self.0.get_or_insert(FirstHit { albedo, ns, camera_depth });
    }

    fn end(&mut self, _: End, _: Rgb) {}
}

/// Render groups of pixels that share their paths both ways; how many samples carried light.
fn compare_groups(name: &str, scene: &SceneFile, method: &Method, batch: u32, compiled: Compiled) -> usize {
    let Some(mut wave) = Wave::compiled_for(compiled) else { return usize::MAX };
    let prepared = prepare(scene, method);
    let integrator = Integrator::new(prepared.scene(), method);
    assert!(integrator.has_wave() && integrator.shares(), "{name}");
    let sampler = Sampler::new(method.sampler, 7, 1, batch).in_sets(4);
    // Groups of 16, and smaller ones as at a picture's border.
    let group = |n: u32, s: u32| -> Vec<[u32; 3]> {
        let size = [16, 16, 3, 1, 7][n as usize % 5];
        (0..size).map(|i| [n % 6 * 4 + i % 4, n / 6 % 4 * 4 + i / 4, s]).collect()
    };
    let groups: Vec<Vec<[u32; 3]>> = (0..24).flat_map(|n| (0..5).map(move |s| group(n, s * 9))).collect();
    let (mut bright, mut counters, mut expected_counters) = (0, Counters::default(), Counters::default());
    let mut room = Together::default();
    for some in groups.chunks(40).chain(groups.chunks(1).take(10)) {
        let requests = some.concat();
        let ends: Vec<u32> = some
            .iter()
            .scan(0, |end, group| {
                *end += group.len() as u32;
                Some(*end)
            })
            .collect();
        integrator.wave(&mut wave, &sampler, &requests, &ends, true, &mut counters);
        let mut slot = 0;
        for group in some {
            integrator.together(&mut room, &sampler, group, None, &mut expected_counters);
            for (i, member) in group.iter().enumerate() {
                assert_eq!(wave.traced(slot), room.traced(i), "{name}: {member:?}");
                bright += usize::from(wave.traced(slot).sample.radiance != Rgb::ZERO);
                slot += 1;
            }
        }
    }
    assert_eq!(counters.rays, expected_counters.rays, "{name}");
    bright
}

#[test]
fn paths_that_are_shared_have_the_bits_of_one_after_the_other() {
    let ball = json!({ "type": "sphere", "center": [0, 3, 0], "radius": 0.3, "emission": 20 });
    let sky = json!({ "shapes": [lamp(), ball], "environment": { "type": "constant", "radiance": [0.1, 0.2, 0.4] } });
    // Enough to be put into a tree.
    let crowd = |i: u32| json!({ "type": "sphere", "material": "wall", "center": [0.2 * f64::from(i % 9) - 1.0, 0.1, 0.3 * f64::from(i / 9)], "radius": 0.1 });
    let crowd: Vec<_> = (0..80).map(crowd).collect();
    let scenes = [
        ("a lamp", scene(json!({ "shapes": [lamp()] }), json!([]))),
        ("all materials", scene(json!({ "shapes": [lamp()] }), balls())),
        ("several lights", scene(sky, balls())),
        ("a tree", scene(json!({ "shapes": [lamp()] }), json!(crowd))),
    ];
    let plain = Method { reuse: Reuse::Paths, roulette: Roulette::Late, ..Method::default() };
    let methods = [
        plain.clone(),
        Method { splits: 4, ..plain.clone() },
        Method { direct: Direct::Bsdf, roulette: Roulette::Fixed, ..plain.clone() },
        Method { direct: Direct::Light, only: Some(Only::Indirect), ..plain.clone() },
        Method { sampler: Kind::Independent, max_depth: 2, ..plain.clone() },
    ];
    for (name, scene) in &scenes {
        for method in &methods {
            for batch in [16, 5] {
                let bright = compare_groups(&format!("{name} {method:?}"), scene, method, batch, Compiled::detect());
                assert!(bright > 100, "{name} {method:?}: {bright}");
            }
        }
    }
    for compiled in Compiled::ALL {
        assert!(compare_groups(&format!("{compiled:?}"), &scenes[1].1, &plain, 16, compiled) > 100);
    }
}

/// Render every pixel both ways; how many samples carried light.
fn compare(name: &str, scene: &SceneFile, method: &Method, batch: u32, compiled: Compiled) -> usize {
    let Some(mut wave) = Wave::compiled_for(compiled) else { return usize::MAX };
    let prepared = prepare(scene, method);
    let integrator = Integrator::new(prepared.scene(), method);
    assert!(integrator.has_wave(), "{name}");
    let sampler = Sampler::new(method.sampler, 7, 1, batch).in_sets(4);
    let requests: Vec<[u32; 3]> =
        (0..16).flat_map(|y| (0..24).flat_map(move |x| (0..9).map(move |s| [x, y, s * 5]))).collect();
    let (mut bright, mut counters, mut expected_counters) = (0, Counters::default(), Counters::default());
    // Waves that are full, and some that are not, also after one that was.
    let turns = requests.chunks(WIDTH + 5).take(40).flat_map(|both| both.chunks(WIDTH));
    for chunk in requests.chunks(1000).chain(requests.chunks(11).take(20)).chain(turns) {
        integrator.wave(&mut wave, &sampler, chunk, &[], true, &mut counters);
        for (i, &[x, y, sample]) in chunk.iter().enumerate() {
            let mut first = First::default();
            let stream = sampler.stream(x, y, sample);
            let expected = integrator.probed(x, y, &stream, &mut expected_counters, &mut first);
            let found = wave.traced(i);
            assert_eq!(found.sample, expected, "{name}: pixel {x},{y} sample {sample}");
            assert_eq!(found.first, first.0, "{name}: pixel {x},{y} sample {sample}");
            bright += usize::from(expected.radiance != Rgb::ZERO);
        }
    }
    let (of_light, expected_of_light) = (counters.light_samples, expected_counters.light_samples);
    assert_eq!((counters.rays, of_light), (expected_counters.rays, expected_of_light), "{name}");
    bright
}

#[test]
fn every_sample_has_the_bits_of_one_path_alone() {
    let lamps = HashMap::from([
        ("a rectangle", json!({ "shapes": [lamp()] })),
        (
            "a triangle",
            json!({ "shapes": [{ "type": "mesh", "positions": [[-1, 3.9, -1], [1, 3.9, -1], [0, 3.9, 1]],
                "triangles": [[0, 1, 2]], "emission": 8 }] }),
        ),
        (
            "triangles of several kinds",
            json!({ "shapes": [
                { "type": "mesh", "positions": [[-1, 3.9, -1], [1, 3.9, -1], [0, 3.9, 1], [0, 3, 0], [0, 3, 0]],
                    "triangles": [[0, 1, 2], [2, 1, 0], [0, 1, 3], [3, 4, 0]], "emission": 8 },
                { "type": "mesh", "positions": [[2, 0.1, 2], [2, 1, 2], [2.3, 0.1, 1]], "triangles": [[0, 1, 2]],
                    "emission": { "radiance": [1, 5, 2], "two_sided": true } },
                lamp()
            ] }),
        ),
        ("a sphere", json!({ "shapes": [{ "type": "sphere", "center": [0, 3, 0], "radius": 0.3, "emission": 20 }] })),
        (
            "spheres from without and within",
            json!({ "shapes": [
                { "type": "sphere", "center": [0, 3, 0], "radius": 0.3, "emission": 20 },
                { "type": "sphere", "center": [-2, 0.5, 1], "radius": 0.6, "emission": [0, 3, 1] },
                { "type": "sphere", "center": [0, 1, 0], "radius": 20, "emission": { "radiance": 0.2, "two_sided": true } },
                { "type": "sphere", "center": [0, 1, 0], "radius": 25, "emission": 1 },
                { "type": "quad", "vertices": [[-1, 3.9, -1], [0, 3.9, -1], [0, 3.9, 0], [-1, 3.9, 0]], "emission": 5 }
            ] }),
        ),
        (
            "a few spheres",
            json!({ "shapes": [
                { "type": "sphere", "center": [0, 3, 0], "radius": 0.3, "emission": 20 },
                { "type": "sphere", "center": [-2, 0.5, 1], "radius": 0.6, "emission": [0, 3, 1] },
                { "type": "sphere", "center": [0, 1, 0], "radius": 20, "emission": { "radiance": 0.2, "two_sided": true } }
            ] }),
        ),
        ("a point", json!({ "lights": [{ "type": "point", "position": [0, 3, 1], "intensity": 9 }] })),
        ("a sky", json!({ "environment": { "type": "constant", "radiance": [0.5, 0.7, 1] } })),
        (
            "several",
            json!({ "shapes": [lamp()], "lights": [{ "type": "point", "position": [0, 3, 1], "intensity": 9 }],
                "environment": { "type": "constant", "radiance": 0.2 } }),
        ),
        ("none", json!({})),
    ]);
    let mut methods = vec![("default".to_owned(), Method::default())];
    let mut add = |name: &str, change: &dyn Fn(&mut Method)| {
        let mut method = Method::default();
        change(&mut method);
        methods.push((name.to_owned(), method));
    };
    add("no bounces", &|m| m.max_depth = 0);
    add("one bounce", &|m| m.max_depth = 1);
    add("light", &|m| (m.direct, m.max_depth) = (Direct::Light, 3));
    add("bsdf", &|m| (m.direct, m.max_depth) = (Direct::Bsdf, 3));
    add("four ways", &|m| m.splits = 4);
    add("two ways after one bounce", &|m| (m.splits, m.max_depth, m.direct) = (2, 2, Direct::Light));
    add("eight ways, bsdf", &|m| (m.splits, m.direct) = (8, Direct::Bsdf));
    add("four ways, stratified", &|m| (m.splits, m.sampler) = (4, Kind::Stratified));
    add("aimed", &|m| m.aim = Aim::Delta);
    add("aimed, four ways", &|m| (m.aim, m.splits, m.roulette) = (Aim::Delta, 4, Roulette::Late));
    add("aimed, light alone", &|m| (m.aim, m.direct, m.max_depth) = (Aim::Delta, Direct::Light, 3));
    add("aimed, bsdf", &|m| (m.aim, m.direct, m.splits) = (Aim::Delta, Direct::Bsdf, 2));
    add("late roulette", &|m| m.roulette = Roulette::Late);
    add("direct", &|m| m.only = Some(Only::Direct));
    add("indirect", &|m| m.only = Some(Only::Indirect));
    add("area", &|m| (m.light_sampling, m.light_pick) = (Some(LightSampling::Area), Some(LightPick::Power)));
    add("area of one triangle or another", &|m| {
        (m.light_sampling, m.light_pick) = (Some(LightSampling::Area), Some(LightPick::Tree));
        m.light_samples = 2;
    });
    add("all lights", &|m| (m.light_pick, m.max_depth) = (Some(LightPick::All), 3));
    add("three samples", &|m| m.light_samples = 3);
    add("strata of all lights", &|m| {
        (m.light_pick, m.light_sampling) = (Some(LightPick::All), Some(LightSampling::Stratified));
        (m.light_samples, m.max_depth) = (2, 2);
    });
    add("independent", &|m| m.sampler = Kind::Independent);
    add("stratified", &|m| m.sampler = Kind::Stratified);
    for (lamp, lights) in &lamps {
        for (method_name, method) in &methods {
            for extra in [json!([]), balls(), metals()] {
                let scene = scene(lights.clone(), extra);
                let bright = compare(&format!("{lamp}, {method_name}"), &scene, method, 16, Compiled::detect());
                // Without a bounce only lamps that the camera sees are bright.
                let unseen = lamp == &"a point" && method.direct == Direct::Bsdf;
                let dark = lamp == &"none" || method.max_depth == 0 || unseen;
                assert!(bright > 0 || dark, "{lamp}, {method_name}");
            }
        }
    }
}

#[test]
fn instructions_do_not_show() {
    let scene = scene(json!({ "shapes": [lamp()] }), balls());
    for compiled in Compiled::ALL {
        for (batch, splits) in [(16, 1), (5, 1), (16, 4), (8, 2), (5, 4)] {
            let method = Method { splits, ..Method::default() };
            assert!(compare(&format!("{compiled:?}"), &scene, &method, batch, compiled) > 1000);
        }
    }
}

#[test]
#[allow(clippy::needless_range_loop, reason = "a lane of several arrays")]
fn a_world_of_few_primitives_is_traced_as_by_its_tree() {
    use crate::geometry::{Accel, FewRays, Found, Rays, Shape, TriangleMesh, TriangleTest, World};
    use crate::lanes::{Lane3, Proven, YES};
    use crate::math::{cosine_hemisphere, uniform_sphere};

    // A soup of triangles of all sizes, some seen edge-on, some sharing corners, over a plane of two big ones;
    // a sphere and a disk.
    let sampler = Sampler::new(Kind::Independent, 3, 1, 16);
    let two = |i: u32, d: u32| sampler.stream(i, 0, 0).two(d);
    let at = |i: u32| {
        let (a, b) = (two(i, 0), two(i, 1));
        Vec3::new(a.x - 0.5, a.y - 0.5, b.x - 0.5) * if i.is_multiple_of(5) { 4.0 } else { 1.0 }
    };
    let mut positions: Vec<Vec3> = (0..60).map(at).collect();
    positions.extend([[-9.0, -1.0, -9.0], [9.0, -1.0, -9.0], [9.0, -1.0, 9.0], [-9.0, -1.0, 9.0]].map(Vec3::from));
    let mut triangles: Vec<[u32; 3]> = (0..38).map(|i| [i, i + 1, i + 2 + i % 20]).collect();
    triangles.extend([[60, 61, 62], [60, 62, 63]]);
    let world = World {
        shapes: vec![
            Shape::Mesh(TriangleMesh { positions: positions.clone(), triangles }),
            Shape::Sphere { center: Vec3::new(0.2, 0.1, 0.3), radius: 0.2 },
            Shape::Disk { center: Vec3::new(-0.4, 0.2, 0.0), normal: Vec3::X, radius: 0.5 },
        ],
        ..World::default()
    };
    let accel = Accel::build(world, TriangleTest::Watertight);
    assert!(accel.is_small());
    for compiled in Compiled::ALL {
        let Some(proven) = Proven::new(compiled) else { continue };
        let mut work = FewRays::new(proven);
        let (mut hits, mut shadows, mut misses) = (0, 0, 0);
        for round in 0..400u32 {
            let mut rays = (Lane3::ZERO, Lane3::ZERO, [f32::INFINITY; WIDTH], [YES; WIDTH]);
            for i in 0..WIDTH {
                let n = 1000 + round * WIDTH as u32 + i as u32;
                let origin = match i % 4 {
                    // From outside, from a corner, from the plane, from far away.
                    0 => at(n) * 3.0,
                    1 => positions[n as usize % 60],
                    2 => Vec3::new(two(n, 2).x * 4.0, -1.0, two(n, 2).y * 4.0),
                    _ => at(n) * 1e4,
                };
                let direction = match i % 5 {
                    0 => positions[(n / 7) as usize % 64] - origin,
                    1 => [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::new(1.0, -1.0, 0.0)][n as usize % 4],
                    2 => cosine_hemisphere(two(n, 3)),
                    3 => Vec3::ZERO,
                    _ => uniform_sphere(two(n, 3)) * 1e-3,
                };
                rays.0.set(i, origin);
                rays.1.set(i, direction);
                rays.2[i] = if i % 7 == 0 { 1.0 } else { f32::INFINITY };
                rays.3[i] = Flag::from(i % 11 != 3);
            }
            let n = if round % 2 == 0 { WIDTH } else { 37 };
            let rays = Rays {
                n,
                active: &rays.3,
                origin: &rays.0,
                direction: &rays.1,
                t_max: &rays.2,
                spared: &[[0; WIDTH]; 2],
                ended: NO_ROUND,
            };
            let (mut found, mut occluded) = (Found::NOTHING, [NO; WIDTH]);
            let mut counters = Counters::default();
            assert!(accel.closest_of(&mut work, &rays, &mut found, &mut counters));
            assert!(accel.occluded_of(&mut work, &rays, &mut occluded, &mut counters));
            for i in 0..n {
                if rays.active[i] == NO {
                    assert_eq!((accel.found(&found, i), occluded[i]), (None, NO), "nobody asked");
                    continue;
                }
                let expected = accel.closest(&rays.at(i), &mut counters);
                assert_eq!(accel.found(&found, i), expected, "{compiled:?} {:?}", rays.at(i));
                assert_eq!(occluded[i] == YES, accel.occluded(&rays.at(i), &mut counters), "{:?}", rays.at(i));
                hits += usize::from(expected.is_some());
                misses += usize::from(expected.is_none());
                shadows += usize::from(occluded[i] == YES);
            }
        }
        assert!(hits > 5_000 && misses > 3_000 && shadows == hits, "{hits} {misses} {shadows}");
    }
}

/// What rays that leave a triangle are not held against is refused by the test that all other rays go through: quadrilaterals
/// and triangles of all directions, at several scales, some far from the origin.
#[test]
#[allow(clippy::needless_range_loop, reason = "a lane of several arrays")]
fn planes_that_are_spared_would_not_have_been_hit() {
    use crate::geometry::{Accel, FewRays, Found, Rays, Shape, TriangleMesh, TriangleTest, World, surface};
    use crate::lanes::{Lane3, Proven};
    use crate::math::uniform_sphere;

    let sampler = Sampler::new(Kind::Independent, 5, 1, 16);
    let (mut spared_rays, mut hits) = (0u32, 0u32);
    for (round, scale) in [1.0f32, 1.0, 1.0, 300.0, 1e-3, 5.5].into_iter().enumerate() {
        let two = |i: u32, d: u32| sampler.stream(i, round as u32, 0).two(d);
        let three = |i: u32, d: u32| Vec3::new(two(i, d).x - 0.5, two(i, d).y - 0.5, two(i, d + 1).x - 0.5);
        let away = if round == 2 { Vec3::new(3.0, -1.0, 2.0) } else { Vec3::ZERO };
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for k in 0..14 {
            let (o, a, b) = (three(k, 0), three(k, 2), three(k, 4));
            // Half of them exact rectangles along the axes.
            let (a, b) = if k % 2 == 0 { (Vec3::X * a.x, Vec3::Z * b.z) } else { (a, b) };
            let n = positions.len() as u32;
            positions.extend([o, o + a, o + a + b, o + b].map(|p| (p + away) * scale));
            triangles.push([n, n + 1, n + 2]);
            if k % 3 != 0 {
                triangles.push([n, n + 2, n + 3]);
            }
        }
        let mesh = TriangleMesh { positions: positions.clone(), triangles: triangles.clone() };
        let accel =
            Accel::build(World { shapes: vec![Shape::Mesh(mesh)], ..World::default() }, TriangleTest::Watertight);
        assert!(accel.is_small());
        let mut work = FewRays::new(Proven::new(Compiled::detect()).unwrap());
        for turn in 0..1500u32 {
            let mut rays = (Lane3::ZERO, Lane3::ZERO, [f32::INFINITY; WIDTH]);
            let mut spared = [[0; WIDTH]; 2];
            for i in 0..WIDTH {
                let n = 100 + turn * WIDTH as u32 + i as u32;
                let id = n as usize % triangles.len();
                let corners = triangles[id].map(|v| positions[v as usize]);
                // Barycentrics that spare the plane, near the limit as often as not.
                let u = two(n, 0);
                let (x, y) = if u.x + u.y < 1.0 { (u.x, u.y) } else { (1.0 - u.x, 1.0 - u.y) };
                let shrink = if n.is_multiple_of(2) { 0.952 } else { 0.6 };
                let (b1, b2) = (1.0 / 3.0 + (x - 1.0 / 3.0) * shrink, 1.0 / 3.0 + (y - 1.0 / 3.0) * shrink);
                let point = surface::triangle_point(corners, b1, b2);
                let mut direction = uniform_sphere(two(n, 1));
                if n.is_multiple_of(3) {
                    // As flat as is allowed.
                    let along = (direction - point.ng * direction.dot(point.ng)).normalize();
                    direction = (along + point.ng * if n.is_multiple_of(2) { 0.064 } else { -0.064 }).normalize();
                }
                let ray = spawn(point.p, point.p_error, point.ng, direction);
                rays.0.set(i, ray.origin);
                rays.1.set(i, ray.direction);
                rays.2[i] = if n.is_multiple_of(5) { scale * 0.3 } else { f32::INFINITY };
                let cosine = direction.dot(point.ng);
                if cosine * cosine > 1.0 / 256.0 {
                    [spared[0][i], spared[1][i]] = accel.spared(id);
                    spared_rays += u32::from(accel.spared(id) != [0; 2]);
                }
            }
            let active = [YES; WIDTH];
            let rays = Rays {
                n: WIDTH,
                active: &active,
                origin: &rays.0,
                direction: &rays.1,
                t_max: &rays.2,
                spared: &spared,
                ended: NO_ROUND,
            };
            let (mut found, mut occluded) = (Found::NOTHING, [NO; WIDTH]);
            let mut counters = Counters::default();
            assert!(accel.closest_of(&mut work, &rays, &mut found, &mut counters));
            assert!(accel.occluded_of(&mut work, &rays, &mut occluded, &mut counters));
            for i in 0..WIDTH {
                let expected = accel.closest(&rays.at(i), &mut counters);
                assert_eq!(accel.found(&found, i), expected, "round {round}: {:?}", rays.at(i));
                assert_eq!(occluded[i] == YES, expected.is_some(), "round {round}: {:?}", rays.at(i));
                hits += u32::from(expected.is_some());
            }
        }
    }
    assert!(spared_rays > 400_000 && hits > 80_000, "{spared_rays} {hits}");
}

/// Shadow rays that are not held against the sphere which they end before are refused by the test that others go through:
/// spheres seen from near and far, small and large, some far from the origin, at their middle and at their edge.
#[test]
fn spheres_that_rays_end_before_would_not_have_been_hit() {
    use crate::geometry::{Accel, FewRays, Rays, Shape, TriangleTest, World};
    use crate::lanes::Proven;
    use crate::light::Ball;
    use crate::math::uniform_sphere;

    let sampler = Sampler::new(Kind::Independent, 9, 1, 16);
    let mut wave = Wave::new();
    let mut work = FewRays::new(Proven::new(Compiled::detect()).unwrap());
    let (mut ended, mut lit) = (0u32, 0u32);
    for round in 0..3000u32 {
        let number = |d: u32| sampler.stream(0, round, 0).one(d);
        let scale = [1.0f32, 1e-3, 300.0, 5.5][round as usize % 4];
        let away = if round % 3 == 0 { scale * 40.0 } else { scale };
        let radius = scale * [1.0, 0.1, 1e-3][(round / 4) as usize % 3];
        let center = uniform_sphere(sampler.stream(1, round, 0).two(0)) * (away * number(0));
        let accel = Accel::build(
            World { shapes: vec![Shape::Sphere { center, radius }], ..World::default() },
            TriangleTest::Watertight,
        );
        let ball = Ball { emitter: 0, center, radius, two_sided: round % 2 == 0, radiance: Rgb::ONE, chosen: 1.0 };
        wave.begin(WIDTH, 1, false, false);
        for i in 0..WIDTH {
            let stream = sampler.stream(2 + i as u32, round, 0);
            let height = [1e-3, 0.1, 1.0, 100.0][i % 4] * (0.5 + stream.one(0));
            let direction = uniform_sphere(stream.two(1));
            wave.p.set(i, center + direction * (radius * (1.0 + height)));
            wave.p_error.set(i, wave.p.at(i).abs() * (4.0 * f32::EPSILON));
            wave.ng.set(i, uniform_sphere(stream.two(2)));
            let u = stream.two(3);
            (wave.u[0][i], wave.u[1][i]) = (if i % 3 == 0 { 1.0 - u.x * 0.01 } else { u.x }, u.y);
            (wave.gathers[i], wave.scatters[i]) = (YES, Scatters::Diffuse);
        }
        stages::same_ball_light(wave.proven, &mut wave, &ball, accel.round(0));
        stages::shadow_rays(wave.proven, &mut wave, [0; 2], 0.0);
        let rays = Rays {
            n: WIDTH,
            active: &wave.lit,
            origin: &wave.shadow_origin,
            direction: &wave.shadow_direction,
            t_max: &wave.shadow_t_max,
            spared: &wave.shadow_spared,
            ended: &wave.shadow_ended,
        };
        let (mut occluded, mut counters) = ([NO; WIDTH], Counters::default());
        assert!(accel.occluded_of(&mut work, &rays, &mut occluded, &mut counters));
        for i in lanes_of(crate::lanes::mask_of(&wave.lit)) {
            let expected = accel.occluded(&rays.at(i), &mut counters);
            assert_eq!(occluded[i] == YES, expected, "round {round}: {:?}", rays.at(i));
            ended += u32::from(wave.shadow_ended[i] != 0);
            lit += 1;
        }
    }
    assert!(ended > 50_000 && lit > ended + 50_000, "{ended} of {lit}");
}
