//! Ctrl-C on `tessera render`: an image that can be used, and a way to go on.

use crate::{
    kills::assert_same,
    processes::{Process, pixels, repository, succeed, wait},
};
use common::protocol::JobList;
use worker::Endpoint;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_interrupted_render_leaves_an_image_and_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let scene = repository("scenes/cornell-box.json").to_str().unwrap().to_string();
    let options = ["--resolution", "64x64", "--samples", "2048", "--tile", "16", "--threads", "2"];
    let out = at("a.exr");
    // Temporary files belong to the test, to see that they go.
    let mut command = crate::processes::tessera(&[&["render", &scene, "-o", &out], &options[..]].concat());
    command.env("TMPDIR", folder.path());
    let mut render = Process::of(command);
    let url = wait("the dashboard's address", async || {
        let log = render.log();
        Some(log.split_once("dashboard ")?.1.split_whitespace().next()?.trim_end_matches('/').to_string())
    })
    .await;
    let endpoint = Endpoint::new(&url, None).unwrap();
    wait("a part of the image", async || {
        let list: JobList = endpoint.fetch(endpoint.request(reqwest::Method::GET, "/jobs")).await.ok()?;
        list.jobs.first().filter(|job| job.samples > 0).map(drop)
    })
    .await;
    render.signal("INT");
    assert_eq!(render.code().await, 130, "{}", render.log());
    let log = render.log();
    let line = log.lines().find(|line| line.starts_with("error: interrupted")).unwrap();
    let command = line.split_once("go on with: ").unwrap_or_else(|| panic!("{line}")).1;
    let words: Vec<&str> = command.split_whitespace().collect();
    let [_, "render", "--resume", kept, "-o", output] = words[..] else { panic!("{command}") };
    assert_eq!(output, out);
    let light = |path: &str| {
        let channels = pixels(path.as_ref());
        let (_, bits) = channels.iter().find(|(name, _)| name == "samples.Y").unwrap();
        bits.iter().map(|bits| f64::from(f32::from_bits(*bits))).sum::<f64>()
    };
    let partial = light(&out);
    assert!(partial > 0.0 && partial < 64.0 * 64.0 * 2048.0, "{partial} samples are a part of the picture");

    succeed(&words[1..]);
    let whole = at("b.exr");
    succeed(&[&["render", &scene, "-o", &whole], &options[..]].concat());
    assert_same(&pixels(out.as_ref()), &pixels(whole.as_ref()));
    assert!(!std::path::Path::new(kept).exists(), "what was kept for this alone goes with it");
}
