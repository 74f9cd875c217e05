//! Whole jobs through the routes, with made-up pixels: from submission to the same bytes, whatever happens
//! in between.

mod support;

use axum::http::StatusCode;
use common::job::JobState;
use serde_json::json;
use support::{Worker, get, job, open, scene, submit};

const JOB: &str = "/api/v1/jobs/j1";

/// The EXR of frame 1 after a quiet run with one worker.
async fn undisturbed(body: &serde_json::Value) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let app = open(folder.path()).await;
    submit(&app, body.clone()).await;
    Worker::register(&app, "only").await.work(&app, usize::MAX).await;
    assert_eq!(job(&app, "j1").await.state, JobState::Completed);
    let exr = get(&app, &format!("{JOB}/frames/1/image.exr")).await;
    assert_eq!(exr.status, StatusCode::OK);
    exr.body.to_vec()
}

fn fixed(samples: u32) -> serde_json::Value {
    json!({ "scene": scene(), "tile": 32, "quality": { "target": "samples", "samples": samples } })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_goes_through_the_farm() {
    let folder = tempfile::tempdir().unwrap();
    let app = open(folder.path()).await;
    let view = submit(&app, fixed(64)).await;
    assert_eq!((view.state, view.resolution, view.progress), (JobState::Queued, [100, 70], 0.0));
    let worker = Worker::register(&app, "a").await;
    let units = worker.work(&app, usize::MAX).await;
    // 4 x 3 tiles, passes of 16 and 48 samples; tiles may have been split.
    assert!(units >= 24, "{units}");
    let view = job(&app, "j1").await;
    assert_eq!((view.state, view.progress, view.samples), (JobState::Completed, 1.0, 7000 * 64));
    assert_eq!(view.statistics.rays, 3 * 7000 * 64);
    assert!(view.finished_at.is_some() && view.error.is_some());
    for (name, magic) in [
        ("image.png", &b"\x89PNG"[..]),
        ("samples.png", b"\x89PNG"),
        ("error.png", b"\x89PNG"),
        ("image.exr", b"\x76\x2f\x31\x01"),
        ("samples.exr", b"\x76\x2f\x31\x01"),
        ("error.exr", b"\x76\x2f\x31\x01"),
    ] {
        let answer = get(&app, &format!("{JOB}/frames/1/{name}")).await;
        assert_eq!(answer.status, StatusCode::OK, "{name}");
        assert!(answer.body.starts_with(magic), "{name}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_crash_in_the_middle_loses_nothing_acknowledged_and_no_bit() {
    let body = fixed(256);
    let expected = undisturbed(&body).await;
    let folder = tempfile::tempdir().unwrap();
    let mut crashes = 0;
    let mut acknowledged = 0;
    let app = open(folder.path()).await;
    submit(&app, body).await;
    drop(app);
    loop {
        // No shutdown: the next coordinator finds what the last one left.
        let app = open(folder.path()).await;
        let before = job(&app, "j1").await;
        if before.state == JobState::Completed {
            break;
        }
        let worker = Worker::register(&app, &format!("life {crashes}")).await;
        acknowledged += worker.work(&app, 7).await;
        // Some more units are taken and never handed in.
        worker.lease(&app).await;
        crashes += 1;
        assert!(crashes < 200, "no end after {acknowledged} units");
    }
    assert!(crashes >= 5, "{crashes} crashes are no test");
    let app = open(folder.path()).await;
    let exr = get(&app, &format!("{JOB}/frames/1/image.exr")).await;
    assert!(exr.body == expected, "the picture differs after {crashes} crashes");
    assert_eq!(job(&app, "j1").await.samples, 7000 * 256);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_continued_to_more_samples_has_the_bits_of_one_that_asked_at_once() {
    let expected = undisturbed(&fixed(256)).await;
    let folder = tempfile::tempdir().unwrap();
    let app = open(folder.path()).await;
    submit(&app, fixed(64)).await;
    let worker = Worker::register(&app, "a").await;
    worker.work(&app, usize::MAX).await;
    assert_eq!(job(&app, "j1").await.state, JobState::Completed);
    let patch = json!({ "quality": { "target": "samples", "samples": 256 } });
    let answer = support::call(&app, axum::http::Method::PATCH, JOB, patch.to_string()).await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.text());
    assert_eq!(answer.json()["status"], "queued");
    let early = job(&app, "j1").await;
    assert!(early.progress < 1.0 && early.samples == 7000 * 64);
    worker.work(&app, usize::MAX).await;
    let late = job(&app, "j1").await;
    assert_eq!((late.state, late.samples), (JobState::Completed, 7000 * 256));
    let exr = get(&app, &format!("{JOB}/frames/1/image.exr")).await;
    assert!(exr.body == expected);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_default_is_a_noise_target_planned_from_the_measured_error() {
    let folder = tempfile::tempdir().unwrap();
    let app = open(folder.path()).await;
    let view = submit(&app, json!({ "scene": scene(), "frames": "1-3x2" })).await;
    assert_eq!(serde_json::to_value(&view.quality).unwrap()["target"], "noise");
    let worker = Worker::register(&app, "a").await;
    let lease = worker.lease(&app).await.unwrap();
    let pilot = serde_json::to_value(&lease.units[0].work).unwrap();
    assert_eq!((&pilot["kind"], &pilot["samples"]), (&json!("uniform"), &json!(64)));
    for unit in &lease.units {
        worker.hand_in(&app, &lease, unit).await;
    }
    worker.work(&app, usize::MAX).await;
    let view = job(&app, "j1").await;
    assert_eq!(view.state, JobState::Completed);
    assert_eq!(view.frames.iter().map(|f| f.frame).collect::<Vec<_>>(), [1, 3]);
    assert!(view.frames.iter().all(|f| f.done && f.within_target.is_some()));
}

async fn patch(app: &coordinator::App, quality: serde_json::Value) -> support::Answer {
    let body = json!({ "quality": quality }).to_string();
    support::call(app, axum::http::Method::PATCH, JOB, body).await
}

fn noise(error: f64) -> serde_json::Value {
    json!({ "target": "noise", "relative_error": error, "max_samples": 1024 })
}

async fn exr(app: &coordinator::App) -> Vec<u8> {
    get(app, &format!("{JOB}/frames/1/image.exr")).await.body.to_vec()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_noise_target_is_continued_to_a_finer_one_from_every_sample_and_through_crashes() {
    let mut pictures = Vec::new();
    for crash_after in [usize::MAX, 5] {
        let folder = tempfile::tempdir().unwrap();
        let mut app = open(folder.path()).await;
        submit(&app, json!({ "scene": scene(), "tile": 32, "quality": noise(0.3) })).await;
        Worker::register(&app, "first").await.work(&app, usize::MAX).await;
        let coarse = job(&app, "j1").await;
        assert_eq!(coarse.state, JobState::Completed);
        let coarse_picture = exr(&app).await;
        assert!(patch(&app, noise(0.4)).await.status == StatusCode::UNPROCESSABLE_ENTITY, "that is no finer");

        let answer = patch(&app, noise(0.15)).await;
        assert_eq!(answer.status, StatusCode::OK, "{}", answer.text());
        assert!(patch(&app, noise(0.14)).await.status == StatusCode::CONFLICT, "it goes on already");
        assert_eq!(job(&app, "j1").await.samples, coarse.samples, "every sample is kept");
        assert!(exr(&app).await == coarse_picture, "and so is the picture, for now");
        let mut lives = 0;
        while job(&app, "j1").await.state != JobState::Completed {
            let worker = Worker::register(&app, &format!("life {lives}")).await;
            worker.work(&app, crash_after).await;
            lives += 1;
            assert!(lives < 500, "no end");
            if crash_after != usize::MAX {
                drop(app);
                app = open(folder.path()).await;
            }
        }
        assert!((crash_after == usize::MAX) == (lives == 1), "{lives} lives");
        let fine = job(&app, "j1").await;
        assert!(fine.samples > coarse.samples && fine.error < coarse.error, "{fine:?}");
        let frame = &fine.frames[0];
        assert!(frame.within_target.unwrap() >= 0.99, "{frame:?}");
        pictures.push(exr(&app).await);
    }
    assert!(pictures[0] == pictures[1], "crashes changed the picture");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_fixed_count_is_continued_to_a_noise_target() {
    let folder = tempfile::tempdir().unwrap();
    let app = open(folder.path()).await;
    submit(&app, fixed(64)).await;
    let worker = Worker::register(&app, "a").await;
    worker.work(&app, usize::MAX).await;
    assert_eq!(patch(&app, noise(0.2)).await.status, StatusCode::OK);
    worker.work(&app, usize::MAX).await;
    let view = job(&app, "j1").await;
    assert_eq!(view.state, JobState::Completed);
    assert!(view.samples > 7000 * 64 && view.frames[0].pixels_missed.is_some(), "{view:?}");
    assert_eq!(patch(&app, json!({ "target": "samples", "samples": 4096 })).await.status.as_u16(), 422);
}

/// The made-up worker says that a sample costs 10 microseconds: the pilot of a frame takes 4.48 s.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_budget_is_spent_over_all_frames_and_what_was_spent_survives_crashes() {
    for crash_after in [usize::MAX, 9] {
        let folder = tempfile::tempdir().unwrap();
        let mut app = open(folder.path()).await;
        let quality = json!({ "target": "time", "cpu_seconds": 30, "max_samples": 4096 });
        submit(&app, json!({ "scene": scene(), "tile": 32, "frames": "1-2", "quality": quality })).await;
        let mut lives = 0;
        while job(&app, "j1").await.state != JobState::Completed {
            let worker = Worker::register(&app, &format!("life {lives}")).await;
            worker.work(&app, crash_after).await;
            worker.lease(&app).await;
            lives += 1;
            assert!(lives < 500, "no end");
            if crash_after != usize::MAX {
                drop(app);
                app = open(folder.path()).await;
            }
        }
        assert!((crash_after == usize::MAX) == (lives == 1), "{lives} lives");
        let view = job(&app, "j1").await;
        let spent = view.statistics.cpu_seconds;
        assert!((28.5..30.5).contains(&spent), "{spent} of 30 s");
        for frame in &view.frames {
            let seconds = frame.mean_samples * 7000.0 * 1e-5;
            assert!((13.5..16.0).contains(&seconds), "frame {} took {seconds} of 15 s", frame.frame);
            assert!(f64::from(frame.max_samples) > 1.2 * frame.mean_samples, "the worst pixels get more: {frame:?}");
        }
        if crash_after == usize::MAX {
            let more = patch(&app, json!({ "target": "time", "cpu_seconds": 50, "max_samples": 4096 })).await;
            assert_eq!(more.status, StatusCode::OK, "{}", more.text());
            Worker::register(&app, "more").await.work(&app, usize::MAX).await;
            let spent = job(&app, "j1").await.statistics.cpu_seconds;
            assert!((48.0..51.0).contains(&spent), "{spent} of 50 s");
        }
    }
}
