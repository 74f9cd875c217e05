//! Whole frames: measured when all their tiles are finished, each pixel with all that lies around it.

use std::sync::Arc;

use common::{film::Moments, job::JobId, tile::Rect};

use super::{Service, films::TileFilm, lock, measure};
use crate::{
    bridge::blocking,
    error::Failure,
    farm::{Event, TileKey},
    plan::{Field, Rule},
    store::{TileRecord, TileSummary, Write},
};

impl Service {
    pub(super) async fn measure_frame(self: Arc<Self>, id: JobId, frame: u32) {
        match self.try_measure_frame(id, frame).await {
            Ok(()) => drop(self.apply(Event::Measured(id, frame))),
            Err(Failure::Leaving) => {}
            Err(failure) => {
                tracing::error!(job = %id, frame, cause = ?failure, "a frame could not be measured");
                let message = format!("frame {frame} could not be measured: {failure}");
                self.apply(Event::MergeFailed(TileKey { job: id, frame, tile: 0 }, message));
            }
        }
    }

    async fn try_measure_frame(&self, id: JobId, frame: u32) -> Result<(), Failure> {
        let Some(entry) = self.entry(id) else { return Ok(()) };
        let (grid, quality) = {
            let record = lock(&entry.record);
            (record.grid(), record.quality.clone())
        };
        let region = grid.region();
        let mut moments = vec![Moments::default(); region.area()];
        let mut tiles: Vec<(TileKey, Rect, Arc<TileFilm>)> = Vec::new();
        for (tile, rect) in (0..grid.count()).filter_map(|tile| grid.rect(tile).map(|rect| (tile, rect))) {
            let key = TileKey { job: id, frame, tile };
            let Some(film) = self.film(key).await? else { continue };
            for ((x, y), &m) in rect.pixels().zip(&film.film.moments) {
                moments[(y - region.y) as usize * region.w as usize + (x - region.x) as usize] = m;
            }
            tiles.push((key, rect, film));
        }
        let judged = blocking("measuring a frame", move || {
            let (rule, field) = (Rule::shown(&quality), Field::new(region, &moments));
            let judge = |(key, rect, film)| (key, film, measure::summarise(&rule, field, rect));
            tiles.into_iter().map(judge).collect::<Vec<(TileKey, Arc<TileFilm>, TileSummary)>>()
        })
        .await?;
        let summaries = judged.iter().map(|(key, _, summary)| (*key, summary.clone())).collect();
        self.store.write(Write::Summaries(summaries)).await?;
        for (key, old, summary) in judged {
            let record = TileRecord { summary, ..old.record.clone() };
            lock(&entry.measure).replace(frame, Some(&old.record), &record);
            self.films.put(key, Arc::new(TileFilm { record, film: Arc::clone(&old.film) }));
        }
        Ok(())
    }
}
