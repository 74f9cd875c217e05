//! What every store must do. Each implementation is put through the same suite.

use std::collections::BTreeMap;

use common::{
    hash::AssetHash,
    job::{Frames, JobState, LeaseId, Quality},
    method::Method,
    protocol::{Register, UnitId},
};

use super::*;
use crate::plan::{
    Rule,
    budget::{Aim, Round},
};

fn job(id: u64) -> JobRecord {
    JobRecord {
        id: JobId(id),
        name: format!("job {id}"),
        scene: AssetHash::of(b"scene"),
        frames: Frames::default(),
        resolution: [64, 32],
        region: Rect::frame(64, 32),
        tile: 32,
        quality: Quality::Samples { samples: 64 },
        method: Method::default(),
        prepare: None,
        plan: None,
        rule: Rule::Uniform { samples: 64, batch: 16 },
        priority: 50,
        tags: vec!["a".into()],
        seed: u64::MAX,
        state: JobState::Queued,
        message: None,
        tracer: None,
        created_at: "2026-01-01T00:00:00Z".into(),
        finished_at: None,
        done: None,
        rounds: BTreeMap::from([(2, Round { pass: 3, aim: Aim { level: 0.1, worst: 2.0 } })]),
        began: Some(1.5),
        ended: None,
        forecasts: Vec::new(),
        curve: Vec::new(),
        failures: Vec::new(),
        request: None,
        once: None,
    }
}

fn key(job: u64, frame: u32, tile: u32) -> TileKey {
    TileKey { job: JobId(job), frame, tile }
}

fn tile(key: TileKey, passes: u32) -> Write {
    let record = TileRecord { passes, share: 0.1 + 0.2, worker: Some(WorkerId(7)), ..TileRecord::default() };
    let film = Bytes::from(vec![passes as u8; 10]);
    Write::Tile { key, record: Box::new(record), film, ring: (passes > 1).then(|| Bytes::from_static(b"ring")) }
}

fn part(key: TileKey, pass: u32, y: u32, result: &'static [u8]) -> Write {
    Write::Part { key, pass, rect: Rect { x: 0, y, w: 32, h: 8 }, split: 256, result: Bytes::from_static(result) }
}

