//! What was measured of a job so far: cost, samples, errors, by frame.

use std::collections::{BTreeMap, BTreeSet};

use common::{
    adaptive::{self, FRAME_SHARE},
    job::{Quality, WorkerId},
    pass::{BATCH, Work},
    protocol::JobStatistics,
    tile::Rect,
};

use crate::{
    farm::TileKey,
    plan::{Field, Rule, Step},
    store::{TileRecord, TileSummary, WorkRecord},
};

/// Sums over the tiles of a job.
#[derive(Debug, Default)]
pub(super) struct Measure {
    /// Work and time of everything merged.
    pub(super) work: WorkRecord,
    /// By frame number.
    pub(super) frames: BTreeMap<u32, FrameMeasure>,
    /// Workers that handed in a result.
    pub(super) workers: BTreeSet<WorkerId>,
    /// What tiles are to have cost in the end, as their last plan foresees; tiles that are still to be planned
    /// from what they measured are not here.
    foreseen: BTreeMap<(u32, u32), Cost>,
}

/// Samples and processor seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Cost {
    pub(super) samples: f64,
    pub(super) cpu_seconds: f64,
}

/// Sums over the tiles of a frame.
#[derive(Debug, Default)]
pub(super) struct FrameMeasure {
    /// Grows with every pass that is merged: names the state of the picture.
    pub(super) revision: u64,
    pub(super) pixels: u64,
    pub(super) samples: u64,
    pub(super) max_samples: u32,
    pub(super) within: u64,
    pub(super) cpu_seconds: f64,
    errors: BTreeMap<u16, u64>,
}

impl Measure {
    /// Take in a tile's new record in place of its last one.
    pub(super) fn replace(&mut self, frame: u32, old: Option<&TileRecord>, new: &TileRecord) {
        let frame = self.frames.entry(frame).or_default();
        if let Some(old) = old {
            frame.remove(&old.summary, old.passes);
        }
        frame.add(&new.summary, new.passes);
        self.workers.extend(new.worker);
        let before = old.map(|old| old.work).unwrap_or_default();
        let (sum, new) = (&mut self.work, &new.work);
        frame.cpu_seconds += new.cpu_seconds - before.cpu_seconds;
        sum.samples += new.samples - before.samples.min(new.samples);
        sum.rays += new.rays - before.rays.min(new.rays);
        sum.node_tests += new.node_tests - before.node_tests.min(new.node_tests);
        sum.primitive_tests += new.primitive_tests - before.primitive_tests.min(new.primitive_tests);
        sum.rejected += new.rejected - before.rejected.min(new.rejected);
        sum.clamped += new.clamped - before.clamped;
        sum.cpu_seconds += new.cpu_seconds - before.cpu_seconds;
        sum.load_seconds += new.load_seconds - before.load_seconds;
        sum.build_seconds += new.build_seconds - before.build_seconds;
    }

    /// Note what a tile is to have cost in the end, as its plan from measurements says; `before` is what it
    /// cost so far.
    pub(super) fn foresee(&mut self, tile: TileKey, rect: Rect, before: &WorkRecord, step: &Step) {
        let done = before.samples as f64;
        let samples = match step {
            Step::Render { work, share } if *share > 0.0 => (done + samples_of(work, rect)) / share,
            _ => done,
        };
        let cost = Cost { samples, cpu_seconds: before.cpu_seconds + (samples - done) * before.per_sample() };
        self.foreseen.insert((tile.frame, tile.tile), cost);
    }

