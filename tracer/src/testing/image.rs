//! Small images for tests.

use common::{
    film::Film,
    job::JobId,
    method::Method,
    pass::Work,
    protocol::{RenderSettings, Unit, UnitId},
    result::UnitStatistics,
    scene::SceneFile,
    tile::Rect,
};
use rayon::prelude::*;

use crate::{Assets, Loaded, Prepared, UnitRender};

/// A rendered rectangle.
pub struct Image {
    pub film: Film,
    pub statistics: UnitStatistics,
    pub first_rejected: Option<[u32; 3]>,
}

impl Image {
    /// Mean luminance of the image and its standard error.
    pub fn mean_and_error(&self) -> (f64, f64) {
        let n = self.film.moments.len() as f64;
        let mean = self.film.moments.iter().map(|pixel| pixel.luminance()).sum::<f64>() / n;
        let variance: f64 = self.film.moments.iter().map(|pixel| pixel.variance_of_mean().unwrap_or(0.0)).sum();
        (mean, variance.sqrt() / n)
    }
}

pub fn prepare(scene: &SceneFile, method: &Method) -> Prepared {
    let resolution = [scene.film.width, scene.film.height];
    Loaded::new(scene, &Assets::default(), method, resolution).unwrap().build()
}

pub fn settings(scene: &SceneFile, method: &Method, batch: u32) -> RenderSettings {
    let resolution = [scene.film.width, scene.film.height];
    RenderSettings { frame: 1, resolution, method: method.clone(), seed: 1, batch, batches_per_set: 1 }
}

/// Render `rect` with features.
pub fn render_rect(prepared: &Prepared, settings: &RenderSettings, rect: Rect, work: Work) -> Image {
    let id = UnitId { job: JobId(1), frame: settings.frame, tile: 0, pass: 0, rect };
    let unit = Unit { id, work, features: true };
    let render = UnitRender::new(prepared, settings, &unit);
    let rows: Vec<_> = (0..render.rows()).into_par_iter().map(|row| render.row(row)).collect();
    let first_rejected = rows.iter().find_map(|row| row.first_rejected);
    let result = render.assemble(rows);
    Image { film: result.film, statistics: result.statistics, first_rejected }
}

/// Render a whole frame.
pub fn render(scene: &SceneFile, method: &Method, work: Work, batch: u32) -> Image {
    let rect = Rect::frame(scene.film.width, scene.film.height);
    render_rect(&prepare(scene, method), &settings(scene, method, batch), rect, work)
}
