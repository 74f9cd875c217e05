//! What all routes have in common, and what the dashboard asks for: tags, ids, repeated submissions, charts, numbers.

mod support;

use std::collections::{BTreeMap, BTreeSet};

use axum::{
    body::Body,
    http::{Method, Request, StatusCode, header},
};
use common::{
    hash::AssetHash,
    protocol::{AttemptList, Convergence, FailureList, FarmView, Outcome, ShippedScenes, Stored, TileView, WorkerList},
};
use coordinator::App;
use serde_json::{Value, json};
use support::{Answer, Worker, call, fixed, fresh, get, job, open, post, render, scene, submit, whole};

async fn ask(app: &App, method: Method, path: &str, headers: &[(&str, &str)], body: &Value) -> Answer {
    let request = headers.iter().fold(Request::builder().method(method).uri(path), |r, (name, v)| r.header(*name, *v));
    whole(support::send(app, request.body(Body::from(body.to_string())).unwrap()).await).await
}

#[tokio::test]
async fn a_submission_that_is_repeated_makes_no_second_job() {
    let (folder, app) = fresh().await;
    let again = async |app: &App, key: &str, body: &Value| {
        ask(app, Method::POST, "/api/v1/jobs", &[("idempotency-key", key)], body).await
    };
    let first = again(&app, "once", &fixed()).await;
    assert_eq!((first.status, first.json()["id"].as_str()), (StatusCode::CREATED, Some("j1")));
    let second = again(&app, "once", &fixed()).await;
    assert_eq!((second.status, second.json()["id"].as_str()), (StatusCode::OK, Some("j1")));
    assert_eq!(second.headers[header::LOCATION], "/api/v1/jobs/j1");
    let mut other = fixed();
    other["seed"] = json!(1);
    let refused = again(&app, "once", &other).await;
    assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY);
    let (code, message, field) = refused.error();
    assert_eq!((code.as_str(), field.as_deref()), ("invalid", Some("Idempotency-Key")));
    assert!(message.contains("j1"), "{message}");
    assert_eq!(again(&app, "twice", &fixed()).await.json()["id"], "j2");
    assert_eq!(again(&app, "", &fixed()).await.status, StatusCode::UNPROCESSABLE_ENTITY);

    // Two that come together make one, and a restart forgets nothing.
    let body = fixed();
    let (a, b) = tokio::join!(again(&app, "both", &body), again(&app, "both", &body));
    assert_eq!((&a.json()["id"], &b.json()["id"]), (&json!("j3"), &json!("j3")));
    app.service.close().await;
    drop(app);
    let app = open(folder.path()).await;
    assert_eq!(again(&app, "once", &fixed()).await.json()["id"], "j1");
}

#[tokio::test]
async fn requests_have_ids_that_reach_the_worker() {
    let (_folder, app) = fresh().await;
    let path = "/api/v1/jobs";
    let named = ask(&app, Method::POST, path, &[("x-request-id", "mine-7")], &fixed()).await;
    assert_eq!(named.headers["x-request-id"], "mine-7");
    assert_eq!(named.json()["request"], "mine-7");
    let unnamed = ask(&app, Method::POST, path, &[("x-request-id", "not a name")], &fixed()).await;
    let given = unnamed.headers["x-request-id"].to_str().unwrap().to_owned();
    assert!(given.starts_with('r') && given != "not a name", "{given}");
    assert_ne!(get(&app, path).await.headers["x-request-id"].to_str().unwrap(), given);
    let lease = Worker::register(&app, "a").await.lease(&app).await.unwrap();
    assert_eq!(lease.request.as_deref(), Some("mine-7"));
}

#[tokio::test]
async fn what_a_client_has_is_not_sent_again() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let bytes = b"some bytes";
    let asset = format!("/api/v1/assets/{}", AssetHash::of(bytes));
    support::put(&app, &asset, &bytes[..]).await;
    for path in ["/api/v1/jobs", "/api/v1/jobs/j1", "/api/v1/jobs/j1/convergence.svg", "/", "/ui/page.css", &asset] {
        let first = get(&app, path).await;
        let tag = first.headers[header::ETAG].to_str().unwrap().to_owned();
        let again = ask(&app, Method::GET, path, &[("if-none-match", &tag)], &json!({})).await;
        assert_eq!((again.status, again.body.len()), (StatusCode::NOT_MODIFIED, 0), "{path}");
        let other = ask(&app, Method::GET, path, &[("if-none-match", "\"other\"")], &json!({})).await;
        assert_eq!((other.status, other.body), (StatusCode::OK, first.body), "{path}");
    }
    let before = get(&app, "/api/v1/jobs/j1").await.headers[header::ETAG].clone();
    post(&app, "/api/v1/jobs/j1/pause", &json!({})).await;
    assert_ne!(get(&app, "/api/v1/jobs/j1").await.headers[header::ETAG], before);
    assert!(!post(&app, "/api/v1/jobs/j1/resume", &json!({})).await.headers.contains_key(header::ETAG));
}

