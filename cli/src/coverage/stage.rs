//! A shipped scene made ready to render in this process, with no farm around it.

use common::{
    film::Moments,
    job::JobId,
    pass::{BATCH, Work},
    protocol::{RenderSettings, Unit, UnitId},
    tile::Rect,
};
use tracer::{Prepared, UnitRender};

use super::{Effort, parallel};
use crate::{args::JobOptions, bundle::Bundle, error::Failure, request};

/// A scene at one resolution.
pub(super) struct Stage {
    /// The whole frame.
    pub frame: Rect,
    prepared: Prepared,
    settings: RenderSettings,
}

impl Stage {
    /// Make `name`.json of the shipped scenes ready, with the method that it asks for.
    ///
    /// # Errors
    /// The scene cannot be read or rendered.
    pub fn open(effort: &Effort, name: &str, edge: u32) -> Result<Stage, Failure> {
        let mut bundle = Bundle::read(&effort.scenes.join(format!("{name}.json")))?;
        let request = request::of(&JobOptions { resolution: Some([edge, edge]), ..JobOptions::default() }, &bundle)?;
        let settings = RenderSettings { batch: BATCH, batches_per_set: 1, ..request::settings(&request, &bundle)? };
        let prepared = bundle.load(&request)?.build();
        Ok(Stage { frame: Rect::frame(edge, edge), prepared, settings })
    }

    /// What a unit of the whole frame gives, on this thread.
    pub fn render(&self, seed: u64, work: &Work) -> Vec<Moments> {
        self.in_batches(BATCH, 1, seed, work)
    }

    /// The same with batches of another size, and so many of them spread evenly together.
    pub fn in_batches(&self, batch: u32, batches_per_set: u32, seed: u64, work: &Work) -> Vec<Moments> {
        let settings = RenderSettings { seed, batch, batches_per_set, ..self.settings.clone() };
        let unit = self.unit(work.clone());
        let render = UnitRender::new(&self.prepared, &settings, &unit);
        (0..render.rows()).flat_map(|row| render.row(row).moments).collect()
    }

    /// The same on every core.
    pub fn render_on_all(&self, seed: u64, work: &Work) -> Vec<Moments> {
        let settings = RenderSettings { seed, ..self.settings.clone() };
        let unit = self.unit(work.clone());
        let render = UnitRender::new(&self.prepared, &settings, &unit);
        parallel::map(render.rows() as usize, |row| render.row(row as u32).moments).into_iter().flatten().collect()
    }

    fn unit(&self, work: Work) -> Unit {
        let id = UnitId { job: JobId(1), frame: self.settings.frame, tile: 0, pass: 0, rect: self.frame };
        Unit { id, work, features: false }
    }
}
