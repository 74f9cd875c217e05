//! The contract of every route: what it takes, what it answers, what it refuses and with which words.

mod support;

use axum::{
    body::Body,
    http::{Method, Request, StatusCode, header},
};
use common::{
    hash::AssetHash,
    job::JobState,
    method::Direct,
    pass::Work,
    plan::{Facts, MethodPlan},
    protocol::Preparation,
    tile::Rect,
};
use coordinator::{Config, build_app};
use futures::StreamExt;
use serde_json::{Value, json};
use support::{Answer, Worker, call, compress, fixed, fresh, get, job, open, post, put, render, scene, submit};

/// A refusal with this status, code and field, whose message holds `words`.
#[track_caller]
fn refused(answer: &Answer, status: u16, code: &str, field: Option<&str>, words: &str) {
    assert_eq!(answer.status.as_u16(), status, "{}", answer.text());
    let (found, message, at) = answer.error();
    assert_eq!((found.as_str(), at.as_deref()), (code, field), "{message}");
    assert!(message.contains(words), "{message:?} does not hold {words:?}");
}

#[tokio::test]
async fn assets_are_kept_by_their_hash_and_only_by_it() {
    let (_folder, app) = fresh().await;
    let bytes = b"a file of some length".repeat(10_000);
    let hash = AssetHash::of(&bytes);
    let path = format!("/api/v1/assets/{hash}");
    refused(&get(&app, &path).await, 404, "not_found", None, &hash.to_string());
    assert_eq!(call(&app, Method::HEAD, &path, Body::empty()).await.status, StatusCode::NOT_FOUND);
    refused(&put(&app, &path, "something else").await, 422, "invalid", None, "hash");
    assert_eq!(call(&app, Method::HEAD, &path, Body::empty()).await.status, StatusCode::NOT_FOUND);
    assert_eq!(put(&app, &path, bytes.clone()).await.status, StatusCode::CREATED);
    assert_eq!(put(&app, &path, bytes.clone()).await.status, StatusCode::OK);
    let head = call(&app, Method::HEAD, &path, Body::empty()).await;
    assert_eq!((head.status, head.headers[header::CONTENT_LENGTH].to_str().unwrap()), (StatusCode::OK, "210000"));
    assert_eq!(get(&app, &path).await.body, bytes);
    for bad in ["xyz", "..%2f..%2fetc%2fpasswd", &"A".repeat(65)] {
        assert_eq!(get(&app, &format!("/api/v1/assets/{bad}")).await.status, StatusCode::NOT_FOUND, "{bad}");
    }
}

#[tokio::test]
async fn two_coordinators_do_not_share_a_folder() {
    let (folder, _app) = fresh().await;
    let error = build_app(Config::new(folder.path())).await.err().unwrap().to_string();
    assert!(error.contains("in use by another coordinator") && error.contains(&folder.path().display().to_string()));
}

#[tokio::test]
async fn an_asset_above_the_limit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let app = build_app(Config { max_asset: 10, ..Config::new(folder.path()) }).await.unwrap();
    let path = format!("/api/v1/assets/{}", AssetHash::of(b"eleven byte"));
    refused(&put(&app, &path, "eleven byte").await, 413, "too_large", None, "10 bytes");
}

