//! A scene made ready for one method, and what a budget of samples gives there.

use std::time::Instant;

use common::{
    film::Moments,
    job::{JobId, JobRequest, Quality},
    method::{Adaptive, Direct, Method},
    pass::{BATCH, Work},
    plan::{Facts, Trial},
    protocol::{RenderSettings, Unit, UnitId},
    tile::Rect,
};
use coordinator::plan::{self, Field, Step, budget};
use tracer::{Prepared, UnitRender};
use worker::clock::thread_seconds;

use crate::{bundle::Bundle, error::Failure, parallel, request};

/// A scene ready to be rendered by one method.
pub struct Stage {
    settings: RenderSettings,
    region: Rect,
    prepared: Prepared,
    threads: usize,
    /// Most samples of a pixel where the method adapts.
    most: u32,
    /// Seconds that loading and building took.
    pub build_seconds: f64,
}

/// What a budget gave.
pub struct Run {
    /// Pixels of the region, row by row.
    pub pixels: Vec<Moments>,
    /// Processor seconds of all threads, and of planning.
    pub cpu_seconds: f64,
    /// Samples that were taken.
    pub samples: u64,
}

impl Stage {
    /// Make a scene ready for the method that `request` asks for.
    ///
    /// # Errors
    /// A scene or a method that cannot be rendered.
    pub fn open(bundle: &mut Bundle, request: &JobRequest, most: u32, threads: usize) -> Result<Self, Failure> {
        let started = Instant::now();
        let method = request::method_of(request, bundle);
        let frame = request::first_frame(request, bundle);
        let resolution = bundle.resolution(request);
        let region = request.region(resolution)?;
        let mut prepared = bundle.load(request)?.build();
        let mut settings = RenderSettings { frame, resolution, method, seed: 0, batch: BATCH, batches_per_set: 1 };
        if settings.method.direct == Direct::Auto {
            // As a worker does before a job.
            let named = request.method.clone().or(&bundle.scene.settings.method);
            let plan = tracer::pilot::choose(&prepared, &settings, &Trial { region, named, quality: None });
            if let Some(chosen) = prepared.with_method(&settings.method, &plan.method) {
                (prepared, settings.method) = (chosen, plan.method);
            }
        }
        Ok(Self { settings, region, prepared, threads, most, build_seconds: started.elapsed().as_secs_f64() })
    }

    /// The same scene under another method, built once; `None` where it would have to be built anew.
    #[must_use]
    pub fn with_method(&self, method: &Method) -> Option<Self> {
        let prepared = self.prepared.with_method(&self.settings.method, method)?;
        let settings = RenderSettings { method: method.clone(), ..self.settings.clone() };
        Some(Self { settings, prepared, ..*self })
    }

    /// What is in the scene.
    #[must_use]
    pub fn facts(&self) -> &Facts {
        self.prepared.facts()
    }

    /// Work of a sample as the pilot counts it, about nanoseconds.
    #[must_use]
    pub fn counted_work(&self) -> f64 {
        tracer::pilot::counted_work(&self.prepared, &self.settings, self.region)
    }

    /// The method, every choice made.
    #[must_use]
    pub fn method(&self) -> &Method {
        &self.settings.method
    }

    /// What its units share.
    #[must_use]
    pub fn settings(&self) -> &RenderSettings {
        &self.settings
    }

    /// The part of the frame that is rendered.
    #[must_use]
    pub fn region(&self) -> Rect {
        self.region
    }

    /// The fewest samples of a pixel that the method can do with.
    #[must_use]
    pub fn least(&self) -> u32 {
        if self.adapts() { common::adaptive::PILOT_BATCHES * BATCH } else { 1 }
    }

    fn adapts(&self) -> bool {
        self.settings.method.adaptive == Some(Adaptive::On)
    }

    /// Spend `samples` for each pixel: on each alike; under the textbook rule at most so many; under ours so many on
    /// average, where they are needed most.
    ///
    /// # Errors
    /// A budget that the method cannot be used with.
    pub fn run(&self, samples: u32, seed: u64) -> Result<Run, Failure> {
        let mut run = Run { pixels: vec![Moments::default(); self.region.area()], cpu_seconds: 0.0, samples: 0 };
        if self.adapts() {
            self.adaptive(&mut run, samples, seed);
            return Ok(run);
        }
        let rule = plan::Rule::of(&Quality::Samples { samples }, self.method())?;
        let settings = RenderSettings {
            seed,
            batch: rule.batch(),
            batches_per_set: rule.batches_per_set(),
            ..self.settings.clone()
        };
        let work = match rule {
            plan::Rule::Textbook { batch, tolerance, max_samples } => Work::Textbook { batch, tolerance, max_samples },
            _ => Work::Uniform { first: 0, samples },
        };
        self.pass(&mut run, &settings, work);
        Ok(run)
    }

    /// `samples` of each pixel, `stride` of them at a time; `tick` is told how many were taken.
    pub fn long(&self, samples: u32, stride: u32, seed: u64, tick: &mut dyn FnMut(u64)) -> Vec<Moments> {
        let settings = RenderSettings { seed, ..self.settings.clone() };
        let mut run = Run { pixels: vec![Moments::default(); self.region.area()], cpu_seconds: 0.0, samples: 0 };
        let mut first = 0;
        while first < samples {
            let before = run.samples;
            let count = stride.min(samples - first);
            self.pass(&mut run, &settings, Work::Uniform { first, samples: count });
            first += count;
            tick(run.samples - before);
        }
        run.pixels
    }

    /// What a farm does under a budget of processor seconds, a sample costing one: so that the same budget gives the
    /// same picture.
    fn adaptive(&self, run: &mut Run, samples: u32, seed: u64) {
        let settings = RenderSettings { seed, ..self.settings.clone() };
        let budget = f64::from(samples) * self.region.area() as f64;
        self.pass(run, &settings, Work::Uniform { first: 0, samples: self.least() });
        let planned = thread_seconds();
        let mut cpu_seconds = 0.0;
        loop {
            let left = budget - run.samples as f64;
            if left < budget::LEAST_SHARE * budget {
                break;
            }
            let field = Field::new(self.region, &run.pixels);
            let Some(aim) = budget::aim(field, &[(self.region, 1.0)], self.most, left) else { break };
            let Step::Render { work, .. } = budget::next(aim, self.most, self.region, field) else { break };
            let before = (thread_seconds(), run.cpu_seconds);
            self.pass(run, &settings, work);
            cpu_seconds -= thread_seconds() - before.0;
        }
        // Planning alone: rendering has been counted, and some of it was on this thread.
        cpu_seconds += thread_seconds() - planned;
        run.cpu_seconds += cpu_seconds.max(0.0);
    }

    fn pass(&self, run: &mut Run, settings: &RenderSettings, work: Work) {
        let id = UnitId { job: JobId(1), frame: settings.frame, tile: 0, pass: 0, rect: self.region };
        let unit = Unit { id, work, features: false };
        let render = UnitRender::new(&self.prepared, settings, &unit);
        let rows = parallel::on(self.threads, render.rows() as usize, |row| {
            let started = thread_seconds();
            let result = render.row(row as u32);
            (result.moments, result.statistics.samples, thread_seconds() - started)
        });
        let mut pixels = run.pixels.iter_mut();
        for (moments, samples, seconds) in rows {
            // The moments end first, and no pixel is passed over.
            for (later, pixel) in moments.into_iter().zip(pixels.by_ref()) {
                *pixel = pixel.merge(later);
            }
            run.samples += samples;
            run.cpu_seconds += seconds;
        }
    }
}
