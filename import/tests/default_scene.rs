//! The scene made for a bare mesh holds all of the mesh in its image.

use common::scene::{Rgb, SceneFile};
use glam::DVec3;
use import::{Imported, mesh, scene_from_mesh};
use proptest::prelude::*;

fn tetrahedron(points: [[f32; 3]; 4]) -> Imported {
    let mut text = String::new();
    for [x, y, z] in points {
        text += &format!("v {x} {y} {z}\n");
    }
    mesh("dir/m.obj", (text + "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n").as_bytes(), &mut |_| None).unwrap()
}

/// Where a point falls in the image: -1 to 1 along both axes is inside; `None` behind the camera.
fn project(scene: &SceneFile, point: DVec3) -> Option<[f64; 2]> {
    let camera = &scene.camera;
    let eye = DVec3::from_array(camera.position);
    let forward = (DVec3::from_array(camera.target) - eye).normalize();
    let right = forward.cross(DVec3::from_array(camera.up)).normalize();
    let up = right.cross(forward);
    let (to, slope) = (point - eye, (camera.fov / 2.0).to_radians().tan());
    let depth = to.dot(forward);
    (depth > 0.0).then(|| [to.dot(right), to.dot(up)].map(|h| h / (depth * slope)))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_corner_is_in_the_image_and_the_mesh_fills_it(
        unit in prop::array::uniform4(prop::array::uniform3(-1.0f32..1.0)),
        scale in prop::array::uniform3(-4i32..5),
        offset in prop::array::uniform3(-100.0f32..100.0),
    ) {
        let stretch = |p: [f32; 3]| std::array::from_fn(|i| offset[i] + p[i] * 10f32.powi(scale[i]));
        let imported = tetrahedron(unit.map(stretch));
        let scene = scene_from_mesh("dir/m.obj", &imported);
        scene.check().unwrap();
        let points = imported.parts[0].mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
        let mut largest = 0.0f64;
        for point in points {
            let seen = project(&scene, point).expect("in front of the camera");
            prop_assert!(seen.iter().all(|c| c.abs() < 1.0), "{point} falls at {seen:?}");
            largest = largest.max(seen[0].abs()).max(seen[1].abs());
        }
        prop_assert!(largest > 0.05, "the mesh is a dot in the image: {largest}");
    }
}

#[test]
fn what_was_made_up_is_said() {
    let imported = tetrahedron([[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]);
    let scene = scene_from_mesh("dir/m.obj", &imported);
    assert_eq!(scene.name, "m.obj");
    assert!(scene.description.contains("no camera") && scene.description.contains("lamp"), "{}", scene.description);
    assert!(scene.environment.is_some());
    assert_eq!(scene.files(), [("shapes[0].file".to_owned(), "dir/m.obj".to_owned())]);
    let again = SceneFile::parse(&serde_json::to_vec(&scene).unwrap()).unwrap();
    assert_eq!(again, scene);
    let lamp = scene.shapes.last().unwrap();
    let common::scene::ShapeKind::Disk(disk) = &lamp.kind else { panic!() };
    let seen = project(&scene, DVec3::from_array(disk.center));
    assert!(seen.is_none_or(|s| s.iter().any(|c| c.abs() > 1.5)), "the lamp is out of the picture: {seen:?}");
}

#[test]
fn a_mesh_that_shines_gets_no_other_light() {
    let mut imported = tetrahedron([[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]);
    imported.parts[0].emission = Rgb::grey(1.0);
    let scene = scene_from_mesh("m.obj", &imported);
    assert_eq!((scene.shapes.len(), scene.environment), (1, None));
}

#[test]
fn a_single_point_and_a_plane_still_make_a_scene() {
    for points in [[[5.0; 3]; 4], [[0., 0., 0.], [1., 0., 0.], [0., 0., 1.], [1., 0., 1.]]] {
        scene_from_mesh("m.obj", &tetrahedron(points)).check().unwrap();
    }
}
