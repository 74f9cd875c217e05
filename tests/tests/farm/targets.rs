//! Quality targets: the same picture however the frame is cut, a budget that is kept, a job that is continued.

use std::path::Path;

use serde_json::Value;

use crate::{
    kills::assert_same,
    processes::{Coordinator, pixels, repository, succeed},
};

fn scene() -> String {
    repository("scenes/cornell-box.json").to_str().unwrap().to_string()
}

fn report(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap()
}

/// A frame that several tiles of 16 and of 64 pixels cut, and that one of 1024 does not.
#[test]
fn a_noise_target_shows_no_seam_wherever_tiles_end() {
    let folder = tempfile::tempdir().unwrap();
    let render = |tile: &str| {
        let out = folder.path().join(tile);
        let options = ["--resolution", "80x72", "--noise", "0.3", "--max-samples", "512", "--tile", tile];
        succeed(&[&["render", &scene(), "-o", out.to_str().unwrap()], &options[..]].concat());
        (std::fs::read(out.join("frame-0001.exr")).unwrap(), report(&out))
    };
    let (whole, report) = render("1024");
    let samples = &report["samples"];
    assert!(samples["max"].as_f64() > Some(2.0 * samples["mean"].as_f64().unwrap()), "it adapts: {samples}");
    for tile in ["16", "64"] {
        let (tiled, _) = render(tile);
        assert!(tiled == whole, "tiles of {tile} pixels give another picture than the whole image");
    }
    assert_eq!(report["error_share"], 0.99);
    let missed = report["pixels_missed"].as_u64().unwrap() as f64;
    assert_eq!(report["target_met"].as_bool(), Some(missed <= 0.01 * 80.0 * 72.0), "{report}");
}

/// The names under which other programs look for the layers, and what is in them.
#[test]
fn one_exr_holds_all_layers() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.exr");
    succeed(&["render", &scene(), "-o", out.to_str().unwrap(), "--resolution", "16x16", "--noise", "0.5"]);
    let channels = pixels(&out);
    let names: Vec<&str> = channels.iter().map(|(name, _)| name.as_str()).collect();
    let expected =
        "A B G R albedo.B albedo.G albedo.R depth.Z interval.Y normal.X normal.Y normal.Z samples.Y stderr.Y";
    assert_eq!(names.join(" "), expected);
    let of = |name: &str| -> Vec<f32> {
        let (_, bits) = channels.iter().find(|(found, _)| found == name).unwrap();
        bits.iter().map(|bits| f32::from_bits(*bits)).collect()
    };
    assert!(of("samples.Y").iter().all(|&n| n >= 64.0));
    // From 1.96 and a little for many degrees of freedom to 3.2 x 4/3 for the pilot's three.
    for (half_width, error) in of("interval.Y").into_iter().zip(of("stderr.Y")) {
        let ratio = half_width / error;
        assert!(ratio.is_nan() || (1.9..4.4).contains(&ratio), "Student's quantile: {half_width} over {error}");
    }
    let normals = of("normal.X").into_iter().zip(of("normal.Y")).zip(of("normal.Z"));
    assert!(normals.into_iter().all(|((x, y), z)| x * x + y * y + z * z < 1.001));
    assert!(of("depth.Z").iter().any(|&depth| depth > 1.0));
}

#[test]
fn a_budget_of_processor_seconds_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    succeed(&[
        "render",
        &scene(),
        "-o",
        out.to_str().unwrap(),
        "--resolution",
        "48x48",
        "--time",
        "3",
        "--max-samples",
        "65536",
    ]);
    let report = report(&out);
    let spent = report["cpu_seconds"].as_f64().unwrap();
    assert!((2.25..3.75).contains(&spent), "{spent} of 3 s");
    let samples = &report["samples"];
    assert!(samples["max"].as_f64() > Some(1.5 * samples["mean"].as_f64().unwrap()), "the worst first: {samples}");
    // Three processor seconds are long enough for a forecast on any machine.
    let forecast = &report["forecast"][0];
    assert!(forecast["samples"]["ratio"].as_f64().is_some_and(|ratio| ratio > 0.2 && ratio < 5.0), "{report}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sixty_four_samples_continued_to_256_are_256_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let farm = Coordinator::start(&folder.path().join("data")).await;
    let _worker = farm.worker("one");
    let at = |name: &str| folder.path().join(name);
    let run = |arguments: &[&str], out: &Path| {
        let farm = ["--watch", "-o", out.to_str().unwrap(), "--coordinator", &farm.url];
        succeed(&[arguments, &farm[..]].concat());
        pixels(out)
    };
    let (size, scene) = (["--resolution", "40x24", "--tile", "16"], scene());
    let early = run(&[&["submit", &scene, "--samples", "64"], &size[..]].concat(), &at("64.exr"));
    let id = farm.the_job().await.to_string();
    let late = run(&["continue", &id, "--samples", "256"], &at("continued.exr"));
    let once = run(&[&["submit", &scene, "--samples", "256"], &size[..]].concat(), &at("256.exr"));
    assert_same(&late, &once);
    assert!(early != late);
    assert!(std::fs::read(at("continued.exr")).unwrap() == std::fs::read(at("256.exr")).unwrap());
}
