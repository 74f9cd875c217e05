//! The farm by plain HTTP, as the README does it with curl.

use std::time::Duration;

use common::hash::AssetHash;
use reqwest::{Client, StatusCode};
use serde_json::{Value, json};

use crate::processes::{Coordinator, Process, repository, tessera, wait};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn assets_job_and_images_by_plain_http() {
    let folder = tempfile::tempdir().unwrap();
    let farm = Coordinator::start(folder.path()).await;
    let _worker = farm.worker("one");
    let (http, api) = (Client::new(), format!("{}/api/v1", farm.url));

    let mut scene: Value =
        serde_json::from_slice(&std::fs::read(repository("scenes/mesh-light.json")).unwrap()).unwrap();
    let file = scene["shapes"].as_array().unwrap().iter().find_map(|shape| shape["file"].as_str()).unwrap().to_string();
    let mesh = std::fs::read(repository("scenes").join(&file)).unwrap();
    let hash = AssetHash::of(&mesh);
    scene["assets"] = json!({ (file): hash });
    let request = json!({
        "scene": scene, "resolution": [32, 32], "tile": 16, "quality": {"target": "samples", "samples": 4}
    });
    let submit = || http.post(format!("{api}/jobs")).json(&request).send();

    let missing = submit().await.unwrap();
    assert_eq!(missing.status(), StatusCode::CONFLICT);
    let missing: Value = missing.json().await.unwrap();
    assert_eq!(missing["error"]["missing"], json!([hash]));

    let place = format!("{api}/assets/{hash}");
    assert_eq!(http.head(&place).send().await.unwrap().status(), StatusCode::NOT_FOUND);
    let wrong = http.put(&place).body("something else").send().await.unwrap();
    assert_eq!(wrong.status(), StatusCode::UNPROCESSABLE_ENTITY);
    assert!(http.put(&place).body(mesh.clone()).send().await.unwrap().status().is_success());
    assert!(http.head(&place).send().await.unwrap().status().is_success());
    assert_eq!(http.get(&place).send().await.unwrap().bytes().await.unwrap(), mesh);

    let created = submit().await.unwrap();
    assert_eq!(created.status(), StatusCode::CREATED);
    let job: Value = created.json().await.unwrap();
    let place = format!("{api}/jobs/{}", job["id"].as_str().unwrap());
    let done = wait("the job's end", async || {
        let job: Value = http.get(&place).send().await.unwrap().json().await.unwrap();
        Some(job).filter(|job| job["status"] != "queued" && job["status"] != "active")
    })
    .await;
    assert_eq!((&done["status"], &done["progress"]), (&json!("completed"), &json!(1.0)), "{done}");
    assert_eq!(done["samples"], 32 * 32 * 4);

    for (name, kind) in [("image.png", "image/png"), ("samples.png", "image/png"), ("image.exr", "image/x-exr")] {
        let image = format!("{place}/frames/1/{name}");
        let response = http.get(&image).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::OK, "{name}");
        assert_eq!(response.headers()["content-type"], kind);
        let tag = response.headers()["etag"].clone();
        assert!(response.bytes().await.unwrap().len() > 100);
        let again = http.get(&image).header("if-none-match", tag).send().await.unwrap();
        assert_eq!(again.status(), StatusCode::NOT_MODIFIED, "{name}");
    }
    let page = http.get(format!("{}/", farm.url)).send().await.unwrap();
    assert!(page.status().is_success());
    assert!(page.text().await.unwrap().contains("<html"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_wrong_with_a_request_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let farm = Coordinator::start(folder.path()).await;
    let (http, api) = (Client::new(), format!("{}/api/v1", farm.url));
    let scene = json!({"tessera": 1, "camera": {"position": [0, 0, 3], "target": [0, 0, 0]}});
    for (request, field) in [
        (json!({"scene": scene, "colour": 1}), "colour"),
        (json!({"scene": scene, "resolution": [100_000, 100_000]}), "resolution"),
        (json!({"scene": scene, "tile": "big"}), "tile"),
        (json!({"scene": {"tessera": 1, "camera": {"position": [0, 0, 3], "target": "x"}}}), "camera.target"),
    ] {
        let response = http.post(format!("{api}/jobs")).json(&request).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::UNPROCESSABLE_ENTITY, "{request}");
        let error: Value = response.json().await.unwrap();
        assert!(error["error"]["message"].as_str().unwrap().contains(field), "{error}");
    }
    assert_eq!(http.get(format!("{api}/jobs/j99")).send().await.unwrap().status(), StatusCode::NOT_FOUND);
}

