//! Results: taken in, checked, merged in pass order, stored, and only then acknowledged.

use std::sync::{Arc, atomic::Ordering};

use bytes::Bytes;
use common::{
    film::Film,
    job::LeaseId,
    method::Method,
    pass::Work,
    plan::MethodPlan,
    protocol::{MAX_PREPARATION, Preparation, Unit, UnitId},
    result::{UnitResult, UnitStatistics, max_encoded_len},
    tile::Rect,
};
use serde::Serialize;

use super::{Service, films::TileFilm, lock, measure, planned};
use crate::{
    bridge::blocking,
    error::Failure,
    farm::{Accepted, Effect, Event, TileKey, Wanted},
    plan::{Field, RING, Rule, Surroundings, budget, judge_anew},
    store::{StoreError, StoredFilm, TileRecord, Write, film},
};

/// The answer to a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct Receipt {
    /// Whether it was the first valid one for its unit.
    pub counted: bool,
}

impl Service {
    /// Take in a result, compressed as it was sent. When this returns, it is on disk (or was before).
    ///
    /// # Errors
    /// It is not a result of that unit, there is no such unit, or it could not be stored.
    pub async fn take_result(self: &Arc<Self>, lease: LeaseId, id: UnitId, body: Bytes) -> Result<Receipt, Failure> {
        let wanted = self.farm().wanted(&id);
        let unit = match wanted {
            Wanted::Open(unit) => unit,
            Wanted::Unknown => return Err(Failure::NotFound(format!("unit {id}"))),
            Wanted::Closed => {
                self.note_late(lease, id);
                // Its first result may be on its way to the disk: what is acknowledged must be there.
                self.settle().await?;
                return Ok(Receipt { counted: false });
            }
        };
        self.tallies.result_bytes.fetch_add(body.len() as u64, Ordering::Relaxed);
        if matches!(unit.work, Work::Prepare { .. }) {
            return self.take_preparation(lease, id, body).await;
        }
        let batch = self.entry(id.job).map_or(1, |entry| lock(&entry.record).rule.batch());
        let sent = body.clone();
        let decoded = blocking("reading a result", move || read_result(&sent, &unit, batch)).await?;
        let result = match decoded {
            Ok(result) => result,
            Err(message) => {
                self.tallies.refused_results.fetch_add(1, Ordering::Relaxed);
                self.blame(lease, id, &message);
                return Err(Failure::Refused(format!("unit {id}: {message}")));
            }
        };
        let (samples, cpu_seconds) = (result.statistics.samples, result.statistics.cpu_seconds.max(0.0));
        let answers = self.apply(Event::Result { lease, unit: id, samples, cpu_seconds });
        let Some(accepted) = answers.into_iter().find_map(|answer| match answer {
            Effect::Accept(accepted) => Some(accepted),
            _ => None,
        }) else {
            self.note_late(lease, id);
            self.settle().await?;
            return Ok(Receipt { counted: false });
        };
        self.note_done(lease, &accepted, cpu_seconds, samples);
        self.tallies.samples.fetch_add(samples, Ordering::Relaxed);
        self.tallies.cpu_microseconds.fetch_add((cpu_seconds * 1e6) as u64, Ordering::Relaxed);
        // A task of its own: a sender that hangs up must not leave the unit half taken in.
        let service = Arc::clone(self);
        let stored = tokio::spawn(async move { service.store_result(accepted, result, body).await }).await;
        match stored {
            Ok(Ok(())) => Ok(Receipt { counted: true }),
            Ok(Err(failure)) => {
                self.apply(Event::SaveFailed(id));
                Err(failure)
            }
            Err(_) => {
                self.apply(Event::SaveFailed(id));
                Err(Failure::Internal(format!("storing unit {id} panicked")))
            }
        }
    }