#[tokio::test]
async fn bad_jobs_are_refused_by_the_field() {
    let (_folder, app) = fresh().await;
    let with = |change: &dyn Fn(&mut Value)| {
        let mut body = fixed();
        change(&mut body);
        body
    };
    type Case<'a> = (&'a dyn Fn(&mut Value), &'a str, &'a str);
    let cases: [Case; 16] = [
        (&|b: &mut Value| b["colour"] = json!(1), "colour", "unknown field"),
        (&|b: &mut Value| b["tile"] = json!("big"), "tile", "expected"),
        (&|b: &mut Value| b["tile"] = json!(32.5), "tile", "floating point"),
        (&|b: &mut Value| b["tile"] = json!(4), "tile", "8 to 1024"),
        (&|b: &mut Value| b["priority"] = json!(101), "priority", "0 to 100"),
        (&|b: &mut Value| b["quality"]["samples"] = json!(0), "quality.samples", "0 samples"),
        (
            &|b: &mut Value| b["quality"] = json!({ "target": "time", "cpu_seconds": 0 }),
            "quality.cpu_seconds",
            "positive",
        ),
        (&|b: &mut Value| b["method"] = json!({ "max_depth": 100_000 }), "method.max_depth", "10000"),
        (&|b: &mut Value| b["method"] = json!({ "adaptive": "on" }), "method.adaptive", "fixed"),
        (&|b: &mut Value| b["resolution"] = json!([100_000, 100]), "resolution", "100000x100"),
        (&|b: &mut Value| b["crop"] = json!([90, 0, 20, 10]), "crop", "not inside"),
        (&|b: &mut Value| b["frames"] = json!("9-3"), "frames", "9-3"),
        (&|b: &mut Value| b["scene"]["film"] = json!({ "width": 0 }), "scene.film", "0x512"),
        (&|b: &mut Value| b["scene"]["shapes"][0]["radius"] = json!(-1), "scene.shapes[0].radius", "-1"),
        (&|b: &mut Value| b["scene"]["shapes"][0]["material"] = json!("gold"), "scene.shapes[0].material", "gold"),
        (
            &|b: &mut Value| b["scene"]["shapes"][0] = json!({ "type": "mesh", "file": "a.obj" }),
            "scene.shapes[0].file",
            "a.obj",
        ),
    ];
    for (change, field, words) in cases {
        let answer = post(&app, "/api/v1/jobs", &with(change)).await;
        refused(&answer, 422, "invalid", Some(field), words);
    }
    refused(&call(&app, Method::POST, "/api/v1/jobs", "{").await, 400, "malformed", None, "JSON");
    refused(&call(&app, Method::POST, "/api/v1/jobs", " [null, null]").await, 400, "malformed", None, "list");
    assert_eq!(get(&app, "/api/v1/jobs").await.json()["jobs"], json!([]));
    let whole = submit(&app, with(&|b: &mut Value| b["tile"] = json!(32.0))).await;
    assert_eq!(whole.tile, 32, "32.0 is a whole number");
}

#[tokio::test]
async fn missing_files_are_listed_and_a_second_try_succeeds() {
    let (_folder, app) = fresh().await;
    let (mesh, extra) = (b"v 0 0 0".to_vec(), b"newmtl a".to_vec());
    let (mesh_hash, extra_hash) = (AssetHash::of(&mesh), AssetHash::of(&extra));
    let mut file = scene();
    file["shapes"][0] = json!({ "type": "mesh", "file": "meshes/a.obj" });
    file["assets"] = json!({ "meshes/a.obj": mesh_hash, "meshes/a.mtl": extra_hash });
    let text = file.to_string();
    let scene_hash = AssetHash::of(text.as_bytes());
    let body = json!({ "scene": { "asset": scene_hash } });

    let answer = post(&app, "/api/v1/jobs", &body).await;
    refused(&answer, 409, "missing_assets", None, "PUT");
    assert_eq!(answer.json()["error"]["missing"], json!([scene_hash]));
    put(&app, &format!("/api/v1/assets/{scene_hash}"), text).await;
    put(&app, &format!("/api/v1/assets/{mesh_hash}"), mesh).await;
    let answer = post(&app, "/api/v1/jobs", &body).await;
    assert_eq!(answer.json()["error"]["missing"], json!([extra_hash]));
    put(&app, &format!("/api/v1/assets/{extra_hash}"), extra).await;
    let answer = post(&app, "/api/v1/jobs", &body).await;
    assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
    assert_eq!(answer.headers[header::LOCATION], "/api/v1/jobs/j1");
    assert_eq!(answer.json()["scene"], json!(scene_hash));

    // A stored file that is no scene names the field, too.
    put(&app, &format!("/api/v1/assets/{}", AssetHash::of(b"{}")), "{}").await;
    let answer = post(&app, "/api/v1/jobs", &json!({ "scene": { "asset": AssetHash::of(b"{}") } })).await;
    refused(&answer, 422, "invalid", Some("scene"), "tessera");
}

