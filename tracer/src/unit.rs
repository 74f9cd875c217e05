//! Units: from a prepared scene and a unit's description to its pixels, a row at a time.

mod pixel;
mod regions;
mod replay;

#[cfg(test)]
mod tests;

use std::cell::Cell;

use common::{
    film::{Features, Moments},
    job::FieldError,
    method::Method,
    pass::Work,
    protocol::{RenderSettings, Unit},
    result::{UnitResult, UnitStatistics},
    scene::SceneFile,
};

use crate::{
    Assets,
    geometry::{Counters, Options, World},
    integrator::{Integrator, MEMBERS, REQUESTS, Together, Wave},
    math::Rgb,
    sampler::Sampler,
    scene::{Draft, Facts, Scene},
    special::Without,
};

use pixel::{Pixel, Source};
pub(crate) use regions::{SIDE, group_of};
pub use replay::Replay;

/// A scene whose parts are in memory, before its acceleration structure is built.
#[derive(Debug)]
pub struct Loaded(Draft);

/// A scene ready to render: immutable, shared between threads and units.
#[derive(Debug)]
pub struct Prepared(Scene);

impl Loaded {
    /// Reduce a checked scene, standing at one frame, to what rendering needs.
    ///
    /// # Errors
    /// A part of the scene that cannot be rendered, by its path in the scene file.
    pub fn new(scene: &SceneFile, assets: &Assets, method: &Method, resolution: [u32; 2]) -> Result<Self, FieldError> {
        Draft::compile(scene, assets, method, resolution).map(Self)
    }

    /// What was dropped or assumed, a sentence each: bad triangles, missing lights.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        self.0.warnings()
    }

    /// What the acceleration structure is built of, for measurements.
    #[must_use]
    pub fn world(&self) -> (&World, Options) {
        self.0.world()
    }

    /// Build the acceleration structure. Its shape does not depend on the number of threads.
    #[must_use]
    pub fn build(self) -> Prepared {
        self.build_without(Without::NOTHING)
    }

    /// The same with specialisations left unused: pictures have the same bytes, later.
    #[must_use]
    pub fn build_without(self, without: Without) -> Prepared {
        Prepared(self.0.build(without))
    }
}

impl Prepared {
    /// What the scene needs.
    #[must_use]
    pub fn facts(&self) -> &Facts {
        self.0.facts()
    }

    /// The same scene for `method`, which may differ from the one it was loaded for, `old`, in how lights are
    /// chosen and sampled and how paths go; `None` where more than that depends on it. Geometry and materials
    /// are shared.
    #[must_use]
    pub fn with_method(&self, old: &Method, method: &Method) -> Option<Self> {
        self.0.with_method(old, method).map(Self)
    }

    /// The same scene with specialisations left unused; `None` where it must be built anew for that
    /// ([`Loaded::build_without`]).
    #[must_use]
    pub fn without(&self, without: Without) -> Option<Self> {
        self.0.leaving(without).map(Self)
    }

    /// The scene itself, for measurements.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.0
    }

    /// Render one sample of one pixel and tell its path. `settings` must name the method that the scene was
    /// loaded for.
    #[must_use]
    pub fn sample(&self, settings: &RenderSettings, pixel: [u32; 2], sample: u32) -> Replay {
        let integrator = Integrator::new(&self.0, &settings.method);
        Replay::of(&integrator, &sampler(settings), settings.resolution, pixel, sample)
    }

    /// Render `samples` of each pixel of `row`, and give `visit` the column, the number of the sample and its
    /// radiance: the same bits as in an image, but each by itself and none thrown away.
    pub fn samples(
        &self,
        settings: &RenderSettings,
        row: u32,
        samples: std::ops::Range<u32>,
        mut visit: impl FnMut(u32, u32, Rgb),
    ) {
        let (integrator, sampler) = (Integrator::new(&self.0, &settings.method), sampler(settings));
        let mut counters = Counters::default();
        if integrator.shares() {
            let by = (&integrator, &sampler);
            return regions::samples(by, settings.resolution, row, samples, &mut counters, visit);
        }
        let all = (0..settings.resolution[0]).flat_map(|x| samples.clone().map(move |number| [x, row, number]));
        if !integrator.has_wave() {
            for [x, y, number] in all {
                let stream = sampler.stream(x, y, number);
                visit(x, number, integrator.sample(x, y, &stream, &mut counters).radiance);
            }
            return;
        }
        let requests: Vec<[u32; 3]> = all.collect();
        let mut wave = Wave::new();
        for requests in requests.chunks(REQUESTS) {
            integrator.wave(&mut wave, &sampler, requests, &[], false, &mut counters);
            for (i, &[x, _, number]) in requests.iter().enumerate() {
                visit(x, number, wave.traced(i).sample.radiance);
            }
        }
    }
}

