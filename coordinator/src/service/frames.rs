//! Whole frames: measured when all their tiles are finished, each pixel with all that lies around it; and,
//! where that shows the need, gone over again.

use std::{collections::BTreeMap, sync::Arc};

use common::{
    film::Moments,
    job::{JobId, Quality},
    tile::Rect,
};

use super::{JobEntry, Service, films::TileFilm, lock, measure};
use crate::{
    bridge::blocking,
    error::Failure,
    farm::{Event, TileKey},
    plan::{
        Field, Rule,
        budget::{self, Aim, Purse, Round},
    },
    store::{TileRecord, TileSummary, Write},
};

/// A finished tile of a frame.
type Tile = (TileKey, Rect, Arc<TileFilm>);

/// What a frame's measurement says.
enum Found {
    /// It is done; its tiles in short.
    Done(Vec<TileSummary>),
    /// It must be gone over again; under a budget, with this aim.
    Again(Option<Aim>),
}

impl Service {
    pub(super) async fn measure_frame(self: Arc<Self>, id: JobId, frame: u32) {
        match self.try_measure_frame(id, frame).await {
            Ok(again) => drop(self.apply(Event::Measured { job: id, frame, again })),
            Err(Failure::Leaving) => {}
            Err(failure) => {
                tracing::error!(job = %id, frame, cause = ?failure, "a frame could not be measured");
                let message = format!("frame {frame} could not be measured: {failure}");
                self.apply(Event::MergeFailed(TileKey { job: id, frame, tile: 0 }, message));
            }
        }
    }

    /// Measure a frame. Returns the passes that its tiles count as having, if it is to be gone over again.
    async fn try_measure_frame(&self, id: JobId, frame: u32) -> Result<Option<u32>, Failure> {
        let Some(entry) = self.entry(id) else { return Ok(None) };
        let (grid, quality, rule) = {
            let record = lock(&entry.record);
            (record.grid(), record.quality.clone(), record.rule.clone())
        };
        let region = grid.region();
        let mut moments = vec![Moments::default(); region.area()];
        let mut tiles: Vec<Tile> = Vec::new();
        for (tile, rect) in (0..grid.count()).filter_map(|tile| grid.rect(tile).map(|rect| (tile, rect))) {
            let key = TileKey { job: id, frame, tile };
            let Some(film) = self.film(key).await? else { continue };
            for ((x, y), &m) in rect.pixels().zip(&film.film.moments) {
                moments[(y - region.y) as usize * region.w as usize + (x - region.x) as usize] = m;
            }
            tiles.push((key, rect, film));
        }
        let left = self.purse(&entry, frame, &rule).map_or(0.0, |purse| purse.left());
        let costs = tiles.iter().map(|(_, rect, film)| (*rect, film.record.work.per_sample())).collect::<Vec<_>>();
        let rects: Vec<Rect> = costs.iter().map(|(rect, _)| *rect).collect();
        let found =
            blocking("measuring a frame", move || judge(&rule, &quality, region, &moments, &costs, &rects, left));
        match found.await? {
            Found::Done(summaries) => {
                self.write_down(&entry, tiles, summaries).await?;
                Ok(None)
            }
            Found::Again(aim) => {
                let passes = tiles.iter().map(|(_, _, film)| film.record.passes).max().unwrap_or(0);
                let records = tiles.iter().map(|(key, _, film)| (*key, film.record.clone())).collect::<Vec<_>>();
                self.go_over_again(&entry, id, frame, passes, &records).await?;
                if let Some(aim) = aim {
                    let mut record = lock(&entry.record);
                    record.rounds.insert(frame, Round { pass: passes, aim });
                    drop(self.store.write(Write::Job(Box::new(record.clone()))));
                }
                self.settle().await?;
                Ok(Some(passes))
            }
        }
    }

    /// What a frame may still spend, where its job has a budget.
    fn purse(&self, entry: &JobEntry, frame: u32, rule: &Rule) -> Option<Purse> {
        let &Rule::Budget { cpu_seconds, .. } = rule else { return None };
        let (frames, done) = {
            let record = lock(&entry.record);
            (
                record.frames.numbers().len(),
                record.done.as_ref().map(|done| done.numbers().to_vec()).unwrap_or_default(),
            )
        };
        let measure = lock(&entry.measure);
        let spent_on = |frame: &u32| measure.frames.get(frame).map_or(0.0, |frame| frame.cpu_seconds);
        Some(Purse {
            budget: cpu_seconds,
            spent_before: done.iter().map(spent_on).sum(),
            frames_left: frames - done.len(),
            spent: spent_on(&frame),
            spent_in_all: measure.work.cpu_seconds,
        })
    }

    /// Put the tiles of a frame back to the end of the same pass, none finished and no pixel stopped.
    pub(super) async fn go_over_again(
        &self,
        entry: &JobEntry,
        job: JobId,
        frame: u32,
        passes: u32,
        tiles: &[(TileKey, TileRecord)],
    ) -> Result<(), Failure> {
        self.store.write(Write::Resume { job, frame, passes }).await?;
        self.films.forget(|key| key.job == job && key.frame == frame);
        let mut measure = lock(&entry.measure);
        for (_, old) in tiles {
            measure.replace(frame, Some(old), &TileRecord { passes, finished: false, fresh: true, ..old.clone() });
        }
        Ok(())
    }

    /// Write down what a finished frame has reached, in place of what its tiles knew alone.
    async fn write_down(&self, entry: &JobEntry, tiles: Vec<Tile>, summaries: Vec<TileSummary>) -> Result<(), Failure> {
        let written = tiles.iter().zip(&summaries).map(|((key, ..), summary)| (*key, summary.clone())).collect();
        self.store.write(Write::Summaries(written)).await?;
        for ((key, _, old), summary) in tiles.into_iter().zip(summaries) {
            let record = TileRecord { summary, ..old.record.clone() };
            lock(&entry.measure).replace(key.frame, Some(&old.record), &record);
            self.films.put(key, Arc::new(TileFilm { record, film: Arc::clone(&old.film) }));
        }
        Ok(())
    }

    /// Let a job that is done go on to a finer target under which all pixels are judged anew.
    pub(super) async fn judge_anew(&self, entry: &JobEntry, id: JobId) -> Result<(), Failure> {
        let mut frames: BTreeMap<u32, Vec<(TileKey, TileRecord)>> = BTreeMap::new();
        for tile in self.store.tiles(id).await? {
            frames.entry(tile.key.frame).or_default().push((tile.key, tile.record));
        }
        for (frame, tiles) in frames {
            let passes = tiles.iter().map(|(_, record)| record.passes).max().unwrap_or(0);
            self.go_over_again(entry, id, frame, passes, &tiles).await?;
        }
        Ok(())
    }
}

/// Judge a frame whose tiles, `rects`, are all finished.
fn judge(
    rule: &Rule,
    quality: &Quality,
    region: Rect,
    moments: &[Moments],
    costs: &[(Rect, f64)],
    rects: &[Rect],
    left: f64,
) -> Found {
    let (shown, field) = (Rule::shown(quality), Field::new(region, moments));
    if let Rule::Budget { max_samples, .. } = rule
        && let Some(aim) = budget::aim(field, costs, *max_samples, left)
    {
        return Found::Again(Some(aim));
    }
    if rule.unsettled(field.judge(&shown, region).map(|(own, verdict)| (own.batches, verdict))) {
        return Found::Again(None);
    }
    Found::Done(rects.iter().map(|&rect| measure::summarise(&shown, field, rect)).collect())
}