/// The suite. `reopen` gives the same store again, as after a restart.
async fn conforms<S: Store>(store: S, reopen: impl AsyncFn(S) -> S) {
    let first = store.begin().await.unwrap();
    assert_eq!((first.epoch, first.next_job, first.jobs.len()), (1, 1, 0));

    // Jobs come back as they were written last, oldest first; numbers are not given twice.
    store.write(Write::Job(Box::new(job(2)))).await.unwrap();
    store.write(Write::Job(Box::new(job(1)))).await.unwrap();
    let changed = JobRecord { state: JobState::Active, tracer: Some("t".into()), done: Frames::of([1, 2]), ..job(2) };
    store.write(Write::Job(Box::new(changed.clone()))).await.unwrap();
    let store = reopen(store).await;
    let snapshot = store.begin().await.unwrap();
    assert_eq!(snapshot.jobs, [job(1), changed]);
    assert_eq!((snapshot.epoch, snapshot.next_job), (2, 3));

    // A tile keeps its furthest pass, whatever order writes come in.
    let a = key(1, 1, 0);
    assert!(store.film(a).await.unwrap().is_none());
    store.write(tile(a, 1)).await.unwrap();
    store.write(tile(a, 2)).await.unwrap();
    store.write(tile(a, 1)).await.unwrap();
    let held = store.film(a).await.unwrap().unwrap();
    assert_eq!((held.record.passes, &held.film[..], held.ring.as_deref()), (2, &[2; 10][..], Some(&b"ring"[..])));
    assert_eq!(held.record.share.to_bits(), (0.1f64 + 0.2).to_bits(), "numbers keep their bits");

    // Tiles of a job, in order; finished and reopened.
    store.write(tile(key(1, 2, 0), 1)).await.unwrap();
    store.write(tile(key(1, 1, 3), 1)).await.unwrap();
    store.write(tile(key(2, 1, 0), 1)).await.unwrap();
    let keys = |tiles: &[StoredTile]| tiles.iter().map(|tile| tile.key).collect::<Vec<_>>();
    let tiles = store.tiles(JobId(1)).await.unwrap();
    assert_eq!(keys(&tiles), [a, key(1, 1, 3), key(1, 2, 0)]);
    store.write(Write::Finished(a)).await.unwrap();
    let tiles = store.tiles(JobId(1)).await.unwrap();
    assert_eq!((tiles[0].record.finished, tiles[0].record.share, tiles[1].record.finished), (true, 1.0, false));
    let summary = TileSummary { pixels: 7, errors: vec![(480, 7)], ..TileSummary::default() };
    store.write(Write::Summaries(vec![(a, summary.clone()), (key(9, 1, 0), summary.clone())])).await.unwrap();
    let tiles = store.tiles(JobId(1)).await.unwrap();
    assert_eq!(keys(&tiles), [a, key(1, 1, 3), key(1, 2, 0)], "an unknown tile is not made");
    assert_eq!((&tiles[0].record.summary, tiles[0].record.finished), (&summary, true));
    store.write(Write::Reopen(JobId(1))).await.unwrap();
    assert!(!store.tiles(JobId(1)).await.unwrap()[0].record.finished);

    // Parts, the first of each place, until their pass is merged.
    store.write(part(a, 2, 8, b"lower")).await.unwrap();
    store.write(part(a, 2, 0, b"upper")).await.unwrap();
    store.write(part(a, 2, 0, b"again")).await.unwrap();
    let store = reopen(store).await;
    let parts = store.parts(JobId(1)).await.unwrap();
    assert_eq!(
        parts.iter().map(|p| (p.key, p.pass, p.rect.y, p.split)).collect::<Vec<_>>(),
        [(a, 2, 0, 256), (a, 2, 8, 256)]
    );
    let results = store.results(a, 2).await.unwrap();
    assert_eq!(
        results.iter().map(|(rect, result)| (rect.y, &result[..])).collect::<Vec<_>>(),
        [(0, &b"upper"[..]), (8, b"lower")]
    );
    assert!(store.results(a, 1).await.unwrap().is_empty());
    store.write(tile(a, 3)).await.unwrap();
    assert!(store.parts(JobId(1)).await.unwrap().is_empty());

    // Another round of a frame, and of no other.
    store.write(part(a, 3, 0, b"late")).await.unwrap();
    store.write(Write::Finished(a)).await.unwrap();
    store.write(Write::Resume { job: JobId(1), frame: 1, passes: 9 }).await.unwrap();
    let tiles = store.tiles(JobId(1)).await.unwrap();
    let state = |tile: &StoredTile| (tile.record.passes, tile.record.finished, tile.record.fresh);
    assert_eq!((state(&tiles[0]), state(&tiles[1])), ((9, false, true), (9, false, true)));
    assert!(tiles[2].record.passes < 9 && !tiles[2].record.fresh);
    assert!(store.parts(JobId(1)).await.unwrap().is_empty());

    // A deleted job takes everything with it, and late writes do not bring it back.
    store.write(Write::DeleteJob(JobId(2))).await.unwrap();
    store.write(tile(key(2, 1, 1), 1)).await.unwrap();
    store.write(part(key(2, 1, 1), 0, 0, b"late")).await.unwrap();
    assert!(store.tiles(JobId(2)).await.unwrap().is_empty() && store.parts(JobId(2)).await.unwrap().is_empty());
    assert!(store.film(key(2, 1, 0)).await.unwrap().is_none());

    // Attempts, newest first, by what is asked for, a page at a time; the oldest of too many go.
    let attempt = |number: u64, tile: u32, outcome: Outcome| {
        let unit = UnitId { job: JobId(1), frame: 1, tile, pass: 0, rect: Rect::frame(32, 32) };
        let view = AttemptView {
            at: "2026-01-01T00:00:00Z".into(),
            unit,
            lease: LeaseId(number),
            worker: Some(WorkerId(7)),
            outcome,
            seconds: Some(0.25),
            cpu_seconds: 0.125,
            samples: 3,
            message: None,
        };
        (number, view)
    };
    let log = async |(number, view): (u64, AttemptView)| store.write(Write::Attempt(number, Box::new(view))).await;
    let written = [
        attempt(1, 0, Outcome::Done),
        attempt(2, 3, Outcome::Failed),
        attempt(3, 3, Outcome::Done),
        attempt(5, 0, Outcome::Done),
    ];
    for attempt in written.clone() {
        log(attempt).await.unwrap();
    }
    let mut gone = attempt(6, 0, Outcome::Done);
    gone.1.unit.job = JobId(2);
    log(gone).await.unwrap();
    let all = AttemptQuery { job: JobId(1), frame: None, tile: None, outcome: None, before: None, limit: 100 };
    for (query, numbers) in [
        (all, &[5, 3, 2, 1][..]),
        (AttemptQuery { tile: Some(3), ..all }, &[3, 2]),
        (AttemptQuery { frame: Some(2), ..all }, &[]),
        (AttemptQuery { outcome: Some(Outcome::Done), limit: 2, ..all }, &[5, 3]),
        (AttemptQuery { before: Some(3), frame: Some(1), ..all }, &[2, 1]),
        (AttemptQuery { job: JobId(2), ..all }, &[]),
    ] {
        let found = store.attempts(query).await.unwrap();
        let expected: Vec<_> = numbers.iter().map(|n| written.iter().find(|w| w.0 == *n).unwrap().clone()).collect();
        assert_eq!(found, expected, "{query:?}");
    }
    let most = KEPT_ATTEMPTS as u64;
    for number in 6..=most + TRIMMED_EVERY {
        let (number, view) = attempt(number, 0, Outcome::Late);
        drop(store.write(Write::Attempt(number, Box::new(view))));
    }
    store.write(Write::Barrier).await.unwrap();
    let kept = store.attempts(AttemptQuery { limit: usize::MAX >> 1, ..all }).await.unwrap();
    assert!((most..most + TRIMMED_EVERY).contains(&(kept.len() as u64)), "{}", kept.len());
    assert_eq!(kept[0].0, most + TRIMMED_EVERY);

    // Moments come back in order, without those that are too old.
    let moment =
        |at: f64| FarmMoment { at, units_pending: 1, units_leased: 2, samples_per_second: 0.1 + 0.2, busy: 0.5 };
    store.write(Write::Moments(vec![moment(1.0), moment(2.0)], 0.0)).await.unwrap();
    store.write(Write::Moments(vec![moment(3.5)], 2.0)).await.unwrap();

    // Workers come back as they were written last.
    let register = Register {
        machine: "m".into(),
        threads: 3,
        cpu_features: vec!["avx2".into()],
        tracer: "t".into(),
        nonce: "n".into(),
    };
    let worker = WorkerRecord { register, units: 1, failures: 2, disabled: true, seen_at: "now".into() };
    store.write(Write::Worker(WorkerId(4), Box::new(WorkerRecord { units: 0, ..worker.clone() }))).await.unwrap();
    store.write(Write::Worker(WorkerId(4), Box::new(worker.clone()))).await.unwrap();

    // Writes stand although nobody waits for them, in the order of the calls.
    for i in 0..100 {
        drop(store.write(Write::Job(Box::new(JobRecord { seed: i, ..job(5) }))));
    }
    store.write(Write::Barrier).await.unwrap();
    let store = reopen(store).await;
    let last = store.begin().await.unwrap();
    assert_eq!(last.workers, [(WorkerId(4), worker)]);
    assert_eq!(last.moments, [moment(2.0), moment(3.5)]);
    assert_eq!(last.jobs.iter().map(|job| (job.id.0, job.seed)).collect::<Vec<_>>(), [(1, u64::MAX), (5, 99)]);
    assert_eq!(last.next_job, 6);
    store.close().await.unwrap();
}

