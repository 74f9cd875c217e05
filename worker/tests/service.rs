//! A worker against a coordinator that follows a script.

mod fake;

use std::time::Duration;

use common::{
    hash::AssetHash,
    job::LeaseId,
    protocol::{FailureCause, UnitId},
};
use fake::{Fake, SCENE, decode, endless, lease_of, listener, logged, short, url};
use worker::WorkerError;

#[tokio::test]
async fn results_do_not_depend_on_threads() {
    let mut films = Vec::new();
    for threads in [1, 3] {
        let (fake, running) = Fake::with_worker(|config| config.threads = threads).await;
        let scene = fake.store(SCENE.as_bytes());
        for id in 1..=3 {
            fake.offer(lease_of(id, scene, &[short(), short()], 32));
        }
        fake.wait("six results", |notes| notes.results.len() == 6).await;
        running.stop().await.unwrap();
        let notes = fake.notes();
        assert_eq!(notes.fetched, [scene], "a scene is fetched once");
        assert_eq!(notes.registered[0].threads, threads as u32);
        let mut results: Vec<(UnitId, _)> =
            notes.results.iter().map(|(_, unit, body)| (*unit, decode(*unit, body))).collect();
        results.sort_by_key(|(unit, _)| *unit);
        let loaded = results.iter().filter(|(_, result)| result.statistics.load_seconds > 0.0).count();
        assert_eq!(loaded, 1, "loading is charged to one unit");
        assert!(results.iter().all(|(_, result)| result.statistics.cpu_seconds > 0.0));
        assert!(results.iter().all(|(_, result)| result.statistics.samples == 32 * 48));
        films.push(results.into_iter().map(|(unit, result)| (unit, result.film)).collect::<Vec<_>>());
    }
    assert_eq!(films[0], films[1]);
}

#[tokio::test]
async fn a_coordinator_that_is_away_is_waited_for_and_mentioned_once() {
    let fake = Fake::default();
    let listener = listener().await;
    let url = url(&listener);
    let running = fake.worker(&url, |_| ());
    for _ in 0..4 {
        // Whoever connects is turned away without a word.
        drop(listener.accept().await.unwrap());
    }
    fake.serve(listener);
    fake.wait("a heartbeat", |notes| !notes.heartbeats.is_empty()).await;
    running.stop().await.unwrap();
    let lines = logged(&url);
    let told = |what: &str| lines.iter().filter(|line| line.contains(what)).count();
    assert_eq!(told("cannot be reached"), 1, "{lines:#?}");
    assert_eq!(told("answers again"), 1, "{lines:#?}");
}

#[tokio::test]
async fn a_forgotten_worker_registers_again_and_hands_in_what_it_has() {
    let (fake, running) = Fake::with_worker(|_| ()).await;
    let scene = fake.store(SCENE.as_bytes());
    fake.notes().forget_after = Some(LeaseId(1));
    fake.offer(lease_of(1, scene, &[short()], 16));
    fake.wait("a second registration and the result", |notes| notes.registered.len() == 2 && notes.results.len() == 1)
        .await;
    fake.offer(lease_of(2, scene, &[short()], 16));
    fake.wait("more work done", |notes| notes.results.len() == 2).await;
    running.stop().await.unwrap();
    let notes = fake.notes();
    assert_eq!(notes.registered[0].nonce, notes.registered[1].nonce, "it is the same process");
    assert_eq!(notes.results[0].0, LeaseId(1));
    assert_eq!(notes.registered.len(), 2);
}

