//! A store that forgets everything with the process: for tests.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

use bytes::Bytes;
use common::{
    job::{JobId, WorkerId},
    protocol::{AttemptView, FarmMoment},
    tile::Rect,
};
use futures::FutureExt;

use super::{
    Answer, AttemptQuery, JobRecord, KEPT_ATTEMPTS, Snapshot, Store, StoreError, StoredFilm, StoredPart, StoredTile,
    TRIMMED_EVERY, WorkerRecord, Write,
};
use crate::farm::TileKey;

/// Tile, pass, top, left.
type PartKey = (TileKey, u32, u32, u32);

#[derive(Debug, Default)]
struct Held {
    epoch: u64,
    next_job: u64,
    jobs: BTreeMap<JobId, JobRecord>,
    workers: BTreeMap<WorkerId, WorkerRecord>,
    tiles: BTreeMap<TileKey, StoredFilm>,
    parts: BTreeMap<PartKey, (Rect, usize, Bytes)>,
    attempts: BTreeMap<(JobId, u64), AttemptView>,
    moments: Vec<FarmMoment>,
}

/// See the module's documentation.
#[derive(Debug, Clone, Default)]
pub struct MemoryStore(Arc<Mutex<Held>>);

impl MemoryStore {
    fn with<T: Send + 'static>(&self, work: impl FnOnce(&mut Held) -> T) -> Answer<T> {
        let answer = work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
        async move { Ok::<_, StoreError>(answer) }.boxed()
    }
}

impl Held {
    fn apply(&mut self, write: Write) {
        match write {
            Write::Job(record) => {
                self.next_job = self.next_job.max(record.id.0 + 1);
                self.jobs.insert(record.id, *record);
            }
            Write::DeleteJob(id) => {
                self.jobs.remove(&id);
                self.tiles.retain(|key, _| key.job != id);
                self.parts.retain(|(key, ..), _| key.job != id);
                self.attempts.retain(|(job, _), _| *job != id);
            }
            Write::Tile { key, record, film, ring } if self.jobs.contains_key(&key.job) => {
                let passes = record.passes;
                if self.tiles.get(&key).is_none_or(|held| held.record.passes < passes) {
                    self.tiles.insert(key, StoredFilm { record: *record, film, ring });
                }
                self.parts.retain(|(held, pass, ..), _| *held != key || *pass >= passes);
            }
            Write::Finished(key) => {
                if let Some(held) = self.tiles.get_mut(&key) {
                    (held.record.finished, held.record.share) = (true, 1.0);
                }
            }
            Write::Summaries(summaries) => {
                for (key, summary) in summaries {
                    if let Some(held) = self.tiles.get_mut(&key) {
                        held.record.summary = summary;
                    }
                }
            }
            Write::Reopen(id) => {
                let tiles = self.tiles.iter_mut().filter(|(key, _)| key.job == id);
                tiles.for_each(|(_, held)| held.record.finished = false);
            }
            Write::Resume { job, frame, passes } => {
                let tiles = self.tiles.iter_mut().filter(|(key, _)| key.job == job && key.frame == frame);
                for (_, StoredFilm { record, .. }) in tiles {
                    (record.passes, record.finished, record.fresh) = (passes, false, true);
                }
                self.parts.retain(|(held, ..), _| held.job != job || held.frame != frame);
            }
            Write::Part { key, pass, rect, split, result } if self.jobs.contains_key(&key.job) => {
                self.parts.entry((key, pass, rect.y, rect.x)).or_insert((rect, split, result));
            }
            Write::Attempt(number, attempt) if self.jobs.contains_key(&attempt.unit.job) => {
                let job = attempt.unit.job;
                self.attempts.insert((job, number), *attempt);
                let of_job = (job, 0)..=(job, u64::MAX);
                if number.is_multiple_of(TRIMMED_EVERY) {
                    let last =
                        self.attempts.range(of_job).rev().nth(KEPT_ATTEMPTS).map_or(0, |((_, number), _)| *number);
                    self.attempts.retain(|(other, number), _| *other != job || *number > last);
                }
            }
            Write::Moments(moments, oldest) => {
                self.moments.extend(moments);
                self.moments.retain(|moment| moment.at >= oldest);
            }
            Write::Worker(id, record) => drop(self.workers.insert(id, *record)),
            Write::Tile { .. } | Write::Part { .. } | Write::Attempt(..) | Write::Barrier => {}
        }
    }
}

impl Store for MemoryStore {
    fn begin(&self) -> Answer<Snapshot> {
        self.with(|held| {
            held.epoch += 1;
            Snapshot {
                jobs: held.jobs.values().cloned().collect(),
                workers: held.workers.iter().map(|(&id, record)| (id, record.clone())).collect(),
                next_job: held.next_job.max(1),
                epoch: held.epoch,
                moments: held.moments.clone(),
            }
        })
    }

    fn write(&self, write: Write) -> Answer<()> {
        self.with(|held| held.apply(write))
    }

    fn tiles(&self, job: JobId) -> Answer<Vec<StoredTile>> {
        self.with(|held| {
            let tiles = held.tiles.iter().filter(|(key, _)| key.job == job);
            tiles.map(|(&key, held)| StoredTile { key, record: held.record.clone() }).collect()
        })
    }

    fn parts(&self, job: JobId) -> Answer<Vec<StoredPart>> {
        self.with(|held| {
            let parts = held.parts.iter().filter(|((key, ..), _)| key.job == job);
            parts.map(|(&(key, pass, ..), &(rect, split, _))| StoredPart { key, pass, rect, split }).collect()
        })
    }

    fn film(&self, key: TileKey) -> Answer<Option<StoredFilm>> {
        self.with(|held| held.tiles.get(&key).cloned())
    }

    fn results(&self, key: TileKey, pass: u32) -> Answer<Vec<(Rect, Bytes)>> {
        self.with(|held| {
            let parts = held.parts.range((key, pass, 0, 0)..=(key, pass, u32::MAX, u32::MAX));
            parts.map(|(_, (rect, _, result))| (*rect, result.clone())).collect()
        })
    }

    fn attempts(&self, query: AttemptQuery) -> Answer<Vec<(u64, AttemptView)>> {
        self.with(|held| {
            let AttemptQuery { job, frame, tile, outcome, before, limit } = query;
            let fits = |attempt: &AttemptView| {
                frame.is_none_or(|frame| attempt.unit.frame == frame)
                    && tile.is_none_or(|tile| attempt.unit.tile == tile)
                    && outcome.is_none_or(|outcome| attempt.outcome == outcome)
            };
            let of_job = held.attempts.range((job, 0)..(job, before.unwrap_or(u64::MAX))).rev();
            let found = of_job.filter(|(_, attempt)| fits(attempt)).take(limit);
            found.map(|((_, number), attempt)| (*number, attempt.clone())).collect()
        })
    }

    fn close(&self) -> Answer<()> {
        self.with(|_| ())
    }
}