/// What a thread needs to render rows in waves, kept from row to row.
struct Workspace {
    wave: Box<Wave>,
    together: Together,
    requests: Vec<[u32; 3]>,
    /// Of requests that share paths, where each group ends.
    ends: Vec<u32>,
    /// Of each request, how many samples its batch has, if it is the batch's first.
    begins: Vec<u32>,
}

impl Default for Workspace {
    fn default() -> Self {
        Self {
            wave: Wave::new(),
            together: Together::default(),
            requests: Vec::with_capacity(REQUESTS),
            ends: Vec::with_capacity(REQUESTS / MEMBERS),
            begins: Vec::with_capacity(REQUESTS),
        }
    }
}

thread_local! {
    static WORKSPACE: Cell<Option<Box<Workspace>>> = const { Cell::new(None) };
}

/// The points that units of these settings are rendered with.
#[must_use]
pub fn sampler(settings: &RenderSettings) -> Sampler {
    Sampler::new(settings.method.sampler, settings.seed, settings.frame, settings.batch)
        .in_sets(settings.batches_per_set)
}

/// A unit being rendered. Rows are independent: any thread may render any of them in any order.
#[derive(Debug)]
pub struct UnitRender<'a> {
    unit: &'a Unit,
    integrator: Integrator<'a>,
    sampler: Sampler,
    resolution: [u32; 2],
}

/// One row of a unit, or several in a row.
#[derive(Debug, Clone, PartialEq)]
pub struct RowResult {
    /// Moments, one a pixel.
    pub moments: Vec<Moments>,
    /// Features, one a pixel, where the unit wants them.
    pub features: Vec<Features>,
    /// Counts of this row; times are left 0.
    pub statistics: UnitStatistics,
    /// Column, row and number of the first sample that was not finite: [`Prepared::sample`] replays it.
    pub first_rejected: Option<[u32; 3]>,
}

impl<'a> UnitRender<'a> {
    /// A unit of a prepared scene, which was loaded for the method of `settings`.
    #[must_use]
    pub fn new(prepared: &'a Prepared, settings: &'a RenderSettings, unit: &'a Unit) -> Self {
        Self {
            unit,
            integrator: Integrator::new(&prepared.0, &settings.method),
            sampler: sampler(settings),
            resolution: settings.resolution,
        }
    }

    /// Number of rows; of strips of several, where pixels share paths.
    #[must_use]
    pub fn rows(&self) -> u32 {
        if self.in_strips() { self.strips() } else { self.unit.id.rect.h }
    }

    /// Whether pixels share paths; by the textbook rule, which knows of no other pixel, they do not.
    fn in_strips(&self) -> bool {
        self.integrator.shares() && !matches!(self.unit.work, Work::Textbook { .. })
    }

