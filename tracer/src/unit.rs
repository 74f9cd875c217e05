//! Units: from a prepared scene and a unit's description to its pixels, a row at a time.

use common::{
    film::{Features, Moments},
    job::FieldError,
    method::Method,
    protocol::{RenderSettings, Unit},
    result::{UnitResult, UnitStatistics},
    scene::SceneFile,
};

use crate::Assets;

/// A scene whose parts are in memory, before its acceleration structure is built.
#[derive(Debug)]
pub struct Loaded(());

/// A scene ready to render: immutable, shared between threads and units.
#[derive(Debug)]
pub struct Prepared(());

impl Loaded {
    /// Reduce a checked scene, standing at one frame, to what rendering needs.
    ///
    /// # Errors
    /// A part of the scene that cannot be rendered, by its path in the scene file.
    pub fn new(
        _scene: &SceneFile,
        _assets: &Assets,
        _method: &Method,
        _resolution: [u32; 2],
    ) -> Result<Self, FieldError> {
        Ok(Self(()))
    }

    /// What was dropped or assumed, a sentence each: bad triangles, missing lights.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &[]
    }

    /// Build the acceleration structure. Its shape does not depend on the number of threads.
    #[must_use]
    pub fn build(self) -> Prepared {
        Prepared(())
    }
}

/// A unit being rendered. Rows are independent: any thread may render any of them in any order.
#[derive(Debug)]
pub struct UnitRender<'a> {
    unit: &'a Unit,
}

/// One row of a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct RowResult {
    /// Moments, one a pixel.
    pub moments: Vec<Moments>,
    /// Features, one a pixel, where the unit wants them.
    pub features: Vec<Features>,
    /// Counts of this row; times are left 0.
    pub statistics: UnitStatistics,
}

impl<'a> UnitRender<'a> {
    /// A unit of a prepared scene.
    #[must_use]
    pub fn new(_prepared: &'a Prepared, _settings: &'a RenderSettings, unit: &'a Unit) -> Self {
        Self { unit }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.unit.id.rect.h
    }

    /// Render row `row`, counted from the top of the unit.
    #[must_use]
    pub fn row(&self, row: u32) -> RowResult {
        let width = self.unit.id.rect.w as usize;
        let mean = [f64::from(row), 0.5, 0.5];
        let samples = self.unit.work.most_samples(16) as u32;
        let features = if self.unit.features { vec![Features::default(); width] } else { Vec::new() };
        RowResult {
            moments: vec![Moments::batch(samples, mean); width],
            features,
            statistics: UnitStatistics { samples: u64::from(samples) * width as u64, ..Default::default() },
        }
    }

    /// Put rows, in order, together into the unit's result.
    #[must_use]
    pub fn assemble(&self, rows: Vec<RowResult>) -> UnitResult {
        let mut result =
            UnitResult { rect: self.unit.id.rect, film: Default::default(), statistics: Default::default() };
        for row in rows {
            result.film.moments.extend(row.moments);
            result.film.features.extend(row.features);
            result.statistics.add(&row.statistics);
        }
        result
    }
}
