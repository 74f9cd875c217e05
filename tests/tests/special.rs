//! Specialised code against general code: the same picture, bit for bit, on every scene that is shipped.

use std::path::Path;

use common::{
    method::{Aim, Direct, LightPick, MethodChoices, Reuse},
    scene::SceneFile,
};
use tessera_tests::direct::{Picture, render_without, scene};
use tracer::special::{Special, Without};

/// Scenes of scenes/ and scenes/analytic/, small.
fn shipped() -> Vec<(String, SceneFile)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes");
    let mut found = Vec::new();
    for folder in ["", "analytic/"] {
        for entry in std::fs::read_dir(root.join(folder)).unwrap() {
            let file = entry.unwrap().file_name().into_string().unwrap();
            if file.ends_with(".json") {
                let name = format!("{folder}{file}");
                let mut scene = scene(&name);
                (scene.film.width, scene.film.height) = (16, 12);
                found.push((name, scene));
            }
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

fn bits(picture: &Picture) -> Vec<([u64; 3], u32)> {
    picture.moments.iter().map(|pixel| (pixel.mean.map(f64::to_bits), pixel.samples)).collect()
}

#[test]
fn no_specialisation_changes_a_bit() {
    let shipped = shipped();
    assert!(shipped.len() >= 15, "scenes are there: {}", shipped.len());
    let methods = [
        MethodChoices::default(),
        MethodChoices { aim: Some(Aim::Delta), splits: Some(2), ..MethodChoices::default() },
        MethodChoices { reuse: Some(Reuse::Paths), ..MethodChoices::default() },
        MethodChoices {
            direct: Some(Direct::Light),
            light_pick: Some(Some(LightPick::All)),
            light_samples: Some(2),
            max_depth: Some(2),
            ..MethodChoices::default()
        },
    ];
    let everything: Vec<Special> = Special::ALL.iter().map(|(_, special)| *special).collect();
    let mut without: Vec<(&str, Without)> = Special::ALL.iter().map(|(n, s)| (*n, Without::all(&[*s]))).collect();
    without.push(("all of them", Without::all(&everything)));
    without.push(("opacity beside waves", Without::all(&[Special::Waves, Special::Opacity])));
    let mut bright = 0;
    for (name, scene) in &shipped {
        for choices in &methods {
            let special = render_without(name, scene, 16, choices.clone(), Without::NOTHING);
            for (what, without) in &without {
                let general = render_without(name, scene, 16, choices.clone(), *without);
                assert!(bits(&special) == bits(&general), "{name}, {choices:?}: {what}");
                assert_eq!(special.rays, general.rays, "{name}: {what}");
            }
            bright += usize::from(special.moments.iter().any(|pixel| pixel.luminance() > 0.0));
        }
    }
    assert!(bright >= 3 * shipped.len() - 6, "pictures show something: {bright}");
}
