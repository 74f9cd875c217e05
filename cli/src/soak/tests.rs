use std::collections::BTreeSet;

use tracer::math::Rgb;

use super::{
    command::write,
    methods,
    run::{Subject, Tally, run},
};
use crate::bundle::Bundle;

#[test]
fn a_tally_knows_bad_samples_and_keeps_the_first() {
    let mut tally = Tally::default();
    let samples = [
        Rgb::new(0.0, 1.0, 0.0),
        Rgb::ZERO,
        Rgb::new(-0.0, 0.0, 0.0),
        Rgb::new(1.0, -1e-30, 1.0),
        Rgb::new(0.0, 0.0, f32::NAN),
        Rgb::new(f32::INFINITY, 0.0, 0.0),
        Rgb::new(-1.0, f32::NAN, 0.0),
        Rgb::splat(f32::MAX),
    ];
    for (i, radiance) in samples.into_iter().enumerate() {
        tally.look(radiance, || format!("sample {i}"));
    }
    let replay = Some("sample 3".into());
    assert_eq!(tally, Tally { samples: 8, lit: 2, not_finite: 3, negative: 1, replay });
}

#[test]
fn every_scene_meets_every_value_of_every_choice() {
    for scene in 0..40 {
        let all: Vec<_> = (0..methods::COUNT).map(|i| methods::method(scene, i)).collect();
        macro_rules! meets {
            ($($field:ident: $count:expr),+) => {$(
                let values: BTreeSet<String> = all.iter().map(|m| format!("{:?}", m.$field)).collect();
                assert_eq!(values.len(), $count, "scene {scene}: {values:?}");
            )+}
        }
        meets!(direct: 5, light_sampling: 3, light_pick: 4, light_samples: 2, fresnel: 2, sampler: 3, roulette: 4);
        meets!(triangle: 2, aim: 2, reuse: 2, bvh: 3, max_depth: 4, only: 3, seed: methods::COUNT);
        let pairs: BTreeSet<_> = all.iter().map(|m| format!("{:?} {:?}", m.direct, m.light_sampling)).collect();
        assert_eq!(pairs.len(), 15, "scene {scene}");
    }
}

/// Few samples of every scene and method: that each loads, is lit, and has none that is bad.
#[test]
fn the_scenes_made_for_trouble_make_none() {
    let folder = tempfile::tempdir().unwrap();
    let mut subjects = write(folder.path()).unwrap();
    assert!(subjects.len() >= 190, "{}", subjects.len());
    for subject in &mut subjects {
        (subject.bundle.scene.film.width, subject.bundle.scene.film.height) = (8, 8);
    }
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let total = run(&subjects, 1, threads, &|_, _| Ok(())).unwrap();
    assert_eq!(total.samples, (subjects.len() * methods::COUNT * 64) as u64);
    assert_eq!(total.replay, None);
}

/// Two lamps whose light together is past the largest number: samples are infinite, and the soak says so.
#[test]
fn a_sample_that_is_not_finite_is_found_and_can_be_rendered_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bright.json");
    let lamp = |x: f64| {
        format!(
            r#"{{"type":"sphere","center":[{x},1.5,0],"radius":1,"emission":{{"radiance":3e38,"two_sided":true}}}}"#
        )
    };
    let text = format!(
        r#"{{"tessera":1,"camera":{{"position":[0,0.5,4],"target":[0,0,0]}},"film":{{"width":8,"height":8}},
        "shapes":[{{"type":"quad","vertices":[[-3,0,3],[3,0,3],[3,0,-3],[-3,0,-3]]}},{},{}]}}"#,
        lamp(-1.1),
        lamp(1.1)
    );
    std::fs::write(&path, text).unwrap();
    let read = || vec![Subject { name: "bright".into(), bundle: Bundle::read(&path).unwrap(), made: true, share: 1.0 }];
    let total = run(&read(), 20_000, 2, &|_, _| Ok(())).unwrap();
    assert!(total.samples >= 20_000 && total.not_finite > 0 && total.negative == 0, "{total:?}");
    // The command given, run as a user would.
    let line = total.replay.unwrap();
    assert!(line.contains(&path.display().to_string()), "{line}");
    let replayed = replay(&line);
    assert!(replayed.contains("inf") || replayed.contains("NaN"), "{line}: {replayed}");

    // Without light there is nothing to prove.
    let mut dark = read();
    dark[0].bundle.scene.shapes.truncate(1);
    let error = run(&dark, 1000, 1, &|_, _| Ok(())).unwrap_err().to_string();
    assert!(error.contains("no light"), "{error}");
}

/// The last line of what a replay prints.
fn replay(line: &str) -> String {
    use clap::Parser;

    let cli = crate::args::Cli::try_parse_from(line.split_whitespace()).unwrap();
    let crate::args::Command::Render(args) = cli.command else { panic!("{line}") };
    let mut bundle = Bundle::read(args.scene.as_deref().unwrap()).unwrap();
    let request = crate::request::of(&args.job, &bundle).unwrap();
    let settings = crate::request::settings(&request, &bundle).unwrap();
    let prepared = bundle.load(&request).unwrap().build();
    let sample = prepared.sample(&settings, args.pixel.unwrap(), args.sample.unwrap());
    sample.to_string().lines().last().unwrap().to_string()
}