#[tokio::test]
async fn jobs_go_through_their_states_and_refuse_the_rest() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let act = async |verb: &str| post(&app, &format!("/api/v1/jobs/j1/{verb}"), &json!({})).await;
    refused(&act("resume").await, 409, "conflict", None, "queued");
    refused(&act("requeue").await, 409, "conflict", None, "queued");
    refused(&call(&app, Method::DELETE, "/api/v1/jobs/j1", Body::empty()).await, 409, "conflict", None, "cancel");
    assert_eq!(act("pause").await.json()["status"], "paused");
    let worker = Worker::register(&app, "a").await;
    assert!(worker.lease(&app).await.is_none(), "a paused job gives no work");
    assert_eq!(act("resume").await.json()["status"], "queued");
    let lease = worker.lease(&app).await.unwrap();
    assert_eq!(job(&app, "j1").await.state, JobState::Active);
    assert_eq!(act("cancel").await.json()["status"], "canceled");
    refused(&act("cancel").await, 409, "conflict", None, "canceled");

    // Its lease is taken back, and a late result is no error and does not count.
    let beat = json!({ "leases": [lease.id] });
    let reply = post(&app, &format!("/api/v1/workers/{}/heartbeat", worker.id), &beat).await;
    assert_eq!(reply.json(), json!({ "cancelled": [lease.id], "drain": false }));
    assert_eq!(worker.hand_in(&app, &lease, &lease.units[0]).await.json(), json!({ "counted": false }));

    assert_eq!(act("requeue").await.json()["status"], "queued");
    worker.work(&app, usize::MAX).await;
    assert_eq!(job(&app, "j1").await.state, JobState::Completed);
    assert_eq!(call(&app, Method::DELETE, "/api/v1/jobs/j1", Body::empty()).await.status, StatusCode::NO_CONTENT);
    refused(&get(&app, "/api/v1/jobs/j1").await, 404, "not_found", None, "j1");
    assert_eq!(submit(&app, fixed()).await.id.to_string(), "j2", "no number is given twice");
}

#[tokio::test]
async fn a_patch_changes_what_it_may() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let patch = async |body: Value| call(&app, Method::PATCH, "/api/v1/jobs/j1", body.to_string()).await;
    let view = patch(json!({ "priority": 90, "name": "new" })).await.json();
    assert_eq!((&view["priority"], &view["name"]), (&json!(90), &json!("new")));
    refused(&patch(json!({ "priority": 200 })).await, 422, "invalid", Some("priority"), "100");
    refused(&patch(json!({ "tile": 8 })).await, 422, "invalid", Some("tile"), "unknown field");
    let fewer = json!({ "quality": { "target": "samples", "samples": 16 } });
    refused(&patch(fewer).await, 422, "invalid", Some("quality.samples"), "less than");
    let noise = json!({ "quality": { "target": "noise", "relative_error": 0.01 } });
    refused(&patch(noise).await, 409, "conflict", None, "when the job is completed");
}

#[tokio::test]
async fn lists_are_pages_newest_first() {
    let (_folder, app) = fresh().await;
    for _ in 0..5 {
        submit(&app, fixed()).await;
    }
    post(&app, "/api/v1/jobs/j2/cancel", &json!({})).await;
    let page = async |query: &str| get(&app, &format!("/api/v1/jobs{query}")).await;
    let ids = |answer: &Answer| -> Vec<String> {
        answer.json()["jobs"].as_array().unwrap().iter().map(|job| job["id"].as_str().unwrap().into()).collect()
    };
    let first = page("?limit=2").await;
    assert_eq!((ids(&first), first.json()["next"].as_str()), (vec!["j5".into(), "j4".into()], Some("j4")));
    let last = page("?limit=3&cursor=j4").await;
    assert_eq!((ids(&last), last.json().get("next")), (vec!["j3".into(), "j2".into(), "j1".into()], None));
    assert_eq!(ids(&page("?status=canceled").await), ["j2"]);
    assert_eq!(ids(&page("?status=").await).len(), 5);
    refused(&page("?status=ill").await, 422, "invalid", Some("status"), "queued");
    refused(&page("?limit=0").await, 422, "invalid", Some("limit"), "1 to 500");
    refused(&page("?page=2").await, 422, "invalid", Some("page"), "unknown");
}