    /// Render row or strip `row`, counted from the top of the unit.
    #[must_use]
    pub fn row(&self, row: u32) -> RowResult {
        let rect = self.unit.id.rect;
        let mut counters = Counters::default();
        let mut result = RowResult {
            moments: Vec::with_capacity(rect.w as usize),
            features: Vec::with_capacity(if self.unit.features { rect.w as usize } else { 0 }),
            statistics: UnitStatistics::default(),
            first_rejected: None,
        };
        let pixels = match self.unit.work {
            _ if self.in_strips() => self.in_regions(row, &mut counters),
            Work::Textbook { .. } => self.one_by_one(row, &mut counters),
            _ if self.integrator.has_wave() => self.in_waves(row, &mut counters),
            _ => self.one_by_one(row, &mut counters),
        };
        let top = if self.in_strips() { self.strip(row).0 } else { rect.y + row };
        for (i, done) in (0..).zip(pixels.into_iter().map(Pixel::finish)) {
            let (x, y) = (rect.x + i % rect.w, top + i / rect.w);
            result.statistics.samples += u64::from(done.moments.samples);
            result.statistics.rejected += u64::from(done.rejected);
            result.first_rejected = result.first_rejected.or(done.first_rejected.map(|sample| [x, y, sample]));
            result.moments.push(done.moments);
            if self.unit.features {
                result.features.push(done.features);
            }
        }
        result.statistics.rays = counters.rays;
        result.statistics.node_tests = counters.node_tests;
        result.statistics.primitive_tests = counters.primitive_tests;
        result
    }

    /// First sample and number of samples of a pixel of a row, where that is known beforehand.
    fn range(&self, row: u32, column: u32) -> (u32, u32) {
        match &self.unit.work {
            Work::Uniform { first, samples } => (*first, *samples),
            Work::PerPixel { first, batches } => {
                let index = (row * self.unit.id.rect.w + column) as usize;
                let batch = self.sampler.batch();
                (first[index] * batch, batches[index] * batch)
            }
            Work::Textbook { .. } | Work::Prepare { .. } => (0, 0),
        }
    }

    fn one_by_one(&self, row: u32, counters: &mut Counters) -> Vec<Pixel> {
        let rect = self.unit.id.rect;
        let (integrator, sampler) = (&self.integrator, &self.sampler);
        let render = |column: u32| {
            let mut pixel = Pixel::new(self.unit.features);
            let mut source = Source { integrator, sampler, pixel: [rect.x + column, rect.y + row], counters };
            match &self.unit.work {
                Work::Textbook { batch, tolerance, max_samples } => {
                    pixel.textbook(&mut source, *batch, *tolerance, *max_samples);
                }
                _ => {
                    let (first, samples) = self.range(row, column);
                    pixel.range(&mut source, first, samples);
                }
            }
            pixel
        };
        (0..rect.w).map(render).collect()
    }

    /// The row's samples, in order, many at once.
    fn in_waves(&self, row: u32, counters: &mut Counters) -> Vec<Pixel> {
        let rect = self.unit.id.rect;
        let mut pixels: Vec<Pixel> = (0..rect.w).map(|_| Pixel::new(self.unit.features)).collect();
        // Room to work in is made once a thread.
        let mut work = WORKSPACE.take().unwrap_or_default();
        for column in 0..rect.w {
            let (first, samples) = self.range(row, column);
            for (next, size) in pixel::batches(&self.sampler, first, samples) {
                for sample in next..next + size {
                    work.requests.push([rect.x + column, rect.y + row, sample]);
                    work.begins.push(if sample == next { size } else { 0 });
                    if work.requests.len() == REQUESTS {
                        self.flush(&mut work, &mut pixels, counters);
                    }
                }
            }
        }
        self.flush(&mut work, &mut pixels, counters);
        WORKSPACE.set(Some(work));
        pixels
    }

    /// Render what is asked for, and give it to its pixels.
    fn flush(&self, work: &mut Workspace, pixels: &mut [Pixel], counters: &mut Counters) {
        self.integrator.wave(&mut work.wave, &self.sampler, &work.requests, &[], self.unit.features, counters);
        for (i, (&[x, _, sample], &size)) in work.requests.iter().zip(&work.begins).enumerate() {
            let pixel = &mut pixels[(x - self.unit.id.rect.x) as usize];
            if size > 0 {
                pixel.begin(size);
            }
            pixel.take_traced(sample, &work.wave.traced(i));
        }
        work.requests.clear();
        work.begins.clear();
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