    /// What a job of so many frames of so many tiles and pixels is to have cost in the end; `None` before one
    /// frame is foreseen.
    pub(super) fn forecast(&self, rule: &Rule, frames: usize, tiles: usize, pixels: f64) -> Option<Cost> {
        let so_far = Cost { samples: self.work.samples as f64, cpu_seconds: self.work.cpu_seconds };
        let per_sample = self.work.per_sample();
        let pilot = f64::from(rule.batch()) * pixels;
        match *rule {
            _ if so_far.samples < pilot || per_sample == 0.0 => None,
            Rule::Uniform { samples, .. } => {
                let samples = f64::from(samples) * pixels * frames as f64;
                Some(Cost { samples, cpu_seconds: so_far.cpu_seconds + (samples - so_far.samples) * per_sample })
            }
            Rule::Budget { cpu_seconds, .. } => {
                let cpu_seconds = so_far.cpu_seconds.max(cpu_seconds);
                let samples = so_far.samples + (cpu_seconds - so_far.cpu_seconds) / per_sample;
                Some(Cost { samples, cpu_seconds })
            }
            Rule::Textbook { .. } => None,
            Rule::Adaptive { .. } => {
                // The mean of the frames that are foreseen whole stands for the others.
                let mut sums: BTreeMap<u32, (usize, Cost)> = BTreeMap::new();
                for (&(frame, _), cost) in &self.foreseen {
                    let (count, sum) = sums.entry(frame).or_default();
                    *count += 1;
                    sum.samples += cost.samples;
                    sum.cpu_seconds += cost.cpu_seconds;
                }
                let whole: Vec<Cost> = sums.values().filter(|(n, _)| *n == tiles).map(|(_, cost)| *cost).collect();
                let scale = frames as f64 / whole.len() as f64;
                (!whole.is_empty()).then(|| Cost {
                    samples: (whole.iter().map(|cost| cost.samples).sum::<f64>() * scale).max(so_far.samples),
                    cpu_seconds: (whole.iter().map(|cost| cost.cpu_seconds).sum::<f64>() * scale)
                        .max(so_far.cpu_seconds),
                })
            }
        }
    }

    /// As people see it.
    pub(super) fn statistics(&self, retries: u64) -> JobStatistics {
        let mut statistics = JobStatistics { retries, workers: self.workers.len() as u32, ..Default::default() };
        self.work.add_to(&mut statistics);
        statistics
    }

    /// Relative half-width that [`FRAME_SHARE`] of the measured pixels keep to, at most 2.2% above the exact
    /// quantile; a target that so many keep to is one. `None` where the intervals of more than the rest are
    /// not known.
    pub(super) fn error(&self, target: Option<f64>) -> Option<f64> {
        let mut errors: BTreeMap<u16, u64> = BTreeMap::new();
        for (&class, &count) in self.frames.values().flat_map(|frame| &frame.errors) {
            *errors.entry(class).or_default() += count;
        }
        let enough = |n: u64, all: u64| n as f64 >= FRAME_SHARE * all as f64;
        let all: u64 = errors.values().sum();
        let mut seen = 0;
        let (class, _) = errors.into_iter().find(|(_, count)| {
            seen += count;
            enough(seen, all)
        })?;
        let error = class_end(class)?;
        let within = self.frames.values().map(|frame| frame.within).sum();
        Some(target.filter(|_| enough(within, all)).map_or(error, |target| target.min(error)))
    }
}

impl FrameMeasure {
    fn add(&mut self, summary: &TileSummary, passes: u32) {
        self.revision += u64::from(passes);
        self.pixels += u64::from(summary.pixels);
        self.samples += summary.samples;
        self.max_samples = self.max_samples.max(summary.max_samples);
        self.within += u64::from(summary.within);
        for &(class, count) in &summary.errors {
            *self.errors.entry(class).or_default() += u64::from(count);
        }
    }

    fn remove(&mut self, summary: &TileSummary, passes: u32) {
        self.revision -= u64::from(passes);
        self.pixels -= u64::from(summary.pixels);
        self.samples -= summary.samples;
        self.within -= u64::from(summary.within);
        for &(class, count) in &summary.errors {
            let left = self.errors.entry(class).or_default();
            *left = left.saturating_sub(u64::from(count));
        }
    }
}