    /// Take in what a job had to have prepared. When this returns, it is on disk.
    async fn take_preparation(self: &Arc<Self>, lease: LeaseId, id: UnitId, body: Bytes) -> Result<Receipt, Failure> {
        let Some(entry) = self.entry(id.job) else { return Err(Failure::NotFound(format!("unit {id}"))) };
        let Preparation { plan, cpu_seconds } = match read_preparation(&body) {
            Ok(preparation) => preparation,
            Err(message) => {
                self.tallies.refused_results.fetch_add(1, Ordering::Relaxed);
                self.blame(lease, id, &message);
                return Err(Failure::Refused(format!("unit {id}: {message}")));
            }
        };
        let cpu_seconds = cpu_seconds.max(0.0);
        let answers = self.apply(Event::Result { lease, unit: id, samples: 0, cpu_seconds });
        let accepted = answers.iter().find_map(|answer| match answer {
            Effect::Accept(accepted) => Some(accepted),
            _ => None,
        });
        let Some(accepted) = accepted else {
            self.note_late(lease, id);
            self.settle().await?;
            return Ok(Receipt { counted: false });
        };
        self.note_done(lease, accepted, cpu_seconds, 0);
        {
            let mut record = lock(&entry.record);
            // What a trial may choose, and nothing else, is the worker's.
            let Method { direct, light_pick, light_samples, splits, reuse, light_sampling, aim, roulette, .. } =
                plan.method.clone();
            let method = record.method.clone();
            record.method =
                Method { direct, light_pick, light_samples, splits, reuse, light_sampling, aim, roulette, ..method };
            record.plan = Some(MethodPlan { method: record.method.clone(), ..plan });
            record.prepare = None;
            drop(self.store.write(Write::Job(Box::new(record.clone()))));
        }
        // A task of its own: a sender that hangs up must not leave the job half prepared.
        let service = Arc::clone(self);
        let settled = tokio::spawn(async move {
            let settled = service.settle().await;
            service.apply(if settled.is_ok() { Event::Prepared(id.job) } else { Event::SaveFailed(id) });
            settled
        });
        match settled.await {
            Ok(settled) => settled?,
            Err(_) => return Err(Failure::Internal(format!("storing unit {id} panicked"))),
        }
        lock(&self.dirty).jobs.insert(id.job, true);
        Ok(Receipt { counted: true })
    }

    /// A worker that sends rubbish has failed the unit.
    fn blame(self: &Arc<Self>, lease: LeaseId, unit: UnitId, message: &str) {
        let Some(worker) = self.farm().holder(lease) else { return };
        self.apply(Event::Failed {
            lease,
            worker,
            units: vec![unit],
            cause: common::protocol::FailureCause::Failed,
            message: format!("worker {worker} handed in a bad result: {message}"),
        });
    }

    async fn store_result(
        self: &Arc<Self>,
        accepted: Accepted,
        result: UnitResult,
        sent: Bytes,
    ) -> Result<(), Failure> {
        let unit = accepted.unit;
        let key = TileKey::from(&unit);
        match accepted.split {
            None => {
                self.store_pass(&accepted, result.film, &[result.statistics]).await?;
                self.apply(Event::Merged { tile: key, pass: unit.pass });
                self.tell_tile(key, false);
            }
            Some(split) => {
                self.store.write(Write::Part { key, pass: unit.pass, rect: unit.rect, split, result: sent }).await?;
                self.apply(Event::Saved(unit));
            }
        }
        Ok(())
    }

    /// Every part of a pass is stored: put them together.
    pub(super) async fn merge_parts(self: Arc<Self>, accepted: Accepted) {
        let unit = accepted.unit;
        let key = TileKey::from(&unit);
        match self.try_merge_parts(&accepted).await {
            Ok(()) => {
                self.apply(Event::Merged { tile: key, pass: unit.pass });
                self.tell_tile(key, false);
            }
            Err(Failure::Leaving) => {}
            Err(failure) => {
                tracing::error!(%unit, cause = ?failure, "the parts of a pass could not be merged");
                let message = format!("the parts of {unit} could not be merged: {failure}");
                self.apply(Event::MergeFailed(key, message));
            }
        }
    }