#[tokio::test]
async fn pictures_grow_and_are_sent_again_only_when_they_changed() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let path = "/api/v1/jobs/j1/frames/1/image.png";
    let empty = get(&app, path).await;
    assert_eq!((empty.status, &empty.headers[header::CONTENT_TYPE]), (StatusCode::OK, &"image/png".parse().unwrap()));
    let tag = empty.headers[header::ETAG].clone();
    let again = async |tag: &str| {
        let request = Request::get(path).header(header::IF_NONE_MATCH, tag).body(Body::empty()).unwrap();
        support::whole(support::send(&app, request).await).await
    };
    let same = again(tag.to_str().unwrap()).await;
    assert_eq!((same.status, same.body.len()), (StatusCode::NOT_MODIFIED, 0));
    assert_eq!(same.headers[header::ETAG], tag);
    Worker::register(&app, "a").await.work(&app, usize::MAX).await;
    let full = again(tag.to_str().unwrap()).await;
    assert_eq!(full.status, StatusCode::OK);
    assert_ne!(full.headers[header::ETAG], tag);
    assert_ne!(full.body, empty.body);
    refused(&get(&app, "/api/v1/jobs/j1/frames/2/image.png").await, 404, "not_found", None, "frame 2");
    refused(&get(&app, "/api/v1/jobs/j1/frames/1/image.gif").await, 404, "not_found", None, "image.gif");
    refused(&get(&app, "/api/v1/jobs/j9/frames/1/image.png").await, 404, "not_found", None, "j9");
}

#[tokio::test]
async fn tiles_tell_their_state() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let tiles = async || get(&app, "/api/v1/jobs/j1/frames/1/tiles").await.json()["tiles"].as_array().unwrap().clone();
    assert_eq!(tiles().await.len(), 12);
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let held = &tiles().await[lease.units[0].id.tile as usize];
    assert_eq!((&held["state"], &held["worker"]), (&json!("leased"), &json!(worker.id)));
    for unit in &lease.units {
        worker.hand_in(&app, &lease, unit).await;
    }
    worker.work(&app, usize::MAX).await;
    for tile in tiles().await {
        assert_eq!((&tile["state"], &tile["passes"], &tile["attempts"]), (&json!("done"), &json!(2), &json!(0)));
        let area = tile["rect"]["w"].as_u64().unwrap() * tile["rect"]["h"].as_u64().unwrap();
        assert_eq!(tile["samples"], json!(64 * area));
        assert!(tile["milliseconds"].as_f64().unwrap() > 0.0);
    }
}

#[tokio::test]
async fn results_that_cannot_be_are_refused_and_cost_an_attempt() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let unit = &lease.units[0];
    let good = render(&lease.settings, unit);
    let path = format!("/api/v1/leases/{}/units/{}", lease.id, unit.id);
    let elsewhere = path.replace(&format!("t{}.", unit.id.tile), "t5.");
    let spoilt = |change: &dyn Fn(&mut common::result::UnitResult)| {
        let mut result = good.clone();
        change(&mut result);
        compress(&result.encode())
    };
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (b"rubbish".to_vec(), "zstd"),
        (compress(b"rubbish"), "not a unit result"),
        (compress(&vec![0; 1 << 24]), "unpacked"),
        (spoilt(&|r| r.film.moments[3].mean[1] = f64::NAN), "finite"),
        (spoilt(&|r| r.film.moments[3].mean[1] = f64::INFINITY), "finite"),
        (spoilt(&|r| r.film.features.clear()), "features"),
        (spoilt(&|r| r.film.moments[0].samples += 1), "more samples"),
        (spoilt(&|r| r.rect.x += 1), "rectangle"),
        (spoilt(&|r| r.film.moments.truncate(9)), "cut short"),
    ];
    // The first strike takes the unit away; two more would fail the job, so each case has a farm of its own.
    for (body, words) in cases {
        let (_folder, app) = fresh().await;
        submit(&app, fixed()).await;
        let worker = Worker::register(&app, "a").await;
        let lease = worker.lease(&app).await.unwrap();
        let path = format!("/api/v1/leases/{}/units/{}", lease.id, unit.id);
        refused(&put(&app, &path, body).await, 422, "invalid", None, words);
        let tiles = get(&app, "/api/v1/jobs/j1/frames/1/tiles").await.json();
        assert_eq!(tiles["tiles"][unit.id.tile as usize]["attempts"], 1, "{words}");
    }
    refused(&put(&app, &elsewhere, compress(&good.encode())).await, 404, "not_found", None, "unit");
    refused(&put(&app, "/api/v1/leases/l1/units/j1.f1", "").await, 404, "not_found", None, "j1.f1");
    assert_eq!(put(&app, &path, compress(&good.encode())).await.json(), json!({ "counted": true }));
    assert_eq!(put(&app, &path, compress(&good.encode())).await.json(), json!({ "counted": false }));
    // Under a lease nobody knows, while the unit is open, a result is as good as any.
    if let Some(other) = lease.units.get(1) {
        let path = format!("/api/v1/leases/l99/units/{}", other.id);
        let body = compress(&render(&lease.settings, other).encode());
        assert_eq!(put(&app, &path, body).await.json(), json!({ "counted": true }));
    }
}

