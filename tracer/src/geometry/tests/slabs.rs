//! Boxes never hide what the triangle test accepts: rays along axes, on faces, edges and corners.

use super::*;

/// A closed box.
fn add_box(mesh: &mut TriangleMesh, lo: Vec3, hi: Vec3) {
    let k = mesh.positions.len() as u32;
    for i in 0..8 {
        let pick = |bit: usize, axis: usize| if i & bit == 0 { lo[axis] } else { hi[axis] };
        mesh.positions.push(Vec3::new(pick(1, 0), pick(2, 1), pick(4, 2)));
    }
    for q in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        let [a, b, c, d] = q.map(|v: u32| v + k);
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

/// 27 boxes with gaps, on round numbers.
fn boxes() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for i in 0..27 {
        let lo = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.5;
        add_box(&mut mesh, lo, lo + 0.75);
    }
    mesh
}

#[test]
fn rays_along_axes_on_faces_edges_and_corners() {
    let mesh = boxes();
    let bounds: Vec<Bounds> = (0..mesh.triangles.len()).map(|k| Bounds::of(&mesh.corners(k).unwrap())).collect();
    let places = [-1.5f32, -1.0, -0.75, -0.5, 0.0, 0.25, 0.5, 1.25];
    let nothings = [0.0f32, -0.0, 1e-40, -1e-40, 1e-45, -1e-45];
    let (mut hits, mut culled_by_naive_slabs) = (0, 0);
    let accels: Vec<Accel> = all_instructions().into_iter().map(|i| accel_for(world_of(mesh.clone()), i)).collect();
    for axis in 0..3 {
        for sign in [1.0f32, -1.0] {
            for (&u, &v) in places.iter().flat_map(|u| places.iter().map(move |v| (u, v))) {
                for (a, b) in nothings.iter().flat_map(|a| nothings.iter().map(move |b| (a, b))) {
                    let (mut origin, mut direction) = (Vec3::ZERO, Vec3::ZERO);
                    origin[axis] = -5.0 * sign;
                    direction[axis] = sign;
                    (origin[(axis + 1) % 3], origin[(axis + 2) % 3]) = (u, v);
                    (direction[(axis + 1) % 3], direction[(axis + 2) % 3]) = (*a, *b);
                    let ray = Ray::new(origin, direction);
                    let expected = accels[0].closest_by_brute_force(&ray, &mut Counters::default());
                    for accel in &accels {
                        assert_eq!(bits(closest(accel, &ray)), bits(expected), "{ray:?}");
                        assert_eq!(occluded(accel, &ray), expected.is_some(), "{ray:?}");
                    }
                    if let Some(hit) = expected {
                        hits += 1;
                        let naive = textbook::slab_test(&bounds[hit.primitive as usize], &ray);
                        culled_by_naive_slabs += usize::from(naive.is_none());
                    }
                }
            }
        }
    }
    println!("{hits} hits, of which naive slabs would cull {culled_by_naive_slabs}");
    assert!(hits > 3000, "{hits}");
    assert!(culled_by_naive_slabs > 0);
}

/// A ray that starts on the plane of a box's face and runs in it, towards triangles that reach behind it.
#[test]
fn rays_that_start_on_faces() {
    let mesh = boxes();
    let accels: Vec<Accel> = all_instructions().into_iter().map(|i| accel_for(world_of(mesh.clone()), i)).collect();
    let mut random = Random(8);
    let places = [-1.5f32, -0.75, -0.5, 0.25, 0.5, 1.25, 0.1];
    let mut hits = 0;
    for _ in 0..4000 {
        let mut pick = || places[random.bits() as usize % places.len()];
        let origin = Vec3::new(pick(), pick(), pick());
        let target = Vec3::new(pick(), pick(), pick());
        let ray = Ray::new(origin, target - origin);
        let expected = accels[0].closest_by_brute_force(&ray, &mut Counters::default());
        for accel in &accels {
            assert_eq!(bits(closest(accel, &ray)), bits(expected), "{ray:?}");
        }
        hits += usize::from(expected.is_some());
    }
    assert!(hits > 1000);
}