    async fn try_merge_parts(self: &Arc<Self>, accepted: &Accepted) -> Result<(), Failure> {
        let unit = accepted.unit;
        let parts = self.store.results(TileKey::from(&unit), unit.pass).await?;
        let rect = unit.rect;
        let joined = blocking("joining parts", move || join(rect, &parts)).await?;
        let Some((film, statistics)) = joined else {
            // Another incarnation of the job has merged them already, or the record is damaged.
            let stored = self.film(TileKey::from(&unit)).await?.map_or(0, |film| film.record.passes);
            if stored > unit.pass {
                return Ok(());
            }
            return Err(StoreError::Damaged(format!("the parts of {unit}")).into());
        };
        self.store_pass(accepted, film, &statistics).await
    }

    /// Merge a whole pass into its tile's film and store that.
    async fn store_pass(
        self: &Arc<Self>,
        accepted: &Accepted,
        film: Film,
        statistics: &[UnitStatistics],
    ) -> Result<(), Failure> {
        let unit = accepted.unit;
        let key = TileKey::from(&unit);
        let Some(entry) = self.entry(key.job) else { return Ok(()) };
        let (quality, keep_ring) = {
            let record = lock(&entry.record);
            (record.quality.clone(), record.rule.looks_around())
        };
        let old = if unit.pass == 0 { None } else { self.film(key).await? };
        if old.as_ref().map_or(0, |old| old.record.passes) != unit.pass {
            return Ok(()); // It is merged already: the same bytes came by another way.
        }
        let mut record = TileRecord {
            passes: unit.pass + 1,
            share: accepted.share,
            attempts: accepted.attempts,
            worker: accepted.worker.or(old.as_ref().and_then(|old| old.record.worker)),
            work: old.as_ref().map(|old| old.record.work).unwrap_or_default(),
            ..TileRecord::default()
        };
        statistics.iter().for_each(|s| record.work.add(s));
        let before = old.clone();
        let rect = unit.rect;
        let (merged, bytes, ring) = blocking("merging a result", move || {
            let film = match &before {
                None => film,
                Some(before) => merge(&before.film, &film),
            };
            record.summary = measure::summarise(&Rule::shown(&quality), Field::new(rect, &film.moments), rect);
            let ring = match &before {
                Some(before) if keep_ring => Some(film::encode(&border(rect, &before.film))?),
                _ => None,
            };
            let bytes = film::encode(&film)?;
            Ok::<_, StoreError>((TileFilm { record, film: Arc::new(film) }, bytes, ring))
        })
        .await??;
        let write = Write::Tile {
            key,
            record: Box::new(merged.record.clone()),
            film: bytes.into(),
            ring: ring.map(Bytes::from),
        };
        self.store.write(write).await?;
        let merged = Arc::new(merged);
        lock(&entry.measure).replace(key.frame, old.as_ref().map(|old| &old.record), &merged.record);
        self.films.put(key, merged);
        lock(&self.dirty).jobs.entry(key.job).or_default();
        Ok(())
    }

    /// A tile's film as it is stored.
    pub(super) async fn film(&self, key: TileKey) -> Result<Option<Arc<TileFilm>>, Failure> {
        if let Some(film) = self.films.get(key) {
            return Ok(Some(film));
        }
        let Some(entry) = self.entry(key.job) else { return Ok(None) };
        let Some(rect) = lock(&entry.record).grid().rect(key.tile) else { return Ok(None) };
        let Some(stored) = self.store.film(key).await? else { return Ok(None) };
        let film = blocking("reading a film", move || read_film(&stored, rect).map(|film| (stored.record, film)));
        let (record, film) = film.await??;
        let film = Arc::new(TileFilm { record, film: Arc::new(film) });
        self.films.put(key, Arc::clone(&film));
        Ok(Some(film))
    }

