//! Pictures of a frame, finished or as far as they are.

use std::{
    collections::HashMap,
    str::FromStr,
    sync::{Arc, Mutex},
};

use bytes::Bytes;
use common::{
    adaptive,
    film::{Features, Film, Moments},
    job::JobId,
    tile::Rect,
};
use half::f16;

use super::{Service, lock};
use crate::{
    assemble::{self, Picture, Raster},
    bridge::blocking,
    error::Failure,
    farm::TileKey,
    plan::{Field, Rule},
};

use super::results::grow;

/// Most tiles whose pixels are given at a time.
pub const MAX_PIXEL_TILES: usize = 64;
/// Small pictures kept in memory.
const THUMBNAILS: usize = 512;

/// Small pictures, each with the tag of what it shows.
pub(super) type Thumbnails = Mutex<HashMap<(JobId, u32, u32), (String, Bytes)>>;

/// What of a pixel is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Map {
    /// Its colour, linear light.
    Image,
    /// How many samples it had.
    Samples,
    /// Standard error of its luminance.
    Error,
}

impl FromStr for Map {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "image" => Ok(Map::Image),
            "samples" => Ok(Map::Samples),
            "error" => Ok(Map::Error),
            _ => Err(format!("\"{text}\" is not image, samples or error")),
        }
    }
}

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

    /// A small image of a frame, no wider than `width` pixels, as PNG; kept while `tag` names the frame's state.
    ///
    /// # Errors
    /// There is no such job or frame, or its films cannot be read.
    pub async fn thumbnail(self: &Arc<Self>, id: JobId, frame: u32, width: u32, tag: &str) -> Result<Bytes, Failure> {
        let key = (id, frame, width);
        if let Some((_, bytes)) = lock(&self.thumbnails).get(&key).filter(|(of, _)| of == tag) {
            return Ok(bytes.clone());
        }
        let whole = self.picture(id, frame, Picture::ImagePng).await?;
        let made = blocking("making a thumbnail", move || assemble::smaller(&whole, width)).await?;
        let bytes = Bytes::from(made.map_err(|error| Failure::Internal(format!("making a thumbnail: {error}")))?);
        let mut kept = lock(&self.thumbnails);
        if kept.len() >= THUMBNAILS {
            kept.clear();
        }
        kept.insert(key, (tag.into(), bytes.clone()));
        Ok(bytes)
    }

    /// Pixels of tiles as numbers: see the route of that name. Tiles without a sample are left out.
    ///
    /// # Errors
    /// There is no such job or frame, or its films cannot be read.
    pub async fn pixels(self: &Arc<Self>, id: JobId, frame: u32, map: Map, tiles: &[u32]) -> Result<Vec<u8>, Failure> {
        let record = self.record_with_frame(id, frame)?;
        let (grid, rule) = (record.grid(), Rule::shown(&record.quality));
        let mut out = Vec::new();
        for &tile in tiles {
            let Some(rect) = grid.rect(tile) else { continue };
            let Some(own) = self.film(TileKey { job: id, frame, tile }).await? else { continue };
            for number in [tile, rect.x, rect.y, rect.w, rect.h, own.record.passes] {
                out.extend(number.to_le_bytes());
            }
            if map != Map::Error {
                write(map, &own.film, &mut out);
                continue;
            }
            let mut around = vec![(rect, own)];
            for neighbour in grid.neighbours(tile) {
                let film = self.film(TileKey { job: id, frame, tile: neighbour }).await?;
                around.extend(grid.rect(neighbour).zip(film));
            }
            let wide = grow(rect, record.region);
            let mut moments = vec![Moments::default(); wide.area()];
            for (there, film) in &around {
                for ((x, y), &m) in there.pixels().zip(&film.film.moments) {
                    if wide.contains(&Rect { x, y, w: 1, h: 1 }) {
                        moments[((y - wide.y) * wide.w + (x - wide.x)) as usize] = m;
                    }
                }
            }
            errors(&rule, Field::new(wide, &moments), rect, &mut out);
        }
        Ok(out)
    }
}

fn write(map: Map, film: &Film, out: &mut Vec<u8>) {
    for moments in &film.moments {
        match map {
            Map::Image => moments.mean.iter().for_each(|&value| {
                // Brighter than 65504 is white at any exposure.
                out.extend(f16::from_f64(value.min(f16::MAX.to_f64())).to_le_bytes());
            }),
            Map::Samples | Map::Error => out.extend((moments.samples as f32).to_le_bytes()),
        }
    }
}

fn errors(rule: &adaptive::Rule, field: Field<'_>, tile: Rect, out: &mut Vec<u8>) {
    for (_, verdict) in field.judge(rule, tile) {
        out.extend((verdict.standard_error as f32).to_le_bytes());
    }
}