#[tokio::test]
async fn the_error_of_a_job_is_kept_as_it_falls_and_drawn() {
    let (folder, app) = fresh().await;
    let mut body = fixed();
    body["quality"] = json!({ "target": "noise", "relative_error": 0.2, "max_samples": 256 });
    submit(&app, body).await;
    let path = "/api/v1/jobs/j1/convergence.json";
    let empty: Convergence = get(&app, path).await.read();
    assert_eq!((empty.points.len(), empty.target, empty.forecast), (0, Some(0.2), None));
    assert!(get(&app, "/api/v1/jobs/j1/convergence.svg").await.text().contains("nothing is measured"));
    Worker::register(&app, "a").await.work(&app, usize::MAX).await;
    // Points are kept as time passes for the service.
    let last = loop {
        let found: Convergence = get(&app, path).await.read();
        let done = job(&app, "j1").await;
        if found.points.last().is_some_and(|p| p.cpu_seconds == done.statistics.cpu_seconds) {
            break found;
        }
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    };
    assert_eq!(last.forecast, None, "what is over has no forecast");
    assert_eq!(Some(last.points.last().unwrap().error), job(&app, "j1").await.error);
    assert!(last.points.windows(2).all(|p| p[0].cpu_seconds <= p[1].cpu_seconds));
    let svg = get(&app, "/api/v1/jobs/j1/convergence.svg").await;
    assert_eq!(svg.headers[header::CONTENT_TYPE], "image/svg+xml");
    assert!(svg.text().starts_with("<svg") && svg.text().contains("target 20%"));
    app.service.close().await;
    drop(app);
    let app = open(folder.path()).await;
    assert_eq!(get(&app, path).await.read::<Convergence>(), last, "a restart keeps it");
}

#[tokio::test]
async fn attempts_that_came_to_nothing_say_why() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let unit = &lease.units[0];
    let report =
        json!({ "worker": worker.id, "units": [unit.id], "cause": "failed", "message": "<b>out of memory</b>" });
    post(&app, &format!("/api/v1/leases/{}/fail", lease.id), &report).await;
    let found: FailureList = get(&app, "/api/v1/jobs/j1/failures").await.read();
    let failure = &found.failures[0];
    assert_eq!(found.failures.len(), 1);
    assert_eq!((failure.tile, failure.pass, failure.worker.to_string()), (unit.id.tile, 0, worker.id));
    assert_eq!((failure.cause.as_str(), failure.message.as_str()), ("failed", "<b>out of memory</b>"));
    let tiles = get(&app, "/api/v1/jobs/j1/frames/1/tiles").await.json();
    let tile: TileView = serde_json::from_value(tiles["tiles"][unit.id.tile as usize].clone()).unwrap();
    assert_eq!((tile.attempts, tile.message.as_deref()), (1, Some("<b>out of memory</b>")));
    assert_eq!(get(&app, "/api/v1/jobs/j9/failures").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn workers_tell_what_they_work_on_and_the_farm_how_much_there_is() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let list: WorkerList = get(&app, "/api/v1/workers").await.read();
    let view = list.workers[0].lease.unwrap();
    assert_eq!((view.id, view.job.to_string(), view.frame), (lease.id, "j1".into(), 1));
    assert_eq!(view.units, lease.units.len() as u64);
    assert_eq!(job(&app, "j1").await.workers_now, 1);
    let farm: FarmView = get(&app, "/api/v1/farm").await.read();
    assert_eq!(farm.units_leased, lease.units.len() as u64);
    assert_eq!(farm.units_pending, 12 - farm.units_leased);
    assert_eq!(
        (farm.jobs, farm.workers),
        (BTreeMap::from([("active".into(), 1)]), BTreeMap::from([("busy".into(), 1)]))
    );
    for chart in ["queue", "throughput", "busy"] {
        assert!(get(&app, &format!("/api/v1/farm/{chart}.svg")).await.text().starts_with("<svg"), "{chart}");
    }
    assert_eq!(get(&app, "/api/v1/farm/other.svg").await.status, StatusCode::NOT_FOUND);
    for unit in &lease.units {
        worker.hand_in(&app, &lease, unit).await;
    }
    let list: WorkerList = get(&app, "/api/v1/workers").await.read();
    assert!(list.workers[0].lease.is_none());
    assert!(list.workers[0].samples_per_second_before > 0.0);
}

