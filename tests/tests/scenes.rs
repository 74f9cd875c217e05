//! Every shipped scene can be read, and everything it names exists.

use std::path::{Path, PathBuf};

use common::scene::{MaterialKind, Mesh, MeshSource, Rgb, SceneFile, ShapeKind, Texture};

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes")
}

/// Every scene file under scenes/, with what it holds.
fn shipped() -> Vec<(PathBuf, SceneFile)> {
    let mut found = Vec::new();
    for folder in [scenes(), scenes().join("analytic"), scenes().join("bench")] {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "json") {
                let scene = SceneFile::parse(&std::fs::read(&path).unwrap());
                found.push((path.clone(), scene.unwrap_or_else(|error| panic!("{}: {error}", path.display()))));
            }
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

fn scene(name: &str) -> SceneFile {
    SceneFile::parse(&std::fs::read(scenes().join(name)).unwrap()).unwrap()
}

#[test]
fn every_scene_is_valid_and_its_files_exist() {
    let found = shipped();
    assert!(found.len() >= 15, "only {} scenes are left", found.len());
    let made: Vec<_> = tessera_tests::meshes::bench::all().into_iter().map(|(p, b)| (scenes().join(p), b)).collect();
    for (path, scene) in found {
        let place = path.display();
        assert!(!scene.name.is_empty() && !scene.description.is_empty(), "{place}: says what it is");
        assert!(scene.settings.quality.is_some(), "{place}: asks for a quality that ends");
        for (field, file) in scene.files() {
            let path = path.parent().unwrap().join(&file);
            // The largest meshes are made, not kept.
            let bytes = match made.iter().find(|(made, _)| *made == path) {
                Some((_, bytes)) => bytes.clone(),
                None => std::fs::read(&path).unwrap_or_else(|error| panic!("{place}: {field}: {file}: {error}")),
            };
            if import::MESH_EXTENSIONS.iter().any(|extension| file.ends_with(extension)) {
                let imported = import::mesh(&file, &bytes, &mut |_| None).unwrap();
                assert_eq!(imported.warnings, Vec::<String>::new(), "{place}");
            }
        }
    }
}

#[test]
fn a_scene_survives_the_trip_through_json() {
    for (path, scene) in shipped() {
        let again = SceneFile::parse(&serde_json::to_vec(&scene).unwrap()).unwrap();
        assert_eq!(again, scene, "{}", path.display());
    }
}

#[test]
fn the_kept_meshes_are_those_that_the_generator_makes() {
    for (path, bytes) in tessera_tests::meshes::all() {
        let kept = std::fs::read(scenes().join(path)).unwrap();
        assert!(kept == bytes, "{path}: run `cargo run --release -p tessera-tests --example generate-meshes`");
        assert!(kept.len() < 1_500_000, "{path}: {} bytes", kept.len());
    }
}

/// The volume inside a closed mesh: positive where its front is outside.
fn volume(mesh: &common::mesh::Mesh) -> f64 {
    let corner = |index: u32| glam::DVec3::from_array(mesh.positions[index as usize].map(f64::from));
    mesh.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum()
}

#[test]
fn the_meshes_have_their_front_outside() {
    for (path, bytes) in tessera_tests::meshes::all().into_iter().chain(tessera_tests::meshes::bench::all()) {
        let mesh = import::mesh(path, &bytes, &mut |_| None).unwrap().parts.remove(0).mesh;
        assert!(volume(&mesh) > 0.5, "{path}: {}", volume(&mesh));
    }
}

#[test]
fn the_mesh_light_is_the_only_light_and_has_more_than_ten_thousand_triangles() {
    let light = scene("mesh-light.json");
    let shining: Vec<_> = light.shapes.iter().filter(|shape| shape.emission.is_some()).collect();
    assert_eq!(shining.len(), 1);
    assert!(light.lights.is_empty() && light.environment.is_none());
    let ShapeKind::Mesh(Mesh { source: MeshSource::File { file }, .. }) = &shining[0].kind else { panic!() };
    let bytes = std::fs::read(scenes().join(file)).unwrap();
    let triangles = import::mesh(file, &bytes, &mut |_| None).unwrap().parts[0].mesh.triangles.len();
    assert!(triangles > 10_000, "{triangles}");
}

#[test]
fn the_cornell_box_has_the_colours_of_its_published_spectra() {
    let cornell = scene("cornell-box.json");
    for (name, expected) in tessera_tests::cornell::colours() {
        let texture = match cornell.materials.get(name).map(|material| &material.kind) {
            Some(MaterialKind::Diffuse(diffuse)) => &diffuse.reflectance,
            _ => {
                let lamp = cornell.shapes.iter().find(|shape| shape.name.as_deref() == Some(name)).unwrap();
                &lamp.emission.as_ref().unwrap().radiance
            }
        };
        let Texture::Constant(Rgb(found)) = texture else { panic!("{name}: {texture:?}") };
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{name}: found {found}, expected {expected}");
        }
    }
}
