//! No ray leaves a closed mesh unseen.

use glam::{DMat3, DQuat};

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

/// A floor of many triangles far away: rays down at its corners, the middles of its edges, and anywhere.
#[test]
fn watertight_on_a_plane_far_away() {
    const N: u32 = 24;
    let at = |i: u32, j: u32| (FAR + DVec3::new(f64::from(i), 0.3 * f64::from(i + j), f64::from(j)) * 4.0).as_vec3();
    let number = |i: u32, j: u32| i * (N + 1) + j;
    let positions = (0..=N).flat_map(|i| (0..=N).map(move |j| at(i, j))).collect();
    let cells = (0..N).flat_map(|i| (0..N).map(move |j| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [number(i, j), number(i, j + 1), number(i + 1, j + 1), number(i + 1, j)];
        [[a, b, c], [a, c, d]]
    });
    let mesh = TriangleMesh { positions, triangles: triangles.collect() };
    let mut random = Random(8);
    let mut rays = Vec::new();
    let mut aim = |p: Vec3| {
        let origin = p + Vec3::new(random.signed(), 1.5, random.signed()) * 20.0;
        rays.push(Ray::new(origin, p - origin));
    };
    for i in 1..N {
        for j in 1..N {
            let p = at(i, j);
            aim(p);
            for next in [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)] {
                aim((p + next) * 0.5);
            }
        }
    }
    let mut places = Random(9);
    for _ in 0..20_000 {
        let mut place = || 1.0 + places.unit() * f64::from(N - 2);
        let (x, z) = (place(), place());
        aim((FAR + DVec3::new(x, 0.3 * (x + z), z) * 4.0).as_vec3());
    }
    for instructions in all_instructions() {
        let accel = accel_for(world_of(mesh.clone()), instructions);
        let leaks = rays.iter().filter(|ray| closest(&accel, ray).is_none() || !occluded(&accel, ray)).count();
        assert_eq!(leaks, 0, "{instructions:?}, {} rays", rays.len());
    }
}

/// Slivers are hit where they are and nowhere else: a ray that passes one by ten times its own width, or beyond its
/// end, finds nothing (Embree issue 387).
#[test]
fn slivers_are_met_where_they_are() {
    let mut random = Random(6);
    let (mut met, mut tried) = (0, 0);
    for i in 0..20_000 {
        let width = 10f64.powi(-2 - i % 4);
        let turn = DMat3::from_quat(DQuat::from_axis_angle(random.direction(), 6.0 * random.unit()));
        let place = random.direction() * 2.0;
        let map = |p: DVec3| (turn * p + place).as_vec3();
        // Along x, `width` high in the middle, in the plane z = 0.
        let corners = [DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.1, width, 0.0)];
        let mesh = TriangleMesh { positions: corners.map(map).to_vec(), triangles: vec![[0, 1, 2]] };
        let accel = Accel::build(world_of(mesh), TriangleTest::Watertight);
        let x = 1.8 * random.unit() - 0.9;
        let from = DVec3::new(x + 0.5 * random.unit(), 0.7 * random.unit(), 3.0);
        let shot = |target: DVec3| {
            let (origin, target) = (map(from), map(target));
            closest(&accel, &Ray::new(origin, target - origin)).is_some()
        };
        let top = width * (1.0 - (x - 0.1).abs() / if x > 0.1 { 0.9 } else { 1.1 });
        for past in [top + 10.0 * width, -10.0 * width] {
            assert!(!shot(DVec3::new(x, past, 0.0)), "width {width}: hit at {past}, top {top}");
        }
        assert!(!shot(DVec3::new(1.0 + 10.0 * width, 0.0, 0.0)), "width {width}: hit beyond its end");
        // Its middle, as far as f32 can aim at it.
        if width >= 1e-4 && top > 0.2 * width {
            tried += 1;
            met += usize::from(shot(DVec3::new(x, 0.5 * top, 0.0)));
        }
    }
    assert!(tried > 10_000 && met == tried, "{met} of {tried}");
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
