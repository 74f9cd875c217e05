//! Instances are where their baked copies would be.

use glam::{DMat3, DQuat};

use super::*;

fn random_map(random: &mut Random) -> DAffine3 {
    let turn = DQuat::from_axis_angle(random.direction(), 6.0 * random.unit());
    let mut scale = DVec3::splat(0.3 + random.unit());
    if random.bits().is_multiple_of(2) {
        scale *= DVec3::new(0.5 + random.unit(), 1.0, -1.0);
    }
    let matrix = DMat3::from_quat(turn) * DMat3::from_diagonal(scale);
    DAffine3 { matrix3: matrix, translation: random.cube().as_dvec3() * 6.0 }
}

fn baked(mesh: &TriangleMesh, map: &DAffine3) -> Shape {
    let move_it = |p: &Vec3| map.transform_point3(p.as_dvec3()).as_vec3();
    Shape::Mesh(TriangleMesh {
        positions: mesh.positions.iter().map(move_it).collect(),
        triangles: mesh.triangles.clone(),
    })
}

#[test]
fn instances_are_hit_as_baked_copies_are() {
    let mut random = Random(11);
    let meshes = [bumpy_sphere(2, DVec3::ZERO), bumpy_sphere(3, DVec3::new(2.0, 0.0, 0.0))];
    let objects = meshes.iter().map(|m| Object { shapes: vec![Shape::Mesh(m.clone())] }).collect();
    let instances: Vec<Instance> =
        (0..40).map(|k| Instance { object: k % 2, to_world: random_map(&mut random) }).collect();
    let shapes = instances.iter().map(|i| baked(&meshes[i.object as usize], &i.to_world)).collect();
    let flat = Accel::build(World { shapes, ..World::default() }, TriangleTest::Watertight);
    let world = World { shapes: vec![], objects, instances };
    let accels: Vec<Accel> = all_instructions().into_iter().map(|i| accel_for(world.clone(), i)).collect();
    assert_eq!(accels[0].stats().instances, 40);
    let (mut hits, mut same) = (0, 0);
    for k in 0..20_000 {
        let origin = random.cube() * 12.0;
        let ray = Ray::new(origin, random.cube() * 5.0 - origin);
        let expected = if k < 500 {
            accels[0].closest_by_brute_force(&ray, &mut Counters::default())
        } else {
            closest(&accels[0], &ray)
        };
        for accel in &accels {
            assert_eq!(bits(closest(accel, &ray)), bits(expected));
            assert_eq!(occluded(accel, &ray), expected.is_some());
        }
        let other = closest(&flat, &ray);
        let (Some(a), Some(b)) = (expected, other) else {
            // At a silhouette rounding decides.
            same += usize::from(expected.is_none() && other.is_none());
            continue;
        };
        hits += 1;
        if a.instance == b.shape && a.primitive == b.primitive {
            same += 1;
            let (p, q) = (accels[0].surface(&ray, &a), flat.surface(&ray, &b));
            assert!((a.t - b.t).abs() < 1e-4 * b.t, "{a:?} {b:?}");
            assert!((p.p - q.p).length() < 1e-4, "{p:?} {q:?}");
            assert!(p.ng.dot(q.ng) > 0.999, "{p:?} {q:?}");
        }
    }
    assert!(hits > 5000 && same > 19_990, "{hits} hits, {same} the same");
}

#[test]
fn quadrics_under_instances_keep_their_front() {
    let shapes = vec![
        Shape::Sphere { center: Vec3::new(0.0, 0.0, 1.0), radius: 0.5 },
        Shape::Disk { center: Vec3::ZERO, normal: Vec3::Z, radius: 2.0 },
    ];
    let mirror = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::new(2.0, 1.0, -1.0)), translation: DVec3::Y };
    let instances = vec![Instance { object: 0, to_world: mirror }];
    let world = World { objects: vec![Object { shapes }], instances, ..World::default() };
    let accel = Accel::build(world, TriangleTest::Watertight);
    // The sphere now reaches from z = -1.5 to -0.5; the disk is at 0 and faces down.
    let up = Ray::new(Vec3::new(0.0, 1.0, -9.0), Vec3::Z);
    let hit = closest(&accel, &up).unwrap();
    assert_eq!((hit.instance, hit.shape, hit.t), (0, 0, 7.5));
    assert_eq!(accel.surface(&up, &hit).ng, -Vec3::Z);
    let down = Ray::new(Vec3::new(3.5, 1.0, 9.0), -Vec3::Z);
    let hit = closest(&accel, &down).unwrap();
    assert_eq!((hit.shape, hit.t), (1, 9.0));
    assert_eq!(accel.surface(&down, &hit).ng, -Vec3::Z);
    assert_eq!(closest(&accel, &Ray { origin: Vec3::new(4.5, 1.0, 9.0), ..down }), None);
}

#[test]
fn instances_that_cannot_be_are_dropped() {
    let mesh = bumpy_sphere(1, DVec3::ZERO);
    let objects = vec![Object { shapes: vec![Shape::Mesh(mesh)] }, Object::default()];
    let flat = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0));
    let at = |object, to_world| Instance { object, to_world };
    let lost = DAffine3::from_translation(DVec3::NAN);
    let good = DAffine3::from_translation(DVec3::X * 5.0);
    let instances = vec![at(0, flat), at(1, DAffine3::IDENTITY), at(2, DAffine3::IDENTITY), at(0, lost), at(0, good)];
    let accel = Accel::build(World { shapes: vec![], objects, instances }, TriangleTest::Watertight);
    assert_eq!((accel.dropped(), accel.stats().instances), (4, 1));
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    let hit = closest(&accel, &ray).unwrap();
    assert_eq!(hit.instance, 4);
    assert_eq!(bits(Some(hit)), bits(accel.closest_by_brute_force(&ray, &mut Counters::default())));
}

/// Equal parameters: the world's own shapes first, then instances in their order.
#[test]
fn coincident_instances() {
    let mesh = bumpy_sphere(2, DVec3::ZERO);
    let objects = vec![Object { shapes: vec![Shape::Mesh(mesh.clone())] }];
    let same = Instance { object: 0, to_world: DAffine3::IDENTITY };
    let mut world = World { shapes: vec![], objects, instances: vec![same; 9] };
    let mut random = Random(1);
    let rays: Vec<Ray> = (0..200).map(|_| Ray::new(random.cube() * 0.2, random.direction().as_vec3())).collect();
    let accel = Accel::build(world.clone(), TriangleTest::Watertight);
    assert!(rays.iter().all(|r| closest(&accel, r).unwrap().instance == 0));
    world.shapes.push(Shape::Mesh(mesh));
    let accel = Accel::build(world, TriangleTest::Watertight);
    assert!(rays.iter().all(|r| closest(&accel, r).unwrap().instance == Hit::NO_INSTANCE));
}