fn samples_of(work: &Work, rect: Rect) -> f64 {
    match work {
        Work::Uniform { samples, .. } => f64::from(*samples) * rect.area() as f64,
        Work::PerPixel { batches, .. } => batches.iter().map(|&n| f64::from(n)).sum::<f64>() * f64::from(BATCH),
        Work::Textbook { .. } | Work::Prepare { .. } => 0.0,
    }
}

const CLASSES_PER_DOUBLING: f64 = 32.0;
const CLASS_OF_ONE: f64 = 480.0;
const UNKNOWN: u16 = 1023;

fn class_of(error: f64) -> u16 {
    if error.is_finite() {
        let class = libm::floor(libm::log2(error) * CLASSES_PER_DOUBLING + CLASS_OF_ONE);
        class.clamp(0.0, f64::from(UNKNOWN - 1)) as u16
    } else {
        UNKNOWN
    }
}

fn class_end(class: u16) -> Option<f64> {
    (class < UNKNOWN).then(|| libm::exp2((f64::from(class) + 1.0 - CLASS_OF_ONE) / CLASSES_PER_DOUBLING))
}

/// The relative error a job asks for.
pub(super) fn target(quality: &Quality) -> Option<f64> {
    match quality {
        Quality::Noise { relative_error, .. } => Some(*relative_error),
        Quality::Samples { .. } | Quality::Time { .. } => None,
    }
}