    /// Plan a pass from what was measured in the tile and around it, exactly as of the end of the pass before.
    pub(super) async fn plan_from_films(self: Arc<Self>, tile: TileKey, pass: u32) {
        match self.surroundings(tile, pass).await {
            Ok(Some((rect, around))) => {
                let Some(entry) = self.entry(tile.job) else { return };
                let (rule, round) = {
                    let record = lock(&entry.record);
                    (record.rule.clone(), record.rounds.get(&tile.frame).copied())
                };
                let plan = move || match (&rule, round) {
                    (Rule::Budget { max_samples, .. }, Some(round)) if round.pass == pass => {
                        budget::next(round.aim, *max_samples, rect, around.field())
                    }
                    _ => rule.step(pass, rect, Some(&around)),
                };
                match blocking("planning a pass", plan).await {
                    Ok(step) => {
                        let before = self.film(tile).await.ok().flatten();
                        let before = before.map(|film| film.record.work).unwrap_or_default();
                        lock(&entry.measure).foresee(tile, rect, &before, &step);
                        drop(self.apply(Event::Planned(vec![planned(tile, pass, step)])));
                    }
                    Err(error) => drop(self.apply(Event::MergeFailed(tile, error.to_string()))),
                }
            }
            Ok(None) | Err(Failure::Leaving) => {}
            Err(failure) => {
                tracing::error!(?tile, pass, cause = ?failure, "a pass could not be planned");
                self.apply(Event::MergeFailed(tile, format!("pass {pass} could not be planned: {failure}")));
            }
        }
    }

    async fn surroundings(&self, tile: TileKey, pass: u32) -> Result<Option<(Rect, Surroundings)>, Failure> {
        let Some(entry) = self.entry(tile.job) else { return Ok(None) };
        let grid = lock(&entry.record).grid();
        let Some(rect) = grid.rect(tile.tile) else { return Ok(None) };
        let wide = grow(rect, grid.region());
        let mut around = Surroundings { rect: wide, moments: vec![Default::default(); wide.area()] };
        for index in grid.neighbours(tile.tile).into_iter().chain([tile.tile]) {
            let (key, Some(there)) = (TileKey { tile: index, ..tile }, grid.rect(index)) else { continue };
            let Some(stored) = self.store.film(key).await? else { continue };
            let film = if stored.record.passes > pass {
                // It is one pass further: its border, as it was, is kept for us.
                let ring = stored.ring.ok_or_else(|| StoreError::Damaged(format!("the ring of {key:?}")))?;
                unborder(there, &film::decode(&ring, border_pixels(there).count())?)
            } else {
                read_film(&stored, there)?
            };
            for ((x, y), moments) in there.pixels().zip(film.moments) {
                if wide.contains(&Rect { x, y, w: 1, h: 1 }) {
                    let at = ((y - wide.y) * wide.w + (x - wide.x)) as usize;
                    around.moments[at] = moments;
                }
            }
        }
        Ok(Some((rect, around)))
    }
}

/// A stored film. Where its pixels are judged anew, none has stopped.
fn read_film(stored: &StoredFilm, rect: Rect) -> Result<Film, StoreError> {
    let mut film = film::decode(&stored.film, rect.area())?;
    if stored.record.fresh {
        judge_anew(&mut film.moments);
    }
    Ok(film)
}

/// Decompress and check what was prepared.
fn read_preparation(body: &[u8]) -> Result<Preparation, String> {
    let plain = zstd::bulk::decompress(body, MAX_PREPARATION)
        .map_err(|_| format!("not zstd, or more than {MAX_PREPARATION} bytes unpacked"))?;
    let preparation: Preparation = serde_json::from_slice(&plain).map_err(|error| error.to_string())?;
    preparation.plan.method.validate().map_err(|error| error.to_string())?;
    Ok(preparation)
}

/// Decompress and check a result against the unit it is for.
fn read_result(body: &[u8], unit: &Unit, batch: u32) -> Result<UnitResult, String> {
    let rect = unit.id.rect;
    let plain = zstd::bulk::decompress(body, max_encoded_len(rect.area()))
        .map_err(|_| format!("not zstd, or more than {} bytes unpacked", max_encoded_len(rect.area())))?;
    let result = UnitResult::decode(&plain, rect).map_err(|error| error.to_string())?;
    if unit.features == result.film.features.is_empty() {
        return Err(format!("features are {}", if unit.features { "missing" } else { "not wanted" }));
    }
    let batches_of = |samples: u64| samples.div_ceil(u64::from(batch.max(1)));
    for (pixel, moments) in result.film.moments.iter().enumerate() {
        let (samples, batches) = match &unit.work {
            Work::PerPixel { batches, .. } => {
                let batches = u64::from(batches.get(pixel).copied().unwrap_or(0));
                (batches * u64::from(batch), batches)
            }
            Work::Uniform { samples, .. } => (u64::from(*samples), batches_of(u64::from(*samples))),
            Work::Textbook { max_samples, .. } => (u64::from(*max_samples), u64::from(*max_samples)),
            Work::Prepare { .. } => (0, 0),
        };
        if u64::from(moments.samples) > samples || u64::from(moments.batches) > batches {
            return Err(format!("pixel {pixel} has more samples or batches than were asked for"));
        }
    }
    Ok(result)
}

