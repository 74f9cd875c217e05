//! Which samples a tile gets next. Pure: statistics in, work out.
//!
//! The farm asks once a pass, when the tile (and, for a rule that looks across borders, its neighbours)
//! has finished the one before. A rule knows nothing of workers, leases, stores or clocks.

pub mod budget;
mod field;
mod planned;

use common::{
    adaptive,
    job::{DEFAULT_CONFIDENCE, FieldError, Quality},
    method::{Adaptive, Method},
    pass::{self, Work},
    tile::Rect,
};
use serde::{Deserialize, Serialize};

pub use field::{Field, Surroundings, judge_anew};
pub use planned::next;

/// How the passes of a job's tiles follow from its quality target and method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "snake_case")]
pub enum Rule {
    /// The same number of samples for every pixel, in passes of growing size.
    Uniform {
        /// Samples of a pixel.
        samples: u32,
        /// Samples of a batch.
        batch: u32,
    },
    /// The textbook rule: every pixel for itself, in one pass.
    Textbook {
        /// Samples between two looks at the error.
        batch: u32,
        /// Half-width of the 95% interval relative to the mean.
        tolerance: f64,
        /// Most samples of a pixel.
        max_samples: u32,
    },
    /// Passes planned from the measured error of a pixel and its neighbours: [`common::adaptive`].
    Adaptive {
        /// Half-width of the interval relative to the luminance.
        relative_error: f64,
        /// Share of intervals that are to hold the truth.
        confidence: f64,
        /// Most samples of a pixel.
        max_samples: u32,
    },
    /// Rounds over whole frames, each sized by what is left of a budget: [`budget`].
    Budget {
        /// Processor seconds of all frames.
        cpu_seconds: f64,
        /// Most samples of a pixel.
        max_samples: u32,
    },
}

/// Share of a tile's work that its pilot is taken for, until more is known.
const PILOT_SHARE: f64 = 0.2;

/// What a rule says about a tile.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// Render this; when it is merged, `share` of the tile's work is done.
    Render {
        /// The samples.
        work: Work,
        /// Share of the tile's work that is done after it, 0 to 1.
        share: f64,
    },
    /// The tile is finished.
    Finished,
}

/// Pixels that a rule may look across a tile's border.
pub const RING: u32 = 1;

impl Rule {
    /// The rule for a quality target and a method.
    ///
    /// # Errors
    /// A target and a method that contradict each other, by field.
    pub fn of(quality: &Quality, method: &Method) -> Result<Rule, FieldError> {
        match (quality, method.adaptive) {
            (&Quality::Samples { samples }, None | Some(Adaptive::Off)) => {
                Ok(Rule::Uniform { samples, batch: pass::batch_for(samples) })
            }
            (&Quality::Samples { samples }, Some(Adaptive::Textbook)) => Ok(Rule::Textbook {
                batch: method.adaptive_batch,
                tolerance: method.adaptive_tolerance,
                max_samples: samples,
            }),
            (Quality::Samples { .. }, Some(Adaptive::On)) => Err(FieldError::new(
                "method.adaptive",
                "a fixed number of samples leaves nothing to adapt; ask for a noise target, or leave this out",
            )),
            (&Quality::Noise { relative_error, confidence, max_samples }, None | Some(Adaptive::On)) => {
                Ok(Rule::Adaptive { relative_error, confidence, max_samples })
            }
            (&Quality::Noise { relative_error, max_samples, .. }, Some(Adaptive::Textbook)) => {
                Ok(Rule::Textbook { batch: method.adaptive_batch, tolerance: relative_error, max_samples })
            }
            (Quality::Noise { .. }, Some(Adaptive::Off)) => Err(FieldError::new(
                "method.adaptive",
                "a noise target needs adaptive sampling; ask for a number of samples, or leave this out",
            )),
            (&Quality::Time { cpu_seconds, max_samples }, None | Some(Adaptive::On)) => {
                Ok(Rule::Budget { cpu_seconds, max_samples })
            }
            (Quality::Time { .. }, Some(Adaptive::Off | Adaptive::Textbook)) => Err(FieldError::new(
                "method.adaptive",
                "a time target needs adaptive sampling; ask for a number of samples, or leave this out",
            )),
        }
    }

