//! No ray leaves a closed mesh unseen.

use super::*;

/// Rays from points inside: in random directions, and at every corner and every middle of an edge.
fn rays_from_inside(mesh: &TriangleMesh, at: DVec3, random_rays: usize) -> Vec<Ray> {
    let mut random = Random(3);
    let mut rays = Vec::new();
    let mut start = || (at + random.direction() * 0.7 * random.unit()).as_vec3();
    for p in &mesh.positions {
        let origin = start();
        rays.push(Ray::new(origin, *p - origin));
    }
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (mesh.positions[t[k] as usize], mesh.positions[t[(k + 1) % 3] as usize]);
            let origin = start();
            rays.push(Ray::new(origin, (a + b) * 0.5 - origin));
        }
    }
    let mut random = Random(4);
    for _ in 0..random_rays {
        let origin = (at + random.direction() * 0.7 * random.unit()).as_vec3();
        rays.push(Ray::new(origin, random.direction().as_vec3()));
    }
    rays
}

const FAR: DVec3 = DVec3::new(148_376.0, 1_234.0, -223_423.0);

#[test]
fn watertight_from_inside_a_closed_sphere_wherever_it_is() {
    for at in [DVec3::ZERO, FAR] {
        let mesh = bumpy_sphere(5, at);
        let rays = rays_from_inside(&mesh, at, 100_000);
        for instructions in all_instructions() {
            let accel = accel_for(world_of(mesh.clone()), instructions);
            let leaks = rays.iter().filter(|r| closest(&accel, r).is_none()).count();
            assert_eq!(leaks, 0, "{instructions:?} at {at}, {} rays", rays.len());
            let leaks = rays.iter().filter(|r| !occluded(&accel, r)).count();
            assert_eq!(leaks, 0, "any hit, {instructions:?} at {at}");
        }
    }
}

/// The same rays through the textbook's test do leak: the test above can fail.
#[test]
fn moeller_trumbore_leaks() {
    let mesh = bumpy_sphere(5, DVec3::ZERO);
    let rays = rays_from_inside(&mesh, DVec3::ZERO, 100_000);
    {
        let options = Options { test: TriangleTest::MoellerTrumbore, ..Options::default() };
        let accel = Accel::build_with(world_of(mesh), options);
        let leaks = rays.iter().filter(|r| closest(&accel, r).is_none()).count();
        println!("Moeller-Trumbore: {leaks} leaks of {} rays", rays.len());
        assert!(leaks > 0);
    }
}

/// The mesh as a bundle of separate triangles seen along the ray: every one that is crossed, in turn.
fn crossings(accel: &Accel, mesh: &TriangleMesh, ray: &Ray) -> usize {
    let frame = triangle::RayFrame::new(ray).unwrap();
    let all = (0..mesh.triangles.len())
        .filter(|&k| frame.intersect(mesh.corners(k).unwrap().map(|p| p.to_array())).is_some())
        .count();
    // What the tree finds first must be among them.
    assert_eq!(all > 0, closest(accel, ray).is_some());
    all
}

/// A ray from outside crosses a closed surface an even number of times, one from inside an odd number.
/// Random rays meet no edge exactly, so no crossing is counted twice.
#[test]
fn parity_on_closed_meshes() {
    for at in [DVec3::ZERO, FAR] {
        let mesh = bumpy_sphere(3, at);
        let accel = Accel::build(world_of(mesh.clone()), TriangleTest::Watertight);
        let mut random = Random(5);
        for _ in 0..1500 {
            let inside = (at + random.direction() * 0.8 * random.unit()).as_vec3();
            let outside = (at + random.direction() * (1.3 + 3.0 * random.unit())).as_vec3();
            let ray = Ray::new(inside, random.direction().as_vec3());
            assert_eq!(crossings(&accel, &mesh, &ray) % 2, 1, "{ray:?}");
            let towards = at + random.direction() * 1.1 * random.unit() - outside.as_dvec3();
            let ray = Ray::new(outside, towards.normalize().as_vec3());
            assert_eq!(crossings(&accel, &mesh, &ray) % 2, 0, "{ray:?}");
        }
    }
}

/// Triangles of any size keep tight: the squared area of these is far outside of `f32`.
#[test]
fn watertight_at_any_scale() {
    for scale in [1e-25, 1e-12, 1e-5, 1e6, 1e18, 1e30f64] {
        let mut mesh = bumpy_sphere(2, DVec3::ZERO);
        for p in &mut mesh.positions {
            *p = (p.as_dvec3() * scale).as_vec3();
        }
        let rays = rays_from_inside(&bumpy_sphere(2, DVec3::ZERO), DVec3::ZERO, 2000);
        for instructions in all_instructions() {
            let accel = accel_for(world_of(mesh.clone()), instructions);
            assert_eq!(accel.dropped(), 0);
            let leaks = rays
                .iter()
                .map(|r| Ray::new((r.origin.as_dvec3() * scale).as_vec3(), r.direction))
                .filter(|r| closest(&accel, r).is_none() || !occluded(&accel, r))
                .count();
            assert_eq!(leaks, 0, "{instructions:?} at scale {scale}");
        }
    }
}
