//! Rays that leave a surface neither meet it again nor skip what is close to it, at any scale and place.

use glam::{DMat3, DQuat};

use super::*;

/// A floor of two triangles turned some way, a sphere mesh and a real sphere, at a scale and a place.
struct Stage {
    accel: Accel,
    /// Largest coordinate.
    reach: f32,
}

const SCALES: [f64; 6] = [1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6];
const PLACES: [f64; 3] = [0.0, 1e3, 1e6];

fn stage(scale: f64, place: f64, instanced: bool) -> Stage {
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.3, 0.5, 0.8).normalize(), 0.7));
    let map = DAffine3 { matrix3: turn * scale, translation: DVec3::new(place, -0.4 * place, 0.7 * place) };
    let q = [[-3., 0., -3.], [3., 0., -3.], [3., 0., 3.], [-3., 0., 3.]].map(DVec3::from_array);
    let floor = (q.to_vec(), vec![[0, 2, 1], [0, 3, 2]]);
    let (positions, triangles) = icosphere(4);
    let ball = (positions.iter().map(|p| *p + DVec3::new(-1.2, 1.5, 0.0)).collect::<Vec<_>>(), triangles);
    let center = DVec3::new(1.2, 1.5, 0.0);
    let bake = if instanced { DAffine3::IDENTITY } else { map };
    let mesh = |(positions, triangles): (Vec<DVec3>, Vec<[u32; 3]>)| {
        let positions = positions.into_iter().map(|p| bake.transform_point3(p).as_vec3()).collect();
        Shape::Mesh(TriangleMesh { positions, triangles })
    };
    let radius = if instanced { 1.0 } else { scale as f32 };
    let shapes =
        vec![mesh(floor), mesh(ball), Shape::Sphere { center: bake.transform_point3(center).as_vec3(), radius }];
    let world = if instanced {
        let instances = vec![Instance { object: 0, to_world: map }];
        World { objects: vec![Object { shapes }], instances, ..World::default() }
    } else {
        World { shapes, ..World::default() }
    };
    let accel = Accel::build(world, TriangleTest::Watertight);
    let bounds = accel.bounds();
    let reach = bounds.lo.abs().max(bounds.hi.abs()).max_element();
    Stage { accel, reach }
}

/// Points on all surfaces, found from the middle of the stage, with the side that was seen.
fn points(stage: &Stage, random: &mut Random, n: usize) -> Vec<(Hit, SurfacePoint, Vec3)> {
    let (middle, radius) = stage.accel.bounds().bounding_sphere();
    let mut found = Vec::new();
    for _ in 0..20 * n {
        let origin = middle + random.cube() * radius;
        let ray = Ray::new(origin, random.direction().as_vec3());
        let Some(hit) = closest(&stage.accel, &ray) else { continue };
        let point = stage.accel.surface(&ray, &hit);
        let side = if point.ng.dot(ray.direction) > 0.0 { -point.ng } else { point.ng };
        found.push((hit, point, side));
        if found.len() == n {
            break;
        }
    }
    found
}

/// A ray into the half space over a flat surface, or out of a convex one, never meets that surface.
#[test]
fn no_surface_is_met_again() {
    for (scale, place) in SCALES.into_iter().flat_map(|s| PLACES.map(|p| (s, p))) {
        // Coordinates must tell the triangles of the ball apart.
        if place > 1e5 * scale {
            continue;
        }
        for instanced in [false, true] {
            let stage = stage(scale, place, instanced);
            let mut random = Random(31);
            let points = points(&stage, &mut random, 400);
            assert!(points.len() == 400, "{} at {scale} {place}", points.len());
            let (mut rays, mut again) = (0, 0);
            for (hit, point, side) in points {
                // The ball's facets form a convex surface only up to the rounding of its corners.
                let flat = hit.shape == 0;
                for _ in 0..20 {
                    let mut direction = random.direction();
                    if direction.dot(side.as_dvec3()) < 0.0 {
                        direction = -direction;
                    }
                    // Down to a thousandth of a radian from grazing.
                    let cosine = direction.dot(side.as_dvec3());
                    let outside = flat || (side.dot(point.ng) > 0.0 && cosine > 1e-3);
                    if !outside || cosine < 1e-4 {
                        continue;
                    }
                    rays += 1;
                    let ray = super::spawn(point.p, point.p_error, point.ng, direction.as_vec3());
                    let second = closest(&stage.accel, &ray);
                    again += usize::from(second.is_some_and(|s| s.shape == hit.shape));
                }
            }
            assert!(rays > 4000);
            assert_eq!(again, 0, "of {rays} rays, at scale {scale}, place {place}, instanced {instanced}");
        }
    }
}