    /// Check that a job under this rule can go on to a finer target and keep every sample.
    ///
    /// A fixed count raised to another has the bits of a job that asked for it at once. Under any other finer
    /// target all pixels are judged anew.
    ///
    /// # Errors
    /// The target cannot be continued to, by field.
    pub fn continued(&self, finer: &Rule) -> Result<(), FieldError> {
        match (self, finer) {
            (old, new) if old == new => Ok(()),
            (&Rule::Uniform { samples: old, batch }, &Rule::Uniform { samples: new, batch: new_batch }) => {
                let boundary = (0..32).any(|pass| pass::uniform_end(pass, u32::MAX, batch) == old);
                if new < old {
                    let message = format!("{new} samples is less than the {old} the job already asks for");
                    Err(FieldError::new("quality.samples", message))
                } else if boundary && batch == new_batch {
                    Ok(())
                } else {
                    let why = "cannot be continued; 64, 256, 1024 and so on can. Submit a new job instead";
                    Err(FieldError::new("quality.samples", format!("{old} samples {why}")))
                }
            }
            (Rule::Adaptive { relative_error, confidence, max_samples }, Rule::Adaptive { .. }) => {
                let Rule::Adaptive { relative_error: error, confidence: share, max_samples: most } = finer else {
                    return Ok(());
                };
                if error <= relative_error && share >= confidence && most >= max_samples {
                    Ok(())
                } else {
                    let message = "is not finer than the job's; a job keeps what it has reached";
                    Err(FieldError::new("quality", message))
                }
            }
            (Rule::Budget { cpu_seconds: old, .. }, Rule::Budget { cpu_seconds: new, .. }) if new < old => {
                let message = format!("{new} processor seconds is less than the {old} the job already asks for");
                Err(FieldError::new("quality.cpu_seconds", message))
            }
            (Rule::Budget { .. }, Rule::Budget { .. } | Rule::Adaptive { .. }) => Ok(()),
            (Rule::Uniform { batch, .. }, Rule::Adaptive { .. } | Rule::Budget { .. }) if *batch == pass::BATCH => {
                Ok(())
            }
            _ => {
                let message = "the job's target cannot be continued to this one; submit a new job";
                Err(FieldError::new("quality.target", message))
            }
        }
    }

    /// The rule that intervals are shown by, as far as they have been measured: the job's own where that has a
    /// noise target, else one that any interval keeps to.
    #[must_use]
    pub fn shown(quality: &Quality) -> adaptive::Rule {
        match *quality {
            Quality::Noise { relative_error, confidence, max_samples } => {
                adaptive::Rule::new(relative_error, confidence, max_samples, pass::BATCH)
            }
            Quality::Samples { .. } | Quality::Time { .. } => {
                adaptive::Rule::new(f64::INFINITY, DEFAULT_CONFIDENCE, u32::MAX, pass::BATCH)
            }
        }
    }

    /// Samples of a batch, part of the settings that units share.
    #[must_use]
    pub fn batch(&self) -> u32 {
        match *self {
            Rule::Uniform { batch, .. } => batch,
            Rule::Textbook { .. } | Rule::Adaptive { .. } | Rule::Budget { .. } => pass::BATCH,
        }
    }

    /// Batches whose points are spread evenly together, another part of them. A job whose target becomes a noise
    /// target when it is done goes on with batches by themselves, none of which has been drawn before: batch `b` then has
    /// the key of set `b`, and there were fewer sets than batches.
    #[must_use]
    pub fn batches_per_set(&self) -> u32 {
        match self {
            Rule::Uniform { .. } => pass::BATCHES_PER_SET,
            Rule::Textbook { .. } | Rule::Adaptive { .. } | Rule::Budget { .. } => 1,
        }
    }

