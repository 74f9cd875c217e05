//! Pictures of a frame, finished or as far as they are.

use std::sync::Arc;

use common::{
    film::{Features, Moments},
    job::JobId,
};

use super::{Service, lock};
use crate::{
    assemble::{self, Picture, Raster},
    bridge::blocking,
    error::Failure,
    farm::TileKey,
    plan::Rule,
};

impl Service {
    /// Names the state of a frame's pictures: changes with every pass that is merged.
    ///
    /// # Errors
    /// There is no such job or frame.
    pub fn picture_tag(&self, id: JobId, frame: u32, picture: Picture) -> Result<String, Failure> {
        let record = self.record_with_frame(id, frame)?;
        let entry = self.entry(id).ok_or_else(|| Failure::NotFound(format!("job {id}")))?;
        let revision = lock(&entry.measure).frames.get(&frame).map_or(0, |frame| frame.revision);
        let made: String = record.created_at.chars().filter(char::is_ascii_digit).collect();
        Ok(format!("\"{id}-{made}-{frame}-{}-{revision}\"", picture.name()))
    }

    /// Make a picture of a frame, as far as it is.
    ///
    /// # Errors
    /// There is no such job or frame, or its films cannot be read.
    pub async fn picture(self: &Arc<Self>, id: JobId, frame: u32, picture: Picture) -> Result<Vec<u8>, Failure> {
        let record = self.record_with_frame(id, frame)?;
        let grid = record.grid();
        let mut raster = Raster {
            resolution: record.resolution,
            region: record.region,
            rule: Rule::shown(&record.quality),
            moments: vec![Moments::default(); record.region.area()],
            features: vec![Features::default(); record.region.area()],
        };
        for (tile, rect) in (0..grid.count()).filter_map(|tile| grid.rect(tile).map(|rect| (tile, rect))) {
            if let Some(film) = self.film(TileKey { job: id, frame, tile }).await? {
                raster.place(rect, &film.film);
            }
        }
        let made = blocking("making a picture", move || assemble::make(&raster, picture)).await?;
        made.map_err(|error| Failure::Internal(format!("making {}: {error}", picture.name())))
    }
}
