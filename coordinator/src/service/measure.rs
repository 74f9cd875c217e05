//! What was measured of a job so far: cost, samples, errors, by frame.

use std::collections::{BTreeMap, BTreeSet};

use common::{
    film::Film,
    job::{Quality, WorkerId},
    protocol::JobStatistics,
};

use crate::{
    plan::interval::{self, Quantiles},
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
    errors: BTreeMap<u8, u64>,
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

    /// As people see it.
    pub(super) fn statistics(&self, retries: u64) -> JobStatistics {
        let mut statistics = JobStatistics { retries, workers: self.workers.len() as u32, ..Default::default() };
        self.work.add_to(&mut statistics);
        statistics
    }

    /// Relative half-width that 99% of the measured pixels keep to: the upper end of the class, 1.09 wide.
    pub(super) fn error(&self) -> Option<f64> {
        let mut errors: BTreeMap<u8, u64> = BTreeMap::new();
        for (&class, &count) in self.frames.values().flat_map(|frame| &frame.errors) {
            *errors.entry(class).or_default() += count;
        }
        let all: u64 = errors.values().sum();
        let mut seen = 0;
        for (class, count) in errors {
            seen += count;
            if seen * 100 >= all * 99 {
                return Some(class_end(class));
            }
        }
        None
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

const CLASSES_PER_DOUBLING: f64 = 8.0;
const CLASS_OF_ONE: f64 = 80.0;

fn class_of(error: f64) -> u8 {
    let class = libm::floor(libm::log2(error) * CLASSES_PER_DOUBLING + CLASS_OF_ONE);
    class.clamp(0.0, 255.0) as u8
}

fn class_end(class: u8) -> f64 {
    libm::exp2((f64::from(class) + 1.0 - CLASS_OF_ONE) / CLASSES_PER_DOUBLING)
}

/// Confidence of a job's intervals.
pub(super) fn confidence(quality: &Quality) -> f64 {
    match quality {
        Quality::Noise { confidence, .. } => *confidence,
        Quality::Samples { .. } | Quality::Time { .. } => 0.95,
    }
}

/// The relative error a job asks for.
pub(super) fn target(quality: &Quality) -> Option<f64> {
    match quality {
        Quality::Noise { relative_error, .. } => Some(*relative_error),
        Quality::Samples { .. } | Quality::Time { .. } => None,
    }
}

/// A film in short.
pub(super) fn summarise(film: &Film, quality: &Quality) -> TileSummary {
    let mut quantiles = Quantiles::new(confidence(quality));
    let target = target(quality).unwrap_or(0.0);
    let mut summary = TileSummary::default();
    let mut errors: BTreeMap<u8, u32> = BTreeMap::new();
    for moments in &film.moments {
        summary.pixels += u32::from(moments.samples > 0);
        summary.samples += u64::from(moments.samples);
        summary.max_samples = summary.max_samples.max(moments.samples);
        if let Some(half_width) = quantiles.half_width(moments) {
            let error = interval::relative(half_width, moments.luminance());
            summary.within += u32::from(error <= target);
            *errors.entry(class_of(error)).or_default() += 1;
        }
    }
    summary.errors = errors.into_iter().collect();
    summary
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::film::Moments;

    fn record(passes: u32, samples: u32, deviation: f64) -> TileRecord {
        let moments = (0..100)
            .map(|i| Moments {
                samples,
                batches: 4,
                mean: [1.0; 3],
                m2: if i == 0 { 100.0 } else { deviation },
                ..Moments::default()
            })
            .collect();
        let summary = summarise(&Film { moments, features: Vec::new() }, &Quality::default());
        TileRecord {
            passes,
            work: WorkRecord { samples: 100 * u64::from(samples), ..Default::default() },
            summary,
            ..Default::default()
        }
    }

    #[test]
    fn the_error_is_what_99_percent_keep_to() {
        let mut measure = Measure::default();
        assert_eq!(measure.error(), None);
        let first = record(1, 64, 0.1);
        measure.replace(1, None, &first);
        // Half-width 3.182 sqrt(0.1 / (3 x 64)) = 0.0726 for 99 of the 100 pixels.
        let error = measure.error().unwrap();
        assert!((0.0726..0.0726 * 1.1).contains(&error), "{error}");
        let second = record(2, 256, 0.1);
        measure.replace(1, Some(&first), &second);
        assert!((0.0363..0.0363 * 1.1).contains(&measure.error().unwrap()));
        let frame = &measure.frames[&1];
        assert_eq!((frame.pixels, frame.samples, frame.max_samples, frame.within), (100, 25_600, 256, 99));
        assert_eq!((frame.revision, measure.work.samples), (2, 25_600));
    }
}