    /// Share of a tile's work that is done after so many passes, where that follows from their number; a
    /// finer target makes it less than it was.
    #[must_use]
    pub fn share(&self, passes: u32) -> Option<f64> {
        match *self {
            _ if passes == 0 => Some(0.0),
            Rule::Uniform { samples, batch } => {
                Some(f64::from(pass::uniform_end(passes - 1, samples, batch)) / f64::from(samples))
            }
            Rule::Textbook { .. } => Some(1.0),
            Rule::Adaptive { .. } | Rule::Budget { .. } => None,
        }
    }

    /// Whether the next pass depends on what was measured in the tile and around it. If so, a tile's pass
    /// is planned only when its neighbours have finished the one before.
    #[must_use]
    pub fn looks_around(&self) -> bool {
        match self {
            Rule::Uniform { .. } | Rule::Textbook { .. } => false,
            Rule::Adaptive { .. } | Rule::Budget { .. } => true,
        }
    }

    /// Whether a frame whose tiles are all finished must be gone over again, with every pixel judged anew:
    /// [`adaptive::Rule::unsettled`].
    #[must_use]
    pub fn unsettled(&self, verdicts: impl Iterator<Item = (u32, adaptive::Verdict)>) -> bool {
        let Rule::Adaptive { relative_error, confidence, max_samples } = *self else { return false };
        adaptive::Rule::new(relative_error, confidence, max_samples, pass::BATCH).unsettled(verdicts)
    }