#[tokio::test]
async fn files_without_a_name_and_shipped_scenes_can_be_submitted() {
    let (_folder, app) = fresh().await;
    let text = scene().to_string();
    let stored = call(&app, Method::POST, "/api/v1/assets", text.clone()).await;
    assert_eq!(stored.status, StatusCode::CREATED);
    let Stored { hash, size } = stored.read();
    assert_eq!((hash, size), (AssetHash::of(text.as_bytes()), text.len() as u64));
    submit(&app, json!({ "scene": { "asset": hash } })).await;
    let shipped: ShippedScenes = get(&app, "/api/v1/scenes").await.read();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes");
    let count = std::fs::read_dir(folder)
        .unwrap()
        .filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|e| e == "json"));
    assert_eq!(shipped.scenes.len(), count.count());
    for scene in shipped.scenes {
        let job = submit(&app, json!({ "scene": { "asset": scene.scene } })).await;
        assert_eq!((job.name, job.resolution, job.quality), (scene.name, scene.resolution, scene.quality));
    }
}

#[tokio::test]
async fn pixels_are_the_numbers_that_the_workers_sent() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let path = "/api/v1/jobs/j1/frames/1/pixels";
    assert!(get(&app, &format!("{path}?tiles=0,1,2")).await.body.is_empty(), "nothing is rendered");
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let unit = &lease.units[0];
    worker.hand_in(&app, &lease, unit).await;
    let moments = render(&lease.settings, unit).film.moments;
    let tile = unit.id.tile;
    let body = get(&app, &format!("{path}?tiles={tile}")).await.body;
    let number = |at: usize| u32::from_le_bytes(body[4 * at..4 * at + 4].try_into().unwrap());
    let rect = unit.id.rect;
    assert_eq!([0, 1, 2, 3, 4, 5].map(number), [tile, rect.x, rect.y, rect.w, rect.h, 1]);
    assert_eq!(body.len(), 24 + 6 * rect.area());
    let first = half::f16::from_le_bytes([body[24], body[25]]);
    assert_eq!(first, half::f16::from_f64(moments[0].mean[0]));
    let floats = async |map: &str| -> Vec<f32> {
        let body = get(&app, &format!("{path}?tiles={tile}&map={map}")).await.body;
        body[24..].chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
    };
    let samples = floats("samples").await;
    assert_eq!((samples.len(), samples[0]), (rect.area(), moments[0].samples as f32));
    let errors = floats("error").await;
    assert!(errors.len() == rect.area() && errors.iter().all(|&error| error > 0.0));
    for bad in
        ["", "?tiles=", "?tiles=a", "?tiles=1&map=depth", "?tiles=1&x=2", &format!("?tiles={}", "1,".repeat(64) + "1")]
    {
        assert_eq!(get(&app, &format!("{path}{bad}")).await.status, StatusCode::UNPROCESSABLE_ENTITY, "{bad}");
    }
}

#[tokio::test]
async fn thumbnails_are_small_and_change_with_the_image() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let path = "/api/v1/jobs/j1/frames/1/image.png?width=20";
    let width = |answer: &Answer| u32::from_be_bytes(answer.body[16..20].try_into().unwrap());
    let before = get(&app, path).await;
    assert_eq!(width(&before), 20);
    Worker::register(&app, "a").await.work(&app, usize::MAX).await;
    let after = get(&app, path).await;
    assert_ne!((&after.headers[header::ETAG], &after.body), (&before.headers[header::ETAG], &before.body));
    assert_eq!(width(&get(&app, "/api/v1/jobs/j1/frames/1/image.png?width=500").await), 100, "nothing is blown up");
    for bad in ["image.png?width=5", "image.png?width=x", "samples.png?width=20"] {
        let answer = get(&app, &format!("/api/v1/jobs/j1/frames/1/{bad}")).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{bad}");
    }
}

