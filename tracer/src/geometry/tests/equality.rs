//! One answer: from every instruction set and either width of nodes, from the tree and from trying everything.

use proptest::prelude::*;

use super::*;

/// Compare all paths on some rays. Returns how many hit.
fn agree(world: &World, rays: &[Ray]) -> Result<usize, TestCaseError> {
    let build = |width| {
        let with =
            |instructions| Accel::build_with(world.clone(), Options { width, instructions, ..Options::default() });
        all_instructions().into_iter().map(with).collect::<Vec<_>>()
    };
    let widths = [Width::Eight, Width::Four].map(|width| (width, build(width)));
    let mut hits = 0;
    for ray in rays {
        let expected = widths[0].1[0].closest_by_brute_force(ray, &mut Counters::default());
        hits += usize::from(expected.is_some());
        for (width, accels) in &widths {
            let mut work = None;
            for accel in accels {
                let mut counters = Counters::default();
                let found = accel.closest(ray, &mut counters);
                let name = (width, accel.instructions());
                prop_assert_eq!(bits(found), bits(expected), "{:?}: {:?} not {:?}, {:?}", name, found, expected, ray);
                let any = accel.occluded(ray, &mut counters);
                prop_assert_eq!(any, expected.is_some(), "any hit, {:?}: {:?}", name, ray);
                prop_assert_eq!(*work.get_or_insert(counters), counters, "the same work, {:?}", name);
            }
        }
    }
    Ok(hits)
}

/// Rays at corners, edges and insides of triangles, from near and far, and some at nothing.
fn rays_at(world: &World, random: &mut Random, n: usize) -> Vec<Ray> {
    let meshes: Vec<&TriangleMesh> = world
        .shapes
        .iter()
        .filter_map(|s| match s {
            Shape::Mesh(m) if !m.triangles.is_empty() => Some(m),
            _ => None,
        })
        .collect();
    let mut rays = Vec::new();
    for _ in 0..n {
        let mesh = meshes[random.bits() as usize % meshes.len()];
        let Some(c) = mesh.corners(random.bits() as usize % mesh.triangles.len()) else { continue };
        let (u, v) = (random.unit() as f32, random.unit() as f32);
        let target = match random.bits() % 4 {
            0 => c[0],
            1 => c[0].lerp(c[1], u),
            2 => c[0].lerp(c[1], u).lerp(c[2], v),
            _ => c[0] + random.cube() * (c[1] - c[0]).length(),
        };
        let size = (c[1] - c[0]).length().max((c[2] - c[0]).length()).max(1e-30);
        let away = random.direction().as_vec3() * size * 10f32.powf(4.0 * random.signed());
        let origin = if random.bits().is_multiple_of(8) { c[1].lerp(c[2], u) } else { target + away };
        let mut direction = target - origin;
        if random.bits().is_multiple_of(8) {
            direction = Vec3::AXES[random.bits() as usize % 3] * [1.0, -1.0][random.bits() as usize % 2];
        }
        let t_max = if random.bits().is_multiple_of(4) { 1.0 } else { f32::INFINITY };
        rays.push(Ray { origin, direction, t_max });
    }
    rays
}