/// The examples of docs/examples, as they are. One whose interpreter is missing says so and is left out.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_examples_submit_wait_and_fetch() {
    let folder = tempfile::tempdir().unwrap();
    let farm = Coordinator::start(folder.path()).await;
    let _worker = farm.worker("one");
    let mut scene: Value =
        serde_json::from_slice(&std::fs::read(repository("scenes/mesh-light.json")).unwrap()).unwrap();
    scene["film"] = json!({ "width": 24, "height": 24 });
    scene["settings"]["quality"] = json!({ "target": "samples", "samples": 4 });
    let place = folder.path().join("scene");
    std::fs::create_dir_all(place.join("meshes")).unwrap();
    std::fs::copy(repository("scenes/meshes/torus-knot.ply"), place.join("meshes/torus-knot.ply")).unwrap();
    std::fs::write(place.join("mesh.json"), scene.to_string()).unwrap();
    // The shell's example takes scenes without files.
    let shapes = scene["shapes"].as_array_mut().unwrap();
    shapes[0] = json!({ "type": "sphere", "radius": 0.5, "center": [0, 2.3, 0], "emission": 5 });
    std::fs::write(place.join("plain.json"), scene.to_string()).unwrap();
    for (interpreter, example, scene) in [("python3", "submit.py", "mesh.json"), ("bash", "submit.sh", "plain.json")] {
        let (out, url) = (folder.path().join(format!("{example}.png")), farm.url.clone());
        let mut command = std::process::Command::new(interpreter);
        command.arg(repository("docs/examples").join(example)).arg(place.join(scene)).arg(&out).arg(url);
        command.env_remove("TESSERA_TOKEN");
        let ended = tokio::task::spawn_blocking(move || command.output()).await.unwrap();
        let Ok(ended) = ended else {
            eprintln!("*** SKIPPED: there is no {interpreter} to run {example}");
            continue;
        };
        assert!(ended.status.success(), "{example}: {}", String::from_utf8_lossy(&ended.stderr));
        let image = image::open(&out).unwrap().into_rgba8();
        assert_eq!(image.dimensions(), (24, 24), "{example}");
        assert!(image.pixels().all(|pixel| pixel[3] == 255), "{example}: every pixel is rendered");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_token_keeps_strangers_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = tessera(&["coordinator", "--listen", "127.0.0.1:0", "--data", folder.path().to_str().unwrap()]);
    command.env("TESSERA_TOKEN", "correct-horse-battery");
    let farm = Process::of(command);
    let url = wait("the address", async || {
        Some(farm.log().split_once("listening on ")?.1.split_whitespace().next()?.trim_end_matches('/').to_string())
    })
    .await;
    let jobs = format!("{url}/api/v1/jobs");
    let http = Client::new();
    assert_eq!(http.get(&jobs).send().await.unwrap().status(), StatusCode::UNAUTHORIZED);
    let ours = http.get(&jobs).bearer_auth("correct-horse-battery").send().await.unwrap();
    assert_eq!(ours.status(), StatusCode::OK);

    let mut stranger = Process::start(&["worker", "--coordinator", &url, "--threads", "1"]);
    assert_eq!(stranger.code().await, 1);
    assert!(stranger.log().contains("refuses this worker"), "{}", stranger.log());
    let mut command = tessera(&["worker", "--coordinator", &url, "--threads", "1", "--name", "friend"]);
    command.env("TESSERA_TOKEN", "correct-horse-battery");
    let mut friend = Process::of(command);
    wait("the friend's registration", async || friend.log().contains("registered").then_some(())).await;

    // It leaves in good order.
    friend.signal("TERM");
    let code = tokio::time::timeout(Duration::from_secs(60), friend.code()).await.unwrap();
    assert_eq!(code, 0, "{}", friend.log());
}