#[tokio::test]
async fn a_job_whose_units_fail_everywhere_ends_with_their_message() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let worker = Worker::register(&app, "a").await;
    for round in 0..3 {
        let lease = worker.lease(&app).await.unwrap_or_else(|| panic!("no lease in round {round}"));
        let units: Vec<String> = lease.units.iter().map(|unit| unit.id.to_string()).collect();
        let body = json!({ "worker": worker.id, "units": units, "cause": "failed", "message": "no such mesh" });
        let answer = post(&app, &format!("/api/v1/leases/{}/fail", lease.id), &body).await;
        assert_eq!(answer.status, StatusCode::NO_CONTENT);
    }
    let view = job(&app, "j1").await;
    assert_eq!(view.state, JobState::Failed);
    let message = view.message.unwrap();
    assert!(message.contains("frame 1") && message.contains("no such mesh"), "{message}");
    let workers = get(&app, "/api/v1/workers").await.json();
    assert_eq!(workers["workers"][0]["state"], "idle", "the scene was at fault, not the worker");
}

#[tokio::test]
async fn workers_register_once_per_start_and_are_drained_and_disabled() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let worker = Worker::register(&app, "a").await;
    assert_eq!(Worker::register(&app, "a").await.id, worker.id, "a repeated request is no new worker");
    assert_ne!(Worker::register(&app, "b").await.id, worker.id, "a restarted worker is one");
    let act = async |verb: &str| post(&app, &format!("/api/v1/workers/{}/{verb}", worker.id), &json!({})).await.json();
    assert_eq!(act("drain").await["state"], "draining");
    assert!(worker.lease(&app).await.is_none());
    let beat = post(&app, &format!("/api/v1/workers/{}/heartbeat", worker.id), &json!({ "leases": [] })).await;
    assert_eq!(beat.json()["drain"], true);
    assert_eq!(act("enable").await["state"], "idle");
    let lease = worker.lease(&app).await.unwrap();
    assert_eq!(act("disable").await["state"], "disabled");
    // What it held goes to the other one.
    let other = Worker::register(&app, "b").await;
    let taken = other.lease(&app).await.unwrap();
    assert_eq!(taken.units[0].id, lease.units[0].id);
    refused(&post(&app, "/api/v1/workers/w9/drain", &json!({})).await, 404, "not_found", None, "w9");
    refused(&post(&app, "/api/v1/workers/w9/lease", &json!({})).await, 404, "not_found", None, "register");
    refused(&post(&app, "/api/v1/workers/w9/heartbeat", &json!({ "leases": [] })).await, 404, "not_found", None, "w9");
}

#[tokio::test]
async fn a_job_is_pinned_to_the_tracer_of_its_first_worker() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let first = Worker::register_as(&app, "a", "v1").await;
    let second = Worker::register_as(&app, "b", "v2").await;
    assert_eq!(first.lease(&app).await.unwrap().tracer, "v1");
    assert!(second.lease(&app).await.is_none());
    assert_eq!(job(&app, "j1").await.tracer.as_deref(), Some("v1"));
}

#[tokio::test]
async fn a_request_for_work_waits_until_there_is_some() {
    let (_folder, app) = fresh().await;
    let worker = Worker::register(&app, "a").await;
    let path = format!("/api/v1/workers/{}/lease", worker.id);
    let waiting = {
        let app = app.clone();
        tokio::spawn(async move { post(&app, &path, &json!({ "wait_seconds": 20 })).await })
    };
    tokio::task::yield_now().await;
    submit(&app, fixed()).await;
    let answer = waiting.await.unwrap();
    assert_eq!(answer.status, StatusCode::OK);
    assert_eq!(answer.json()["units"][0]["id"].as_str().unwrap().split('.').next(), Some("j1"));
}