#[tokio::test]
async fn memory_conforms() {
    conforms(MemoryStore::default(), async |store| store).await;
}

#[tokio::test]
async fn sqlite_conforms() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("store.sqlite");
    let store = SqliteStore::open(&path).await.unwrap();
    conforms(store, async |store: SqliteStore| {
        store.close().await.unwrap();
        assert!(matches!(store.write(Write::Barrier).await, Err(StoreError::Closed)));
        SqliteStore::open(&path).await.unwrap()
    })
    .await;
}

#[tokio::test]
async fn what_sqlite_acknowledged_is_there_without_a_shutdown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("store.sqlite");
    let store = SqliteStore::open(&path).await.unwrap();
    store.begin().await.unwrap();
    store.write(Write::Job(Box::new(job(1)))).await.unwrap();
    store.write(tile(key(1, 1, 0), 1)).await.unwrap();
    // Copied as a kill would leave it: the log is not folded into the file.
    let copy = folder.path().join("copy.sqlite");
    for end in ["", "-wal"] {
        std::fs::copy(format!("{}{end}", path.display()), format!("{}{end}", copy.display())).unwrap();
    }
    let after = SqliteStore::open(&copy).await.unwrap();
    assert_eq!(after.begin().await.unwrap().jobs, [job(1)]);
    assert_eq!(after.tiles(JobId(1)).await.unwrap().len(), 1);
}

#[tokio::test]
async fn a_file_that_is_no_store_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("store.sqlite");
    std::fs::write(&path, b"this is not a database, and long enough to be read as one".repeat(100)).unwrap();
    assert!(SqliteStore::open(&path).await.is_err());
}
