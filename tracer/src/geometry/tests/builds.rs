//! Trees over what breaks builders.

use super::*;

fn triangles(corners: impl IntoIterator<Item = [Vec3; 3]>) -> TriangleMesh {
    let positions: Vec<Vec3> = corners.into_iter().flatten().collect();
    let triangles = (0..positions.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    TriangleMesh { positions, triangles }
}

const UNIT: [Vec3; 3] = [Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
const METHODS: [BuildMethod; 3] = [BuildMethod::Sah, BuildMethod::MeanCentroid, BuildMethod::Midpoint];

fn build(mesh: TriangleMesh, method: BuildMethod) -> Accel {
    Accel::build_with(world_of(mesh), Options { method, ..Options::default() })
}

fn same_as_brute_force(accel: &Accel, ray: &Ray) -> Option<Hit> {
    let expected = accel.closest_by_brute_force(ray, &mut Counters::default());
    assert_eq!(bits(closest(accel, ray)), bits(expected), "{ray:?}");
    assert_eq!(occluded(accel, ray), expected.is_some(), "{ray:?}");
    expected
}

#[test]
fn seventy_thousand_identical_triangles() {
    for method in METHODS {
        let accel = build(triangles(std::iter::repeat_n(UNIT, 70_000)), method);
        assert_eq!((accel.dropped(), accel.stats().triangles), (0, 70_000));
        assert!(accel.stats().depth < 20, "{}", accel.stats().depth);
        let hit = same_as_brute_force(&accel, &Ray::new(Vec3::Z, -Vec3::Z)).unwrap();
        assert_eq!((hit.primitive, hit.t), (0, 1.0));
    }
}

#[test]
fn a_geometric_progression_of_sizes() {
    // From 2^-120 to 2^120: every midpoint is all of the larger half.
    let sizes: Vec<f32> = (-120..120).map(|k| 2f32.powi(k)).collect();
    for method in METHODS {
        let accel = build(triangles(sizes.iter().map(|&s| UNIT.map(|p| (p + Vec3::ONE) * s))), method);
        assert_eq!(accel.dropped(), 0);
        for (k, &s) in sizes.iter().enumerate().step_by(7) {
            let ray = Ray::new(Vec3::new(s, s, s * 1.5), -Vec3::Z);
            let hit = same_as_brute_force(&accel, &ray).unwrap();
            assert_eq!(hit.primitive, k as u32);
        }
    }
}

#[test]
fn bad_triangles_are_dropped_and_counted() {
    let mut corners = vec![UNIT; 10];
    for (k, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        corners[k][k].y = bad;
    }
    corners[3] = [Vec3::X; 3];
    corners[4] = [Vec3::ZERO, Vec3::ONE, Vec3::ONE * 3.0];
    let mut mesh = triangles(corners);
    mesh.triangles[5][2] = 30;
    for method in METHODS {
        let accel = build(mesh.clone(), method);
        assert_eq!((accel.dropped(), accel.stats().triangles), (6, 4));
        assert_eq!(same_as_brute_force(&accel, &Ray::new(Vec3::Z, -Vec3::Z)).unwrap().primitive, 6);
        assert_eq!(accel.bounds(), Bounds::of(&UNIT));
    }
}

#[test]
fn huge_and_tiny_coordinates() {
    for scale in [1e-30f32, 1e-18, 1e18, 1e30] {
        for method in METHODS {
            let mesh = bumpy_sphere(3, DVec3::ZERO);
            let corners = (0..mesh.triangles.len()).map(|k| mesh.corners(k).unwrap().map(|p| p * scale));
            let accel = build(triangles(corners), method);
            assert_eq!(accel.dropped(), 0);
            let mut random = Random(2);
            for _ in 0..50 {
                let ray = Ray::new(random.cube() * 0.3 * scale, random.direction().as_vec3());
                let hit = same_as_brute_force(&accel, &ray).unwrap();
                let length = hit.t / scale;
                assert!((0.4..1.6).contains(&length), "{length} at {scale}");
            }
            // The tree is worth its name: not every triangle is tested.
            let mut counters = Counters::default();
            let _ = accel.closest(&Ray::new(Vec3::ZERO, Vec3::ONE), &mut counters);
            assert!(counters.primitive_tests < 400, "{} at {scale}, {method:?}", counters.primitive_tests);
        }
    }
}

#[test]
fn nothing_and_one() {
    for instructions in all_instructions() {
        let accel = accel_for(World::default(), instructions);
        assert!(accel.bounds().is_empty());
        assert_eq!(closest(&accel, &Ray::new(Vec3::ZERO, Vec3::X)), None);
        assert!(!occluded(&accel, &Ray::new(Vec3::ZERO, Vec3::X)));
        let accel = accel_for(world_of(TriangleMesh::default()), instructions);
        assert_eq!(closest(&accel, &Ray::new(Vec3::ZERO, Vec3::X)), None);
        let accel = accel_for(world_of(triangles([UNIT])), instructions);
        assert_eq!(closest(&accel, &Ray::new(Vec3::Z, -Vec3::Z)).unwrap().t, 1.0);
        assert_eq!(closest(&accel, &Ray::new(Vec3::Z, Vec3::Z)), None);
    }
}

#[test]
fn the_same_tree_from_any_number_of_threads_and_any_instructions() {
    let mut world = world_of(bumpy_sphere(6, DVec3::ZERO));
    world.objects = (0..3).map(|k| Object { shapes: world_of(bumpy_sphere(k + 1, DVec3::ONE)).shapes }).collect();
    let place = |k: u32| Instance { object: k % 3, to_world: DAffine3::from_translation(DVec3::splat(f64::from(k))) };
    world.instances = (0..100).map(place).collect();
    for method in METHODS {
        let in_pool = |threads, instructions| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = Options { method, instructions, ..Options::default() };
            pool.install(|| Accel::build_with(world.clone(), options).tree_bits())
        };
        let first = in_pool(1, InstructionSet::detect());
        assert!(first == in_pool(4, InstructionSet::detect()), "{method:?}");
        for instructions in all_instructions() {
            assert!(first == in_pool(2, instructions), "{method:?}, {instructions:?}");
        }
    }
}

/// Nodes of four and of eight children are two trees over the same triangles.
#[test]
fn either_width_finds_the_same_hits() {
    let mesh = bumpy_sphere(5, DVec3::ZERO);
    let widths = [Width::Eight, Width::Four];
    let accels = widths.map(|width| Accel::build_with(world_of(mesh.clone()), Options { width, ..Options::default() }));
    let nodes = accels.each_ref().map(|accel| accel.stats().nodes);
    assert!(nodes[1] > 3 * nodes[0] / 2, "{nodes:?}");
    let mut random = Random(5);
    let mut work = [Counters::default(); 2];
    for _ in 0..3000 {
        let ray = Ray::new(random.cube() * 2.0, random.direction().as_vec3());
        let [eight, four] = [0, 1].map(|k| bits(accels[k].closest(&ray, &mut work[k])));
        assert_eq!(eight, four, "{ray:?}");
        assert_eq!(occluded(&accels[0], &ray), occluded(&accels[1], &ray), "{ray:?}");
    }
    assert!(work[1].node_tests > work[0].node_tests, "{work:?}");
}

/// The methods differ in the work and the memory, and in nothing else. The surface area heuristic
/// opens fewer nodes than the mean's tree and fills its packs better than either; the midpoint's half-empty packs
/// cost memory instead.
#[test]
fn every_method_finds_the_same_hits() {
    // A detailed object in a large hall.
    let mut mesh = bumpy_sphere(5, DVec3::ZERO);
    for p in &mut mesh.positions {
        *p *= 0.1;
    }
    let mut corners: Vec<[Vec3; 3]> = (0..mesh.triangles.len()).map(|k| mesh.corners(k).unwrap()).collect();
    let mut random = Random(9);
    for _ in 0..2000 {
        let at = random.direction().as_vec3() * 5.0;
        corners.push([at, at + random.cube() * 2.0, at + random.cube() * 2.0]);
    }
    let accels = METHODS.map(|method| build(triangles(corners.clone()), method));
    let mut work = [Counters::default(); 3];
    for _ in 0..3000 {
        let origin = random.direction().as_vec3() * 2.0;
        let ray = Ray::new(origin, random.cube() * 0.5 - origin);
        let mut first = None;
        for (accel, work) in accels.iter().zip(&mut work) {
            let hit = bits(accel.closest(&ray, work));
            assert_eq!(*first.get_or_insert(hit), hit);
        }
    }
    let bytes = accels.each_ref().map(Accel::bytes);
    println!("{work:?}, bytes {bytes:?} for {METHODS:?}");
    assert!(work[0].node_tests < work[1].node_tests);
    assert!(bytes[0] < bytes[1] && bytes[0] < bytes[2]);
}