#[tokio::test]
async fn events_begin_with_the_present_state_and_tell_what_changes() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    for (path, first) in [("/api/v1/events", "event: jobs"), ("/api/v1/jobs/j1/events", "event: state")] {
        let answer = support::send(&app, Request::get(path).body(Body::empty()).unwrap()).await;
        assert_eq!(answer.headers()[header::CONTENT_TYPE], "text/event-stream");
        let mut stream = answer.into_body().into_data_stream();
        let mut heard = String::new();
        let mut until = async |words: &str| {
            while !heard.contains(words) {
                heard.push_str(std::str::from_utf8(&stream.next().await.expect("more").unwrap()).unwrap());
            }
            std::mem::take(&mut heard)
        };
        assert!(until("\"id\":\"j1\"").await.starts_with(first), "{path}");
        let verb = if path.contains("j1") { "resume" } else { "pause" };
        post(&app, &format!("/api/v1/jobs/j1/{verb}"), &json!({})).await;
        let wanted = if verb == "pause" { "\"status\":\"paused\"" } else { "\"status\":\"queued\"" };
        assert!(until(wanted).await.contains("event: state"));
        // The stream ends with the service, not with its listeners.
        if path.contains("j1") {
            app.service.leaving.cancel();
            while let Some(chunk) = stream.next().await {
                chunk.unwrap();
            }
        }
    }
    refused(&get(&app, "/api/v1/jobs/j7/events").await, 404, "not_found", None, "j7");
}

#[tokio::test]
async fn with_a_token_every_call_needs_it() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { token: Some("open-sesame".into()), ..Config::new(folder.path()) };
    let app = build_app(config).await.unwrap();
    for (method, path) in [
        (Method::GET, "/api/v1/jobs"),
        (Method::POST, "/api/v1/workers"),
        (Method::GET, "/api/v1/events"),
        (Method::GET, "/api/v1/no-such-route"),
    ] {
        refused(&call(&app, method, path, Body::empty()).await, 401, "unauthorized", None, "token");
    }
    for path in ["/healthz", "/readyz", "/", "/docs/", "/api/v1/openapi.json"] {
        assert_eq!(get(&app, path).await.status, StatusCode::OK, "{path}");
    }
    for (name, value, status) in [
        ("authorization", "Bearer open-sesame", StatusCode::OK),
        ("authorization", "Bearer open-sesam", StatusCode::UNAUTHORIZED),
        ("cookie", "tessera_token=open-sesame", StatusCode::OK),
    ] {
        let request = Request::get("/api/v1/jobs").header(name, value).body(Body::empty()).unwrap();
        assert_eq!(support::send(&app, request).await.status(), status, "{value}");
    }
}

#[tokio::test]
async fn a_page_of_another_site_cannot_change_anything() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let request = |origin: &str| {
        let request = Request::post("/api/v1/jobs/j1/cancel").header(header::HOST, "127.0.0.1:7878");
        request.header(header::ORIGIN, origin).body(Body::empty()).unwrap()
    };
    let answer = support::whole(support::send(&app, request("https://example.org")).await).await;
    refused(&answer, 403, "forbidden", None, "another site");
    assert_eq!(support::send(&app, request("http://127.0.0.1:7878")).await.status(), StatusCode::OK);
}

#[tokio::test]
async fn unknown_routes_and_methods_answer_with_the_one_error_body() {
    let (_folder, app) = fresh().await;
    refused(&get(&app, "/api/v1/nothing").await, 404, "not_found", None, "route");
    refused(&get(&app, "/nothing").await, 404, "not_found", None, "page");
    refused(&put(&app, "/api/v1/jobs", "").await, 405, "method_not_allowed", None, "method");
    refused(&get(&app, "/api/v1/jobs/17").await, 404, "not_found", None, "17");
    let huge = vec![b' '; (64 << 20) + 1];
    refused(&call(&app, Method::POST, "/api/v1/jobs", huge).await, 413, "too_large", None, "larger");
}