#[tokio::test]
async fn what_cannot_be_rendered_is_reported_and_the_worker_goes_on() {
    let (fake, running) = Fake::with_worker(|_| ()).await;
    let scene = fake.store(SCENE.as_bytes());
    let absent = AssetHash::of(b"never stored");
    let broken = fake.store(b"{");
    let mesh = SCENE.replace(r#""shapes": ["#, r#""shapes": [{"type": "mesh", "file": "absent.obj"},"#);
    let without_file = fake.store(mesh.as_bytes());
    let damaged = AssetHash::of(b"one thing");
    fake.notes().assets.insert(damaged, b"another".to_vec());
    for (id, hash) in [(1, absent), (2, broken), (3, without_file), (4, damaged), (5, scene)] {
        fake.offer(lease_of(id, hash, &[short(), short()], 16));
    }
    fake.wait("the good lease and four reports", |notes| notes.results.len() == 2 && notes.failures.len() == 4).await;
    running.stop().await.unwrap();
    let mut failures = fake.notes().failures.clone();
    failures.sort_by_key(|(lease, _)| *lease);
    let expected = ["cannot be fetched", "not valid JSON", "absent.obj: not among the files", "damaged"];
    for ((_, failure), expected) in failures.iter().zip(expected) {
        assert!(failure.message.contains(expected), "{failure:?}");
        assert_eq!((failure.cause, failure.units.len()), (FailureCause::Failed, 2));
    }
}

#[tokio::test]
async fn a_cancelled_lease_stops_and_nothing_more_is_said_of_it() {
    let (fake, running) = Fake::with_worker(|_| ()).await;
    let scene = fake.store(SCENE.as_bytes());
    fake.offer(lease_of(1, scene, &[endless()], 20_000));
    let listed = |lease: u64| {
        move |notes: &fake::Notes| notes.heartbeats.last().is_some_and(|beat| beat.leases.contains(&LeaseId(lease)))
    };
    fake.wait("a heartbeat with the lease", listed(1)).await;
    fake.notes().cancelled = vec![LeaseId(1)];
    fake.offer(lease_of(2, scene, &[short()], 16));
    fake.wait("the next lease's result", |notes| notes.results.len() == 1).await;
    fake.wait("a heartbeat without leases", |notes| notes.heartbeats.last().unwrap().leases.is_empty()).await;
    running.stop().await.unwrap();
    let notes = fake.notes();
    assert_eq!(notes.results[0].0, LeaseId(2));
    assert!(notes.failures.is_empty());
}

#[tokio::test]
async fn a_worker_that_leaves_hands_back_what_it_has_not_finished() {
    let (fake, running) = Fake::with_worker(|config| config.grace = Duration::ZERO).await;
    let scene = fake.store(SCENE.as_bytes());
    fake.offer(lease_of(1, scene, &[endless(), endless()], 20_000));
    fake.offer(lease_of(2, scene, &[endless()], 20_000));
    fake.wait("a heartbeat with both leases", |notes| {
        notes.heartbeats.last().is_some_and(|beat| beat.leases.len() == 2)
    })
    .await;
    running.stop().await.unwrap();
    let notes = fake.notes();
    let mut returned: Vec<(LeaseId, usize)> = Vec::new();
    for (lease, failure) in &notes.failures {
        assert_eq!(failure.cause, FailureCause::Returned);
        returned.push((*lease, failure.units.len()));
    }
    returned.sort_unstable();
    assert_eq!(returned, [(LeaseId(1), 2), (LeaseId(2), 1)]);
    let last = notes.heartbeats.last().unwrap();
    assert!(last.draining && last.leases.is_empty(), "{last:?}");
}

#[tokio::test]
async fn a_worker_that_leaves_finishes_what_it_has_begun() {
    let (fake, running) = Fake::with_worker(|config| config.threads = 1).await;
    let scene = fake.store(SCENE.as_bytes());
    // Some ten milliseconds a row: it is in the midst of the unit when it hears that it is to leave.
    let rows = common::tile::Rect { h: 30, ..endless() };
    fake.offer(lease_of(1, scene, &[rows, endless()], 400_000));
    fake.wait("the lease is prepared", |notes| {
        notes.heartbeats.last().is_some_and(|beat| !beat.prepared.is_empty() && !beat.leases.is_empty())
    })
    .await;
    fake.notes().drain = true;
    running.ended().await.unwrap();
    let notes = fake.notes();
    let returned: usize = notes.failures.iter().map(|(_, failure)| failure.units.len()).sum();
    assert!(notes.results.len() <= 1 && returned + notes.results.len() == 2, "nothing is lost, nothing endless begun");
    assert!(notes.failures.iter().all(|(_, failure)| failure.cause == FailureCause::Returned));
}

#[tokio::test]
async fn a_worker_that_is_not_welcome_ends() {
    let fake = Fake::default();
    fake.notes().closed = true;
    let listener = listener().await;
    let url = url(&listener);
    fake.serve(listener);
    let error = fake.worker(&url, |_| ()).ended().await.unwrap_err();
    assert!(matches!(error, WorkerError::Refused { .. }), "{error}");
    assert!(error.to_string().contains(&url), "{error}");
}

#[tokio::test]
async fn files_kept_on_disk_are_not_fetched_again_unless_they_are_damaged() {
    let folder = std::env::temp_dir().join(format!("tessera-cache-{}", std::process::id()));
    let fetched = async |fake: &Fake, running: fake::Running| {
        let scene = fake.store(SCENE.as_bytes());
        fake.offer(lease_of(1, scene, &[short()], 16));
        fake.wait("a result", |notes| notes.results.len() == 1).await;
        running.stop().await.unwrap();
        fake.notes().fetched.len()
    };
    for expected in [1, 0] {
        let (fake, running) = Fake::with_worker(|config| config.cache = Some(folder.clone())).await;
        assert_eq!(fetched(&fake, running).await, expected);
    }
    let kept: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(kept.len(), 1);
    std::fs::write(&kept[0], "damaged").unwrap();
    let (fake, running) = Fake::with_worker(|config| config.cache = Some(folder.clone())).await;
    assert_eq!(fetched(&fake, running).await, 1);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[tokio::test]
async fn units_of_another_tracer_are_handed_back() {
    let (fake, running) = Fake::with_worker(|_| ()).await;
    let scene = fake.store(SCENE.as_bytes());
    let mut lease = lease_of(1, scene, &[short()], 16);
    lease.tracer = "another".into();
    fake.offer(lease);
    fake.wait("a report", |notes| notes.failures.len() == 1).await;
    running.stop().await.unwrap();
    let notes = fake.notes();
    assert_eq!(notes.failures[0].1.cause, FailureCause::Returned);
    assert!(notes.results.is_empty());
}