/// Meshes of the kinds that break trees and tests.
fn hostile_mesh(kind: u64, random: &mut Random, n: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let mut push = |c: [Vec3; 3]| {
        let k = mesh.positions.len() as u32;
        mesh.positions.extend(c);
        mesh.triangles.push([k, k + 1, k + 2]);
    };
    for k in 0..n {
        let at = random.cube();
        let (a, b) = (random.cube() * 0.3, random.cube() * 0.3);
        match kind {
            // Any triangles.
            0 => push([at, at + a, at + b]),
            // Slivers.
            1 => push([at, at + a, at + a * 0.5 + b * 1e-6]),
            // The same one again and again, from either side.
            2 => push([Vec3::ZERO, Vec3::X, if k.is_multiple_of(2) { Vec3::Y } else { -Vec3::Y }]),
            // Stacks in one plane.
            3 => {
                let p = |v: Vec3| Vec3::new(v.x, 0.25, v.z);
                push([p(at), p(at + a), p(at + b)]);
            }
            // Sizes from huge to tiny about one point.
            4 => {
                let s = 10f32.powf(18.0 * random.signed());
                push([at * s, (at + a) * s, (at + b) * s]);
            }
            // Far from the origin: coordinates on a coarse grid, many shared.
            5 => {
                let o = Vec3::new(148_376.0, 1_234.0, -223_423.0);
                push([o + at, o + at + a, o + at + b]);
            }
            // A grid with shared corners on round numbers: edges and planes meet rays exactly.
            6 => {
                let q = |v: Vec3| (v * 3.0).round();
                push([q(at * 2.0), q(at * 2.0 + a * 3.0), q(at * 2.0 + b * 3.0)]);
            }
            // Bad ones among good ones.
            _ => {
                let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0][k % 4];
                push([at, at + a, if k.is_multiple_of(3) { Vec3::splat(bad) } else { at + b }]);
            }
        }
    }
    mesh
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn tree_and_brute_force_agree_on_hostile_meshes(seed in any::<u64>(), kind in 0u64..8, n in 1usize..150) {
        let mut random = Random(seed);
        let mut world = world_of(hostile_mesh(kind, &mut random, n));
        // A second shape, so that ties between shapes are seen.
        if seed.is_multiple_of(3) {
            let shape = world.shapes[0].clone();
            world.shapes.push(shape);
        }
        let rays = rays_at(&world, &mut random, 60);
        agree(&world, &rays)?;
    }

    #[test]
    fn tree_and_brute_force_agree_with_all_kinds_of_shapes(seed in any::<u64>(), n in 1usize..60) {
        let mut random = Random(seed);
        let mut world = world_of(hostile_mesh(seed % 2, &mut random, n));
        for _ in 0..random.bits() % 12 {
            let (center, radius) = (random.cube(), random.unit() as f32 * 0.3);
            world.shapes.push(Shape::Sphere { center, radius });
            world.shapes.push(Shape::Disk { center: random.cube(), normal: random.cube(), radius });
        }
        let rays = rays_at(&world, &mut random, 60);
        agree(&world, &rays)?;
    }
}

#[test]
fn every_kind_of_hostile_mesh_is_hit() {
    for kind in 0..8 {
        let mut random = Random(kind);
        let world = world_of(hostile_mesh(kind, &mut random, 1000));
        let rays = rays_at(&world, &mut random, 400);
        let hits = agree(&world, &rays).unwrap();
        assert!(hits > 50, "kind {kind}: {hits} of {}", rays.len());
    }
}

#[test]
fn equal_parameters_go_to_the_lowest_number() {
    // The same two triangles in three shapes; the first shape's come second in its list.
    let front = [Vec3::new(-1.0, -1.0, 1.0), Vec3::new(1.0, -1.0, 1.0), Vec3::new(0.0, 1.0, 1.0)];
    let behind = front.map(|p| p + Vec3::Z);
    let mesh = |order: [[u32; 3]; 4]| {
        Shape::Mesh(TriangleMesh { positions: [front, behind].concat(), triangles: order.to_vec() })
    };
    let (f, b) = ([0, 1, 2], [3, 4, 5]);
    let world = World { shapes: vec![mesh([b, f, f, b]), mesh([f, f, b, b])], ..World::default() };
    for instructions in all_instructions() {
        let accel = accel_for(world.clone(), instructions);
        let hit = closest(&accel, &Ray::new(Vec3::ZERO, Vec3::Z)).unwrap();
        assert_eq!((hit.shape, hit.primitive, hit.t), (0, 1, 1.0));
    }
}

#[test]
fn rays_that_can_hit_nothing() {
    let world = world_of(bumpy_sphere(1, DVec3::ZERO));
    for instructions in all_instructions() {
        let accel = accel_for(world.clone(), instructions);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for k in 0..3 {
                let mut ray = Ray::new(Vec3::ZERO, Vec3::ONE);
                ray.origin[k] = bad;
                assert_eq!(closest(&accel, &ray), None);
                let mut ray = Ray::new(Vec3::ZERO, Vec3::ONE);
                ray.direction[k] = bad;
                assert_eq!(closest(&accel, &ray), None);
                assert!(!occluded(&accel, &ray));
            }
        }
        assert_eq!(closest(&accel, &Ray::new(Vec3::ZERO, Vec3::ZERO)), None);
        assert_eq!(closest(&accel, &Ray { t_max: 0.0, ..Ray::new(Vec3::ZERO, Vec3::X) }), None);
        assert_eq!(closest(&accel, &Ray { t_max: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::X) }), None);
    }
}