/// Merge a later pass into a film, pixel by pixel. The order is part of the bits. A pixel that the pass gave
/// nothing has stopped.
fn merge(before: &Film, later: &Film) -> Film {
    let both = before.moments.iter().zip(&later.moments);
    let moments = both.map(|(a, b)| a.after_pass(*b)).collect();
    Film { moments, features: before.features.clone() }
}

/// Put the parts of a pass in their places; `None` if they do not cover the tile.
fn join(tile: Rect, parts: &[(Rect, Bytes)]) -> Option<(Film, Vec<UnitStatistics>)> {
    let area: usize = parts.iter().map(|(rect, _)| rect.area()).sum();
    if area != tile.area() || !parts.iter().all(|(rect, _)| tile.contains(rect)) {
        return None;
    }
    let mut film = Film { moments: vec![Default::default(); tile.area()], features: Vec::new() };
    let mut statistics = Vec::with_capacity(parts.len());
    for (rect, bytes) in parts {
        let plain = zstd::bulk::decompress(bytes, max_encoded_len(rect.area())).ok()?;
        let part = UnitResult::decode(&plain, *rect).ok()?;
        if !part.film.features.is_empty() {
            film.features.resize(tile.area(), Default::default());
        }
        for (i, (x, y)) in rect.pixels().enumerate() {
            let at = ((y - tile.y) * tile.w + (x - tile.x)) as usize;
            film.moments[at] = part.film.moments[i];
            if let Some(features) = part.film.features.get(i) {
                film.features[at] = *features;
            }
        }
        statistics.push(part.statistics);
    }
    Some((film, statistics))
}

/// The tile grown by the width of the ring, cut at the region's edge.
pub(super) fn grow(rect: Rect, region: Rect) -> Rect {
    let (x, y) = (rect.x.saturating_sub(RING).max(region.x), rect.y.saturating_sub(RING).max(region.y));
    let right = (rect.x + rect.w + RING).min(region.x + region.w);
    let bottom = (rect.y + rect.h + RING).min(region.y + region.h);
    Rect { x, y, w: right - x, h: bottom - y }
}

/// Indices of a tile's pixels that a neighbour may look at, in row order.
fn border_pixels(tile: Rect) -> impl Iterator<Item = usize> {
    let Rect { w, h, .. } = tile;
    let inside = move |x: u32, y: u32| x >= RING && y >= RING && x + RING < w && y + RING < h;
    (0..h).flat_map(move |y| (0..w).filter(move |&x| !inside(x, y)).map(move |x| (y * w + x) as usize))
}

fn border(tile: Rect, film: &Film) -> Film {
    Film { moments: border_pixels(tile).map(|i| film.moments[i]).collect(), features: Vec::new() }
}