#[tokio::test]
async fn the_api_can_be_browsed_without_another_host() {
    let (_folder, app) = fresh().await;
    let moved = get(&app, "/docs").await;
    assert_eq!(
        (moved.status, moved.headers[header::LOCATION].to_str().unwrap()),
        (StatusCode::PERMANENT_REDIRECT, "docs/")
    );
    let page = get(&app, "/docs/").await;
    assert_eq!(page.status, StatusCode::OK);
    let policy = page.headers[header::CONTENT_SECURITY_POLICY].to_str().unwrap();
    assert!(policy.starts_with("default-src 'none'") && !policy.contains("http"), "{policy}");
    for name in ["swagger-ui.css", "swagger-ui-bundle.js", "swagger-initializer.js"] {
        assert_eq!(get(&app, &format!("/docs/{name}")).await.status, StatusCode::OK, "{name}");
    }
    let described = get(&app, "/api/v1/openapi.json").await.json();
    assert_eq!(described, coordinator::http::openapi());
    // Every route that it names is there: what it may answer to a name that does not exist, it does.
    for (path, item) in described["paths"].as_object().unwrap() {
        let real = path.replace("{id}", "x").replace("{frame}", "1").replace(['{', '}'], "");
        for method in item.as_object().unwrap().keys() {
            let method = method.to_uppercase().parse().unwrap();
            if path.ends_with("/events") {
                continue;
            }
            let answer = call(&app, method, &real, Body::empty()).await;
            assert_ne!(answer.status, StatusCode::METHOD_NOT_ALLOWED, "{path}");
            assert!(!answer.text().contains("no such route"), "{path}");
        }
    }
    assert_eq!(get(&app, "/docs/other.js").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn every_attempt_at_a_unit_is_told_and_kept() {
    let (folder, app) = fresh().await;
    submit(&app, fixed()).await;
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let (first, rest) = lease.units.split_first().unwrap();
    worker.hand_in(&app, &lease, first).await;
    worker.hand_in(&app, &lease, first).await;
    let failed: Vec<_> = rest.iter().map(|unit| unit.id).collect();
    let body = json!({ "worker": worker.id, "units": failed, "cause": "failed", "message": "no memory" });
    assert!(post(&app, &format!("/api/v1/leases/{}/fail", lease.id), &body).await.status.is_success());
    let path = "/api/v1/jobs/j1/attempts";
    let list: AttemptList = get(&app, path).await.read();
    assert_eq!(list.attempts.len(), lease.units.len() + 1);
    let done: AttemptList = get(&app, &format!("{path}?outcome=done")).await.read();
    let one = &done.attempts[0];
    assert_eq!((done.attempts.len(), one.unit, one.lease), (1, first.id, lease.id));
    assert_eq!(one.worker.map(|id| id.to_string()).as_deref(), Some("w1"));
    assert!(one.seconds.is_some_and(|s| (0.0..60.0).contains(&s)) && one.samples > 0 && one.message.is_none());
    let tile = format!("{path}?frame=1&tile={}", first.id.tile);
    let of_tile: AttemptList = get(&app, &tile).await.read();
    let outcomes: Vec<Outcome> = of_tile.attempts.iter().map(|attempt| attempt.outcome).collect();
    assert_eq!(outcomes, [Outcome::Late, Outcome::Done], "newest first");
    let bad: AttemptList = get(&app, &format!("{path}?outcome=failed&limit=2")).await.read();
    assert!(bad.attempts.iter().all(|attempt| attempt.message.as_deref() == Some("no memory")));
    // A page follows another until there is none.
    let (mut seen, mut cursor) = (0, String::new());
    loop {
        let page: AttemptList = get(&app, &format!("{path}?limit=2&cursor={cursor}")).await.read();
        seen += page.attempts.len();
        let Some(next) = page.next else { break };
        cursor = next;
    }
    assert_eq!(seen, list.attempts.len());
    for (query, field) in
        [("outcome=good", "outcome"), ("limit=0", "limit"), ("cursor=x", "cursor"), ("what=1", "what")]
    {
        let refused = get(&app, &format!("{path}?{query}")).await;
        assert_eq!(refused.error().2.as_deref(), Some(field), "{}", refused.text());
    }
    assert_eq!(get(&app, "/api/v1/jobs/j9/attempts").await.status, StatusCode::NOT_FOUND);

    // A restart forgets none, and later ones come before.
    app.service.close().await;
    drop(app);
    let app = open(folder.path()).await;
    let again: AttemptList = get(&app, path).await.read();
    assert_eq!(again, list);
    let worker = Worker::register(&app, "b").await;
    worker.work(&app, 1).await;
    let later: AttemptList = get(&app, path).await.read();
    assert_eq!((later.attempts.len(), later.attempts[0].outcome), (list.attempts.len() + 1, Outcome::Done));
    assert_eq!(later.attempts[1..], list.attempts);
}

#[tokio::test]
async fn a_file_of_another_format_is_a_job_that_workers_import() {
    let (_folder, app) = fresh().await;
    let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let import = |assets: Value| json!({ "scene": { "import": "t.obj", "assets": assets }, "resolution": [64, 64] });
    let refused = post(&app, "/api/v1/jobs", &import(json!({}))).await;
    assert_eq!(refused.error().2.as_deref(), Some("scene.import"));
    let hash = AssetHash::of(mesh.as_bytes());
    let missing = post(&app, "/api/v1/jobs", &import(json!({ "t.obj": hash }))).await;
    assert_eq!((missing.status, &missing.json()["error"]["missing"]), (StatusCode::CONFLICT, &json!([hash])));
    let stored: Stored = call(&app, Method::POST, "/api/v1/assets", mesh).await.read();
    let job = submit(&app, import(json!({ "t.obj": stored.hash }))).await;
    assert_eq!((job.name.as_str(), job.resolution), ("t.obj", [64, 64]));
    // What a worker fetches as the scene is what was asked for, and makes the same job again.
    let lease = Worker::register(&app, "a").await.lease(&app).await.unwrap();
    let kept = get(&app, &format!("/api/v1/assets/{}", lease.scene)).await;
    assert_eq!(kept.json(), json!({ "import": "t.obj", "assets": { "t.obj": hash } }));
    let again = submit(&app, json!({ "scene": { "asset": lease.scene } })).await;
    assert_eq!((again.name.as_str(), again.resolution), ("t.obj", [512, 512]));
}

#[tokio::test]
async fn the_past_of_the_farm_outlives_the_coordinator() {
    let (folder, app) = fresh().await;
    let moments = async |app: &App| -> FarmView { get(app, "/api/v1/farm").await.read() };
    // The first is noted at once.
    let mut before = moments(&app).await.history;
    while before.is_empty() {
        tokio::task::yield_now().await;
        before = moments(&app).await.history;
    }
    app.service.close().await;
    drop(app);
    let app = open(folder.path()).await;
    let after = moments(&app).await.history;
    assert_eq!(after[..before.len()], before);
    for chart in ["queue", "throughput", "busy"] {
        let drawn = get(&app, &format!("/api/v1/farm/{chart}.svg")).await.text();
        assert!(drawn.contains("prefers-color-scheme:dark"), "{chart}");
    }
}

/// What the dashboard for Grafana asks for is there, by the very names.
#[tokio::test]
async fn grafana_asks_for_metrics_that_exist() {
    let (_folder, app) = fresh().await;
    submit(&app, fixed()).await;
    Worker::register(&app, "a").await;
    let text = get(&app, "/metrics").await.text();
    let known: BTreeSet<&str> =
        text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()).collect();
    let dashboard: Value = serde_json::from_str(include_str!("../../deploy/grafana-dashboard.json")).unwrap();
    fn queries<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
        match value {
            Value::Object(map) => {
                found.extend(map.get("expr").and_then(Value::as_str));
                map.values().for_each(|value| queries(value, found));
            }
            Value::Array(list) => list.iter().for_each(|value| queries(value, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    queries(&dashboard, &mut found);
    assert!(found.len() > 10);
    for query in found {
        let names = query.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let names: Vec<&str> = names.filter(|name| name.starts_with("tessera_")).collect();
        assert!(!names.is_empty(), "{query}");
        for name in names {
            assert!(known.contains(name), "{query}: there is no {name}");
            // By Prometheus' conventions a counter is one, by its name and by its use.
            let counts = text.contains(&format!("# TYPE {name} counter"));
            assert_eq!(counts, name.ends_with("_total"), "{name}");
            assert_eq!(counts, query.contains(&format!("rate({name}[")), "{query}");
        }
    }
}