#[tokio::test]
async fn figures_are_in_the_text_format_of_prometheus() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    Worker::register(&app, "a").await.work(&app, usize::MAX).await;
    let text = get(&app, "/metrics").await.text();
    for line in ["tessera_jobs{state=\"completed\"} 1", "tessera_workers{state=\"idle\"} 1", "tessera_units_pending 0"]
    {
        assert!(text.lines().any(|found| found == line), "no {line} in\n{text}");
    }
    let samples = format!("tessera_samples_total {}", 7000 * 64);
    assert!(text.contains(&samples), "{text}");
    assert!(text.contains("tessera_worker_threads{state=\"idle\"} 2"), "{text}");
    assert!(text.contains(&format!("tessera_build_info{{version=\"{}\"}} 1", env!("CARGO_PKG_VERSION"))), "{text}");
    let spent = text.lines().find_map(|line| line.strip_prefix("tessera_render_cpu_seconds_total ")).unwrap();
    assert!((spent.parse::<f64>().unwrap() - 1e-5 * 7000.0 * 64.0).abs() < 1e-3, "{spent}");
    // Names as Prometheus has them: counters end in _total, and each has its type and help.
    for line in text.lines().filter_map(|line| line.strip_prefix("# TYPE ")) {
        let (name, kind) = line.split_once(' ').unwrap();
        assert_eq!(kind == "counter", name.ends_with("_total"), "{line}");
        assert!(text.contains(&format!("# HELP {name} ")), "{line}");
    }
    // The dashboard for Grafana asks for nothing that is not here.
    let board = include_str!("../../deploy/grafana-dashboard.json");
    let asked = board.split("tessera_").skip(1).map(|rest| {
        let end = rest.find(|c: char| !c.is_ascii_lowercase() && c != '_').unwrap();
        format!("# TYPE tessera_{} ", &rest[..end])
    });
    for name in asked {
        assert!(text.contains(&name), "{name}");
    }
    assert!(serde_json::from_str::<Value>(board).unwrap()["panels"].as_array().unwrap().len() > 8);
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let (_, value) = line.rsplit_once(' ').unwrap();
        assert!(value.parse::<f64>().is_ok(), "{line}");
    }
}

#[tokio::test]
async fn a_job_that_leaves_the_method_open_is_prepared_first_and_keeps_what_was_chosen() {
    let (folder, app) = fresh().await;
    let body = |method: Value| {
        let quality = json!({ "target": "samples", "samples": 64 });
        json!({ "scene": scene(), "resolution": [128, 128], "quality": quality, "method": method })
    };
    let id = submit(&app, body(json!({}))).await.id;
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let [unit] = &lease.units[..] else { panic!("{lease:?}") };
    let Work::Prepare { trial } = &unit.work else { panic!("{unit:?}") };
    assert_eq!(trial.region, Rect::frame(128, 128));
    assert!(worker.lease(&app).await.is_none(), "nothing is rendered before");

    let path = format!("/api/v1/leases/{}/units/{}", lease.id, unit.id);
    refused(&put(&app, &path, compress(b"{}")).await, 422, "invalid", None, "missing field");
    assert_eq!(job(&app, id).await.plan, None);
    let again = worker.lease(&app).await.unwrap();
    assert_eq!((&again.units, again.settings.method.direct), (&lease.units, Direct::Auto));
    let method = common::method::Method {
        direct: Direct::Light,
        // Not the worker's to choose.
        max_depth: 1,
        ..again.settings.method.clone()
    };
    let (facts, kernel) = (Facts { lights: 2, ..Facts::default() }, vec!["made up".into()]);
    let plan = MethodPlan { facts, chosen: "light".into(), method, kernel, untried: None, considered: Vec::new() };
    let sent = serde_json::to_vec(&Preparation { plan: plan.clone(), cpu_seconds: 0.5 }).unwrap();
    let path = format!("/api/v1/leases/{}/units/{}", again.id, unit.id);
    for counted in [true, false] {
        let answer = put(&app, &path, compress(&sent)).await;
        assert_eq!((answer.status, answer.json()["counted"].as_bool()), (StatusCode::OK, Some(counted)));
    }
    let seen = job(&app, id).await;
    assert_eq!((seen.method.direct, seen.method.max_depth), (Direct::Light, 16));
    assert_eq!(seen.plan.unwrap().facts, plan.facts);
    drop(app);
    let app = open(folder.path()).await;
    let worker = Worker::register(&app, "b").await;
    let lease = worker.lease(&app).await.unwrap();
    assert!(lease.units.iter().all(|unit| matches!(unit.work, Work::Uniform { .. })), "{lease:?}");
    assert_eq!(lease.settings.method.direct, Direct::Light, "also after a restart");
    worker.work(&app, usize::MAX).await;

    let named = submit(&app, body(json!({ "direct": "mis" }))).await.id;
    call(&app, Method::POST, &format!("/api/v1/jobs/{id}/cancel"), Body::empty()).await;
    let lease = worker.lease(&app).await.unwrap();
    assert!(lease.units.iter().all(|unit| unit.id.job == named && matches!(unit.work, Work::Uniform { .. })));
}