/// From every point the middle of the other surfaces' facets is seen, wherever nothing else is between.
#[test]
fn shadow_rays_see_both_ends() {
    for (scale, place) in SCALES.into_iter().flat_map(|s| PLACES.map(|p| (s, p))) {
        if place > 1e5 * scale {
            continue;
        }
        for instanced in [false, true] {
            let stage = stage(scale, place, instanced);
            let mut random = Random(41);
            let points = points(&stage, &mut random, 600);
            let (mut tried, mut dark) = (0, 0);
            for pair in points.windows(2) {
                let [(ha, a, _), (hb, b, _)] = pair else { continue };
                if ha.shape == hb.shape {
                    continue;
                }
                let ray = spawn_to(a.p, a.p_error, a.ng, b.p, b.p_error, b.ng);
                // Open if the ray, left to run, first meets the second shape about where the target is.
                let open = Ray { t_max: f32::INFINITY, ..ray };
                let reach = closest(&stage.accel, &open);
                let seen = reach.is_some_and(|h| h.shape == hb.shape && h.t > 0.99);
                let slant = b.ng.dot(ray.direction).abs() / ray.direction.length();
                if seen && slant > 1e-2 {
                    tried += 1;
                    dark += usize::from(occluded(&stage.accel, &ray));
                }
            }
            assert!(tried > 40, "{tried}");
            assert_eq!(dark, 0, "of {tried}, at scale {scale}, place {place}, instanced {instanced}");
        }
    }
}

/// Two parallel floors: a ray that leaves the lower one meets the upper one, however close, as long as the
/// coordinates can tell them apart.
#[test]
fn no_surface_is_skipped() {
    let units = f64::from(f32::EPSILON);
    let mut random = Random(51);
    for place in [0.0, 1.0, 1e3, 1e6] {
        for scale in [1e-4, 1.0, 1e4] {
            let mut worst = 0.0f64;
            for gap in [1e-6, 1e-5, 1e-4, 1e-3, 1e-2] {
                let turn = DMat3::from_quat(DQuat::from_axis_angle(random.direction(), 2.0));
                let at = DVec3::new(place, place * 0.3, -place);
                let floor = |height: f64| {
                    let corner = |x: f64, z: f64| (turn * DVec3::new(x, height, z) * scale + at).as_vec3();
                    TriangleMesh {
                        positions: vec![corner(-1., -1.), corner(1., -1.), corner(1., 1.), corner(-1., 1.)],
                        triangles: vec![[0, 2, 1], [0, 3, 2]],
                    }
                };
                let world =
                    World { shapes: vec![Shape::Mesh(floor(0.0)), Shape::Mesh(floor(gap))], ..World::default() };
                let accel = Accel::build(world, TriangleTest::Watertight);
                let reach = (scale * 1.5).max(place);
                // Eight units of the largest coordinate, and the corners themselves are off by one.
                if gap * scale < 10.0 * units * reach {
                    worst = worst.max(gap * scale / reach / units);
                    continue;
                }
                let up = (turn * DVec3::Y).as_vec3();
                for slanted in (0..400).map(|i| i % 2 == 1) {
                    let (x, z) = (1.6 * random.unit() - 0.8, 1.6 * random.unit() - 0.8);
                    let below = (turn * DVec3::new(x, -0.5, z) * scale + at).as_vec3();
                    let ray = Ray::new(below, up);
                    let hit = closest(&accel, &ray).unwrap();
                    let point = accel.surface(&ray, &hit);
                    assert_eq!(hit.shape, 0);
                    // Up to 84 degrees from the normal.
                    let side = random.direction();
                    let cosine = side.dot(up.as_dvec3());
                    let out = if slanted && cosine.abs() > 0.1 { side * cosine.signum() } else { up.as_dvec3() };
                    let ray = super::spawn(point.p, point.p_error, point.ng, out.as_vec3());
                    let next = closest(&accel, &ray);
                    assert_eq!(next.map(|h| h.shape), Some(1), "gap {gap}, scale {scale}, place {place}, {out}");
                }
            }
        }
    }
}

/// What the textbook's constant does in the same scenes: it fails at one end or the other.
#[test]
fn a_constant_offset_fails_somewhere() {
    let mut random = Random(31);
    let (mut far, mut small) = (0, 0);
    let stage_far = stage(1e2, 1e6, false);
    for (hit, point, side) in points(&stage_far, &mut random, 400) {
        let ray = textbook::spawn(point.p, side, 1e-4);
        let convex = side.dot(point.ng) > 0.0;
        far += usize::from(convex && closest(&stage_far.accel, &ray).is_some_and(|h| h.shape == hit.shape));
    }
    let stage_small = stage(1e-4, 0.0, false);
    assert!(stage_small.reach < 1e-3);
    for (_, point, side) in points(&stage_small, &mut random, 400) {
        // The constant is as large as the whole scene: what was next to the point is skipped.
        let good = closest(&stage_small.accel, &super::spawn(point.p, point.p_error, point.ng, -side));
        let constant = closest(&stage_small.accel, &textbook::spawn(point.p, -side, 1e-4));
        small += usize::from(good.map(|h| h.primitive) != constant.map(|h| h.primitive));
    }
    println!("constant offset of 1e-4: {far} of 400 met again far away, {small} of 400 astray in a small scene");
    assert!(far > 0 && small > 0, "{far} {small}");
}