/// A tile of a field in short. Its pixels are judged as the stopping rule judges them: at the end with all
/// that is known around the tile, before that by the tile alone.
pub(super) fn summarise(rule: &adaptive::Rule, field: Field<'_>, tile: Rect) -> TileSummary {
    let mut summary = TileSummary::default();
    let mut errors: BTreeMap<u16, u32> = BTreeMap::new();
    for (moments, verdict) in field.judge(rule, tile).filter(|(moments, _)| moments.samples > 0) {
        summary.pixels += 1;
        summary.samples += u64::from(moments.samples);
        summary.max_samples = summary.max_samples.max(moments.samples);
        summary.within += u32::from(verdict.met);
        *errors.entry(class_of(verdict.relative)).or_default() += 1;
    }
    summary.errors = errors.into_iter().collect();
    summary
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::{film::Moments, job::JobId};

    fn pixels(count: usize, samples: u32, m2: f64) -> Vec<Moments> {
        vec![Moments { samples, batches: samples / 16, mean: [1.0; 3], m2, ..Moments::default() }; count]
    }

    fn record(passes: u32, moments: &[Moments]) -> TileRecord {
        let rect = Rect::frame(moments.len() as u32, 1);
        let rule = Rule::shown(&Quality::default());
        let summary = summarise(&rule, Field::new(rect, moments), rect);
        let work = WorkRecord { samples: summary.samples, ..Default::default() };
        TileRecord { passes, work, summary, ..Default::default() }
    }

    #[test]
    fn a_tile_is_judged_with_the_variance_pooled_over_the_pixels_that_touch() {
        let mut moments = pixels(3, 64, 0.1);
        moments.push(Moments::default());
        let summary = record(1, &moments).summary;
        assert_eq!((summary.pixels, summary.samples, summary.max_samples, summary.within), (3, 192, 64, 3));
        // Student's quantiles 2.26 and 2.45 for 9 and 6 degrees of freedom, widened by 1% and by 1/9 and 1/6,
        // times sqrt(0.1 / (3 x 64)) = 0.0228: 0.058 and 0.066. Each pixel alone would have 3.18, and 0.098.
        for (class, _) in summary.errors {
            let end = class_end(class).unwrap();
            assert!((0.057..0.072).contains(&end), "{end}");
        }
        let strict = common::adaptive::Rule::new(0.06, 0.95, 4096, 16);
        let rect = Rect::frame(4, 1);
        assert_eq!(summarise(&strict, Field::new(rect, &moments), rect).within, 1, "the middle one alone");
    }

    #[test]
    fn a_later_pass_takes_the_place_of_the_one_before() {
        let mut measure = Measure::default();
        let first = record(1, &pixels(100, 64, 0.1));
        measure.replace(1, None, &first);
        let second = record(2, &pixels(100, 256, 0.1));
        measure.replace(1, Some(&first), &second);
        let frame = &measure.frames[&1];
        assert_eq!((frame.pixels, frame.samples, frame.max_samples, frame.within), (100, 25_600, 256, 100));
        assert_eq!((frame.revision, measure.work.samples), (2, 25_600));
        assert!(measure.error(None).unwrap() < 0.02);
    }

    #[test]
    fn the_error_is_what_99_percent_keep_to() {
        let mut measure = Measure::default();
        assert_eq!(measure.error(None), None);
        let of = |low: u32, high: u32, unknown: u32| TileRecord {
            summary: TileSummary {
                pixels: low + high + unknown,
                within: low,
                errors: vec![(class_of(0.05), low), (class_of(3.0), high), (class_of(f64::INFINITY), unknown)],
                ..Default::default()
            },
            ..Default::default()
        };
        let [few, more, unknown] = [of(990, 10, 0), of(989, 11, 0), of(989, 0, 11)];
        measure.replace(1, None, &few);
        let error = measure.error(None).unwrap();
        assert!((0.05..0.05 * 1.022).contains(&error), "{error}");
        assert_eq!(measure.error(Some(0.0501)), Some(0.0501), "a bound that 99% keep to");
        measure.replace(1, Some(&few), &more);
        let error = measure.error(Some(0.0501)).unwrap();
        assert!((3.0..3.0 * 1.022).contains(&error), "{error}");
        measure.replace(1, Some(&more), &unknown);
        assert_eq!(measure.error(None), None, "where more than 1% are unknown, nothing can be said");
    }

    #[test]
    fn a_forecast_takes_the_frames_that_are_foreseen_for_the_others() {
        let mut measure = Measure::default();
        let rule = Rule::Adaptive { relative_error: 0.1, confidence: 0.95, max_samples: 4096 };
        let rect = Rect::frame(10, 10);
        let record = |samples: u64| TileRecord {
            passes: 1,
            work: WorkRecord { samples, cpu_seconds: 1e-4 * samples as f64, ..Default::default() },
            ..Default::default()
        };
        measure.replace(1, None, &record(6400));
        measure.replace(1, None, &record(6400));
        assert_eq!(measure.forecast(&rule, 3, 2, 200.0), None, "nothing is planned yet");
        let key = |tile| TileKey { job: JobId(1), frame: 1, tile };
        let work = Work::PerPixel { first: vec![4; 100], batches: vec![2; 100] };
        let step = Step::Render { work, share: 0.5 };
        measure.foresee(key(0), rect, &record(6400).work, &step);
        assert_eq!(measure.forecast(&rule, 3, 2, 200.0), None, "one tile of two is no frame");
        measure.foresee(key(1), rect, &record(6400).work, &Step::Finished);
        // 6,400 + 3,200 samples are half of the one tile's; the other is done; three frames alike.
        let cost = measure.forecast(&rule, 3, 2, 200.0).unwrap();
        assert_eq!(cost.samples, 3.0 * (19_200.0 + 6400.0));
        assert!((cost.cpu_seconds - 7.68).abs() < 1e-9, "{cost:?}");
        let fixed = measure.forecast(&Rule::Uniform { samples: 256, batch: 16 }, 1, 2, 200.0).unwrap();
        assert_eq!(fixed.samples, 51_200.0);
        let budget = measure.forecast(&Rule::Budget { cpu_seconds: 9.0, max_samples: 64 }, 1, 2, 200.0).unwrap();
        assert_eq!(budget.cpu_seconds, 9.0);
    }
}
