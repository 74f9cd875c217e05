//! Spheres and disks against what geometry says.

use super::*;

fn sphere(center: Vec3, radius: f32) -> Accel {
    let shapes = vec![Shape::Sphere { center, radius }];
    Accel::build(World { shapes, ..World::default() }, TriangleTest::Watertight)
}

/// A sphere seen at a radius of a millionth of the distance: rays inside its outline hit, rays outside
/// miss, and the point is on the sphere where the ray enters it.
#[test]
fn small_spheres_far_away() {
    let mut random = Random(21);
    for ratio in [1e-6f32, 1e-4, 1e-2, 0.5] {
        for _ in 0..4000 {
            let center = random.cube() * 100.0;
            let distance = 10.0 + 1000.0 * random.unit() as f32;
            let radius = distance * ratio;
            let accel = sphere(center, radius);
            // What is hit is decided by the ray as it is, after rounding.
            let away = random.direction();
            let origin = (center.as_dvec3() + away * f64::from(distance)).as_vec3();
            let side = away.cross(random.direction()).normalize();
            let aim = center.as_dvec3() + side * f64::from(radius) * 1.6 * random.unit();
            let ray = Ray::new(origin, (aim - origin.as_dvec3()).as_vec3());
            let d = ray.direction.as_dvec3().normalize();
            let oc = center.as_dvec3() - origin.as_dvec3();
            let miss = oc.cross(d).length() / f64::from(radius);
            let hit = closest(&accel, &ray);
            if (miss - 1.0).abs() > 1e-4 {
                assert_eq!(hit.is_some(), miss < 1.0, "{miss} at ratio {ratio}");
            }
            let Some(hit) = hit.filter(|_| miss < 0.99) else { continue };
            let point = accel.surface(&ray, &hit);
            let n = point.ng.as_dvec3();
            assert!((n.length() - 1.0).abs() < 1e-6);
            // The normal tells where on the sphere: at the same distance from the axis, on the near side.
            let sine = n.cross(d).length();
            assert!((sine - miss).abs() < 1e-4, "{sine} {miss} at ratio {ratio}");
            assert!(n.dot(d) < 0.0);
            let exact = center.as_dvec3() + n * f64::from(radius);
            let off = (point.p.as_dvec3() - exact).abs();
            let bound = point.p_error.as_dvec3() + 2e-7 * f64::from(radius);
            assert!(off.cmple(bound).all(), "{off} {bound}");
        }
    }
}

#[test]
fn spheres_from_inside_and_from_their_surface() {
    let accel = sphere(Vec3::new(1.0, 2.0, 3.0), 2.0);
    let inside = Ray::new(Vec3::new(1.0, 2.0, 3.5), Vec3::Z * 0.5);
    assert_eq!(closest(&accel, &inside).unwrap().t, 3.0);
    assert_eq!(closest(&accel, &Ray { t_max: 3.0, ..inside }), None);
    assert_eq!(closest(&accel, &Ray::new(Vec3::new(1.0, 2.0, 9.0), Vec3::Z)), None);
    // From exactly on it: the other side, or nothing.
    let on = Vec3::new(1.0, 2.0, 5.0);
    assert_eq!(closest(&accel, &Ray::new(on, -Vec3::Z)).unwrap().t, 4.0);
    assert_eq!(closest(&accel, &Ray::new(on, Vec3::Z)), None);
}

#[test]
fn disks_from_either_side_and_edge_on() {
    let shapes = vec![Shape::Disk { center: Vec3::Y, normal: Vec3::new(0.0, 3.0, 0.0), radius: 2.0 }];
    let accel = Accel::build(World { shapes, ..World::default() }, TriangleTest::Watertight);
    for (y, d) in [(4.0, -1.0), (-2.0, 1.0)] {
        let ray = Ray::new(Vec3::new(1.9, y, 0.0), Vec3::new(0.0, d, 0.0));
        let hit = closest(&accel, &ray).unwrap();
        assert_eq!(hit.t, 3.0);
        assert_eq!(accel.surface(&ray, &hit).ng, Vec3::Y);
        assert_eq!(closest(&accel, &Ray { origin: Vec3::new(1.5, y, 1.5), ..ray }), None);
    }
    assert_eq!(closest(&accel, &Ray::new(Vec3::new(-5.0, 1.0, 0.0), Vec3::X)), None);
    assert_eq!(closest(&accel, &Ray::new(Vec3::Y, Vec3::Y)), None);
}

#[test]
fn quadrics_without_size_are_dropped() {
    let bad = [0.0, -1.0, f32::NAN, f32::INFINITY];
    let mut shapes: Vec<Shape> = bad.iter().map(|&radius| Shape::Sphere { center: Vec3::ZERO, radius }).collect();
    shapes.extend(bad.map(|radius| Shape::Disk { center: Vec3::ZERO, normal: Vec3::Z, radius }));
    shapes.push(Shape::Disk { center: Vec3::ZERO, normal: Vec3::ZERO, radius: 1.0 });
    shapes.push(Shape::Sphere { center: Vec3::NAN, radius: 1.0 });
    shapes.push(Shape::Sphere { center: Vec3::X * 3.0, radius: 1.0 });
    let accel = Accel::build(World { shapes, ..World::default() }, TriangleTest::Watertight);
    assert_eq!((accel.dropped(), accel.stats().others), (10, 1));
    assert_eq!(closest(&accel, &Ray::new(Vec3::ZERO, Vec3::X)).unwrap().shape, 10);
}