    /// Plan pass `pass` of a tile. `around` is given where [`Rule::looks_around`] and `pass` is above 0.
    #[must_use]
    pub fn step(&self, pass: u32, rect: Rect, around: Option<&Surroundings>) -> Step {
        match *self {
            Rule::Uniform { samples, batch } => match pass::uniform_pass(pass, samples, batch) {
                Some(work) => Step::Render { work, share: self.share(pass + 1).unwrap_or(1.0) },
                None => Step::Finished,
            },
            Rule::Textbook { batch, tolerance, max_samples } => match pass {
                0 => Step::Render { work: Work::Textbook { batch, tolerance, max_samples }, share: 1.0 },
                _ => Step::Finished,
            },
            // Further passes are those of rounds: `budget::next`.
            Rule::Budget { max_samples, .. } => match pass {
                0 => {
                    let samples = adaptive::PILOT_BATCHES.min(max_samples.div_ceil(pass::BATCH)) * pass::BATCH;
                    Step::Render { work: Work::Uniform { first: 0, samples }, share: PILOT_SHARE }
                }
                _ => Step::Finished,
            },
            Rule::Adaptive { relative_error, confidence, max_samples } => {
                let rule = adaptive::Rule::new(relative_error, confidence, max_samples, pass::BATCH);
                match (pass, around) {
                    (0, _) => {
                        let samples = rule.pilot() * pass::BATCH;
                        Step::Render { work: Work::Uniform { first: 0, samples }, share: PILOT_SHARE }
                    }
                    (_, Some(around)) => planned::next(&rule, rect, around.field()),
                    // Asked without the measurements it needs: nothing more can be said to be wanted.
                    (_, None) => Step::Finished,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn method(adaptive: Option<Adaptive>) -> Method {
        Method { adaptive, ..Method::default() }
    }

    #[test]
    fn targets_and_methods_that_agree_give_a_rule_and_others_name_the_field() {
        let samples = Quality::Samples { samples: 64 };
        let noise = Quality::default();
        let time = Quality::Time { cpu_seconds: 1.0, max_samples: 64 };
        for (quality, adaptive, expected) in [
            (&samples, None, Ok(Rule::Uniform { samples: 64, batch: 16 })),
            (&samples, Some(Adaptive::Off), Ok(Rule::Uniform { samples: 64, batch: 16 })),
            (&samples, Some(Adaptive::Textbook), Ok(Rule::Textbook { batch: 32, tolerance: 0.05, max_samples: 64 })),
            (&samples, Some(Adaptive::On), Err("method.adaptive")),
            (&noise, None, Ok(Rule::Adaptive { relative_error: 0.1, confidence: 0.95, max_samples: 4096 })),
            (&noise, Some(Adaptive::Textbook), Ok(Rule::Textbook { batch: 32, tolerance: 0.1, max_samples: 4096 })),
            (&noise, Some(Adaptive::Off), Err("method.adaptive")),
            (&time, None, Ok(Rule::Budget { cpu_seconds: 1.0, max_samples: 64 })),
            (&time, Some(Adaptive::Textbook), Err("method.adaptive")),
        ] {
            let found = Rule::of(quality, &method(adaptive));
            assert_eq!(found.map_err(|e| e.field), expected.map_err(String::from), "{quality:?} {adaptive:?}");
        }
    }

    #[test]
    fn a_fixed_count_ends_with_the_whole_share() {
        let rule = Rule::Uniform { samples: 100, batch: 16 };
        let rect = Rect::frame(8, 8);
        let mut last = 0.0;
        for pass in 0.. {
            let Step::Render { share, .. } = rule.step(pass, rect, None) else { break };
            assert!(share > last);
            last = share;
        }
        assert_eq!(last, 1.0);
    }

    #[test]
    fn only_counts_at_the_end_of_a_full_pass_can_be_raised() {
        let uniform = |samples| Rule::Uniform { samples, batch: pass::batch_for(samples) };
        assert!(uniform(64).continued(&uniform(256)).is_ok());
        assert!(uniform(64).continued(&uniform(64)).is_ok());
        assert!(uniform(64).continued(&uniform(100)).is_ok());
        for (old, new) in [(100, 256), (64, 32), (32, 64)] {
            let error = uniform(old).continued(&uniform(new)).unwrap_err();
            assert_eq!(error.field, "quality.samples", "{old} to {new}");
        }
    }

    #[test]
    fn a_target_can_be_continued_to_a_finer_one_only() {
        let noise = |relative_error, max_samples| Rule::Adaptive { relative_error, confidence: 0.95, max_samples };
        let time = |cpu_seconds| Rule::Budget { cpu_seconds, max_samples: 4096 };
        let samples = |samples| Rule::Uniform { samples, batch: pass::batch_for(samples) };
        for (old, new, refused) in [
            (noise(0.1, 512), noise(0.05, 512), None),
            (noise(0.1, 512), noise(0.1, 1024), None),
            (noise(0.1, 512), noise(0.2, 512), Some("quality")),
            (noise(0.1, 512), noise(0.05, 256), Some("quality")),
            (noise(0.1, 512), samples(1024), Some("quality.target")),
            (samples(64), noise(0.1, 512), None),
            (samples(32), noise(0.1, 512), Some("quality.target")),
            (time(3.0), time(4.0), None),
            (time(3.0), time(2.0), Some("quality.cpu_seconds")),
            (time(3.0), noise(0.1, 512), None),
        ] {
            let found = old.continued(&new).err().map(|error| error.field);
            assert_eq!(found.as_deref(), refused, "{old:?} to {new:?}");
        }
    }

    #[test]
    fn a_frame_is_gone_over_again_while_more_than_1_percent_can_still_be_helped() {
        let rule = Rule::Adaptive { relative_error: 0.1, confidence: 0.95, max_samples: 1024 };
        let verdict =
            |met| adaptive::Verdict { half_width: 1.0, relative: 1.0, standard_error: 0.5, met, batches: 4, goal: 8 };
        let frame = |helpable: usize, full: usize| {
            (0..1000).map(move |i| match i {
                _ if i < helpable => (4, verdict(false)),
                _ if i < helpable + full => (64, verdict(false)),
                _ => (4, verdict(true)),
            })
        };
        for (helpable, full, expected, why) in [
            (11, 0, true, "the target is missed"),
            (10, 0, false, "99% is what is asked for"),
            (6, 5, true, "the target can be met by those that can be helped"),
            (0, 500, false, "nothing helps at the most samples"),
            (10, 500, false, "the target cannot be met, and few can be helped"),
            (11, 500, true, "the target cannot be met, but many can be helped"),
        ] {
            assert_eq!(rule.unsettled(frame(helpable, full)), expected, "{why}");
        }
        assert!(!Rule::Uniform { samples: 64, batch: 16 }.unsettled(frame(500, 0)));
    }
}
