//! Which samples of a pixel a unit computes, and the fixed schedule of passes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::plan::Trial;

/// Samples of one batch where nothing else is asked for: one scrambled Sobol' set of this size.
pub const BATCH: u32 = 16;

/// Batches of a set in a fixed number of samples: 64 of them are spread evenly as well as each sixteen. How many
/// samples there will be does not depend on what comes out, so nothing is lost where their spread makes errors out to
/// be larger than they are (docs/accuracy.md measures by how much); a rule that stops by it would stop late.
pub const BATCHES_PER_SET: u32 = 4;

/// The samples a unit computes for its pixels. A pixel's samples are numbered from 0; sample `s` is
/// point `s % batch` of batch `s / batch`, and is the same point whatever unit computes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Work {
    /// The same range for every pixel.
    Uniform {
        /// First sample; a multiple of the batch size.
        first: u32,
        /// Number of samples, at least 1; the last batch may be short.
        samples: u32,
    },
    /// A range of whole batches for each pixel, in row order of the unit's rectangle.
    PerPixel {
        /// First batch of each pixel.
        first: Vec<u32>,
        /// Batches of each pixel; 0 leaves the pixel as it is.
        batches: Vec<u32>,
    },
    /// From sample 0 on, until the textbook rule is met for the pixel alone.
    Textbook {
        /// Samples between two looks at the error.
        batch: u32,
        /// Stop when 1.96 s / sqrt(n) <= tolerance x mean.
        tolerance: f64,
        /// Stop at this many samples in any case.
        max_samples: u32,
    },
    /// No pixels: the scene's facts and the choice of a method, a [`crate::protocol::Preparation`].
    Prepare {
        /// What is open.
        trial: Trial,
    },
}

/// The pass of the unit that prepares a job. It has the rectangle of the first frame's first tile.
pub const PREPARE_PASS: u32 = u32::MAX;

impl Work {
    /// Most samples any pixel may get from this work.
    #[must_use]
    pub fn most_samples(&self, batch: u32) -> u64 {
        match self {
            Work::Uniform { samples, .. } => u64::from(*samples),
            Work::PerPixel { batches, .. } => u64::from(batches.iter().copied().max().unwrap_or(0)) * u64::from(batch),
            Work::Textbook { max_samples, .. } => u64::from(*max_samples),
            Work::Prepare { .. } => 0,
        }
    }

    /// The same work for a sub-rectangle: `rows` picks the pixels, by index into the whole, in row order.
    #[must_use]
    pub fn select(&self, pixels: impl Iterator<Item = usize>) -> Work {
        match self {
            Work::PerPixel { first, batches } => {
                let (first, batches) = pixels.map(|i| (first[i], batches[i])).unzip();
                Work::PerPixel { first, batches }
            }
            other => other.clone(),
        }
    }
}

/// Batch size for a fixed number of samples: [`BATCH`], or less so that at least four batches (and an
/// error estimate) exist. From 64 samples on it is always [`BATCH`], so that 64 can be continued to 256.
#[must_use]
pub fn batch_for(samples: u32) -> u32 {
    let quarter = (samples / 4).max(1);
    let power = 1 << (31 - quarter.leading_zeros());
    BATCH.min(power)
}

/// Samples that a pixel has after pass `pass` of a fixed count of `samples`: 1, 4, 16, ... batches, then
/// the count itself.
///
/// The first pass gives a preview soon; the growth keeps the number of passes small. Boundaries do not
/// depend on `samples`, so that a job continued to a higher count merges in the same order, and has the
/// same bits, as one that asked for it at once.
#[must_use]
pub fn uniform_end(pass: u32, samples: u32, batch: u32) -> u32 {
    let end = 4u64.checked_pow(pass).and_then(|n| n.checked_mul(u64::from(batch))).unwrap_or(u64::MAX);
    end.min(u64::from(samples)) as u32
}

/// The work of pass `pass` of a fixed count; `None` when the count is reached.
#[must_use]
pub fn uniform_pass(pass: u32, samples: u32, batch: u32) -> Option<Work> {
    let first = if pass == 0 { 0 } else { uniform_end(pass - 1, samples, batch) };
    let end = uniform_end(pass, samples, batch);
    (first < end).then_some(Work::Uniform { first, samples: end - first })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn passes_take_every_sample_once_and_begin_at_batches(samples in 1u32..100_000) {
            let batch = batch_for(samples);
            prop_assert!(batch.is_power_of_two() && batch <= BATCH);
            let mut next = 0;
            for pass in 0.. {
                let Some(Work::Uniform { first, samples }) = uniform_pass(pass, samples, batch) else { break };
                prop_assert_eq!(first, next);
                prop_assert_eq!(first % batch, 0);
                next = first + samples;
            }
            prop_assert_eq!(next, samples);
        }
    }

    #[test]
    fn a_continued_job_has_the_passes_of_one_asked_at_once() {
        assert_eq!(batch_for(64), batch_for(256));
        for pass in 0..2 {
            assert_eq!(uniform_pass(pass, 64, BATCH), uniform_pass(pass, 256, BATCH));
        }
        assert_eq!(uniform_pass(2, 64, BATCH), None);
        assert_eq!(uniform_pass(2, 256, BATCH), Some(Work::Uniform { first: 64, samples: 192 }));
    }

    #[test]
    fn small_counts_still_have_four_batches() {
        assert_eq!([1, 2, 4, 8, 16, 32, 64, 1000].map(batch_for), [1, 1, 1, 2, 4, 8, 16, 16]);
    }

    #[test]
    fn the_largest_count_does_not_overflow() {
        assert_eq!(uniform_end(40, u32::MAX, BATCH), u32::MAX);
    }
}