fn unborder(tile: Rect, ring: &Film) -> Film {
    let mut moments = vec![Default::default(); tile.area()];
    border_pixels(tile).zip(&ring.moments).for_each(|(i, &m)| moments[i] = m);
    Film { moments, features: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        blobs::Blobs,
        config::Config,
        store::{MemoryStore, Store},
    };
    use common::{film::Moments, job::JobRequest};

    /// Moments that tell the pixel and the pass they are of.
    fn film(rect: Rect, pass: u32) -> Film {
        let moments = rect
            .pixels()
            .map(|(x, y)| Moments {
                samples: pass,
                batches: pass,
                mean: [f64::from(x), f64::from(y), 0.5],
                m2: 0.0,
                ..Moments::default()
            })
            .collect();
        Film { moments, features: Vec::new() }
    }

    #[test]
    fn a_border_comes_back_to_its_place() {
        for rect in [Rect { x: 8, y: 4, w: 7, h: 5 }, Rect::frame(1, 6), Rect::frame(2, 2), Rect::frame(3, 3)] {
            let film = film(rect, 2);
            let ring = border(rect, &film);
            let back = unborder(rect, &ring);
            for (i, (x, y)) in rect.pixels().enumerate() {
                let edge = x == rect.x || y == rect.y || x + 1 == rect.x + rect.w || y + 1 == rect.y + rect.h;
                let expected = if edge { film.moments[i] } else { Moments::default() };
                assert_eq!(back.moments[i], expected, "{rect} at {x},{y}");
            }
            assert_eq!(ring.moments.len(), border_pixels(rect).count());
        }
    }

    #[test]
    fn parts_join_only_when_they_cover_the_tile() {
        let tile = Rect { x: 4, y: 4, w: 4, h: 4 };
        let part = |rect: Rect| {
            let result = UnitResult { rect, film: film(rect, 1), statistics: UnitStatistics::default() };
            (rect, Bytes::from(zstd::bulk::compress(&result.encode(), 1).unwrap()))
        };
        let parts: Vec<_> = tile.split(6).into_iter().map(part).collect();
        assert!(parts.len() > 2);
        let (joined, statistics) = join(tile, &parts).unwrap();
        assert_eq!((joined, statistics.len()), (film(tile, 1), parts.len()));
        assert!(join(tile, &parts[1..]).is_none());
        assert!(join(Rect { x: 0, ..tile }, &parts).is_none());
    }

    #[tokio::test]
    async fn surroundings_are_those_of_the_pass_before_wherever_the_neighbours_are() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::folder(folder.path()).unwrap();
        let store = MemoryStore::default();
        let service = Service::start(Config::new(folder.path()), Arc::new(store.clone()), blobs, None).await.unwrap();
        let request: JobRequest = serde_json::from_str(
            r#"{"scene": {"tessera": 1, "camera": {"position": [0, 0, 5], "target": [0, 0, 0]}},
                "resolution": [24, 24], "tile": 8, "quality": {"target": "samples", "samples": 64}}"#,
        )
        .unwrap();
        let job = service.submit(request, Default::default()).await.unwrap().id;
        let grid = common::tile::TileGrid::new(Rect::frame(24, 24), 8);
        let key = |tile| TileKey { job, frame: 1, tile };
        // All nine tiles stand at two passes, but for one that is a pass ahead and one that ended at one.
        for tile in 0..9 {
            let rect = grid.rect(tile).unwrap();
            let passes = [2, 2, 2, 3, 2, 2, 2, 1, 2][tile as usize];
            let ring = (passes > 1).then(|| film::encode(&border(rect, &self::film(rect, passes - 1))).unwrap().into());
            let bytes = film::encode(&self::film(rect, passes)).unwrap().into();
            let record = Box::new(TileRecord { passes, ..TileRecord::default() });
            store.write(Write::Tile { key: key(tile), record, film: bytes, ring }).await.unwrap();
        }
        let (rect, around) = service.surroundings(key(4), 2).await.unwrap().unwrap();
        assert_eq!((rect, around.rect), (Rect { x: 8, y: 8, w: 8, h: 8 }, Rect { x: 7, y: 7, w: 10, h: 10 }));
        for (i, (x, y)) in around.rect.pixels().enumerate() {
            let ended = x / 8 == 1 && y / 8 == 2;
            let expected = if ended { 1 } else { 2 };
            assert_eq!(around.moments[i].samples, expected, "at {x},{y}");
            assert_eq!(around.moments[i].mean, [f64::from(x), f64::from(y), 0.5]);
        }
        let (_, corner) = service.surroundings(key(0), 2).await.unwrap().unwrap();
        assert_eq!(corner.rect, Rect::frame(9, 9));
    }
}
