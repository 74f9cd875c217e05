//! The stopping rules on pixels whose truth is known.
//!
//! Ours is [`common::adaptive::Rule`] under the planner of the coordinator, on frames whose pixels draw from a
//! [`Truth`] instead of a scene; the textbook rule looks at every pixel by itself.

use common::{adaptive::Rule, film::Moments, pass::Work, tile::Rect};

use super::{
    parallel,
    refine::{intervals, refine},
    truth::Truth,
};
use crate::stability::random::Random;

/// Samples between two looks of the textbook rule.
pub const TEXTBOOK_BATCH: u32 = 32;
/// Edge of a simulated frame, pixels.
pub const EDGE: u32 = 15;

/// What surrounds the pixels that are studied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Around {
    /// Every pixel of the frame is of the same truth, and all are studied.
    Alike,
    /// Every third pixel of every third row; the eight around each have almost no noise.
    Quiet,
    /// The left half of the frame, up to a border beyond which pixels have almost no noise; those at the
    /// border are studied.
    Border,
}

impl Around {
    fn studied(self, (x, y): (u32, u32)) -> bool {
        match self {
            Around::Alike => true,
            Around::Quiet => x % 3 == 1 && y % 3 == 1,
            Around::Border => x == EDGE / 2,
        }
    }

    fn truth(self, truth: Truth, (x, y): (u32, u32)) -> Truth {
        let noisy = match self {
            Around::Border => x <= EDGE / 2,
            _ => self.studied((x, y)),
        };
        if noisy { truth } else { Truth::Quiet }
    }
}

/// What became of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct End {
    /// Samples taken.
    pub samples: f64,
    /// Estimate; the truth is 1.
    pub mean: f64,
    /// Half-width of its final interval.
    pub half_width: f64,
}

/// What a rule did over many pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Outcome {
    /// Share of final intervals that hold the truth.
    pub coverage: f64,
    /// Standard error of `coverage`, from the spread between frames.
    pub coverage_error: f64,
    /// Mean over pixels, every pixel weighing the same, as a viewer sees it; the truth is 1.
    pub mean: f64,
    /// Standard error of `mean`, likewise.
    pub mean_error: f64,
    /// Mean samples of a pixel.
    pub samples: f64,
}

impl Outcome {
    /// Of the studied pixels of each frame.
    fn of(frames: &[Vec<End>]) -> Self {
        let average = |of: &dyn Fn(&End) -> f64| {
            let means: Vec<f64> = frames.iter().map(|f| f.iter().map(of).sum::<f64>() / f.len() as f64).collect();
            let n = means.len() as f64;
            let mean = means.iter().sum::<f64>() / n;
            let spread = means.iter().map(|m| (m - mean) * (m - mean)).sum::<f64>() / (n - 1.0).max(1.0);
            (mean, (spread / n).sqrt())
        };
        // A constant is held by an interval of no width, but for the last bits of the mean.
        let (coverage, coverage_error) =
            average(&|end| f64::from(u8::from((end.mean - 1.0).abs() <= end.half_width + 1e-12)));
        let (mean, mean_error) = average(&|end| end.mean);
        Self { coverage, coverage_error, mean, mean_error, samples: average(&|end| end.samples).0 }
    }
}

/// Frames that hold nine pixels for each of `trials`.
#[must_use]
pub fn frames(trials: u32) -> usize {
    (trials * 9).div_ceil(EDGE * EDGE).max(2) as usize
}

/// Our rule on `frames` frames, under each rule of `rules` in turn: the first from nothing, each later one going
/// on with what the one before left.
#[must_use]
pub fn ours(rules: &[Rule], truth: Truth, around: Around, frames: usize, seed: u64) -> Outcome {
    Outcome::of(&parallel::map(frames, |number| frame(rules, truth, around, seed, number)))
}

fn frame(rules: &[Rule], truth: Truth, around: Around, seed: u64, number: usize) -> Vec<End> {
    let rect = Rect::frame(EDGE, EDGE);
    let mut pixels: Vec<(Truth, Random)> = rect
        .pixels()
        .enumerate()
        .map(|(index, at)| (around.truth(truth, at), generator(seed, number, index)))
        .collect();
    let mut film = Vec::new();
    let mut ends = Vec::new();
    for rule in rules {
        let mut render = |work: &Work| -> Vec<Moments> {
            let batches = |index: usize| match work {
                Work::PerPixel { batches, .. } => batches[index],
                Work::Uniform { samples, .. } | Work::Textbook { max_samples: samples, .. } => samples / rule.batch(),
                Work::Prepare { .. } => 0,
            };
            let mut all = pixels.iter_mut().enumerate();
            all.by_ref().map(|(index, (truth, random))| draw(*truth, random, batches(index), rule.batch())).collect()
        };
        film = refine(rule, rect, film, &mut render).0;
        ends = intervals(rule, rect, &film);
    }
    let all = rect.pixels().zip(&film).zip(&ends).filter(|((at, _), _)| around.studied(*at));
    all.map(|((_, pixel), (half_width, _))| End {
        samples: pixel.samples.into(),
        mean: pixel.mean[0],
        half_width: *half_width,
    })
    .collect()
}

/// So many batches of a truth.
fn draw(truth: Truth, random: &mut Random, batches: u32, size: u32) -> Moments {
    (0..batches).fold(Moments::default(), |moments, _| {
        let (mut mean, mut within) = (0.0, 0.0);
        for n in 1..=size {
            let value = truth.draw(random);
            let delta = value - mean;
            mean += delta / f64::from(n);
            within += delta * (value - mean);
        }
        moments.merge(Moments { within, ..Moments::batch(size, [mean; 3]) })
    })
}

/// The textbook rule on as many pixels as `frames` frames hold: look after every 32 samples, stop when
/// 1.96 s / sqrt(n) <= tolerance x mean.
#[must_use]
pub fn textbook(truth: Truth, tolerance: f64, cap: u32, frames: usize, seed: u64) -> Outcome {
    let pixel = |number: usize, index: usize| {
        let mut random = generator(seed, number, index);
        let (mut n, mut mean, mut m2) = (0.0, 0.0, 0.0);
        loop {
            for _ in 0..TEXTBOOK_BATCH {
                n += 1.0;
                let delta = truth.draw(&mut random) - mean;
                mean += delta / n;
                m2 += delta * delta * (1.0 - 1.0 / n);
            }
            let half_width = 1.96 * (m2 / (n - 1.0) / n).sqrt();
            if half_width <= tolerance * mean || n >= f64::from(cap) {
                return End { samples: n, mean, half_width };
            }
        }
    };
    let pixels = (EDGE * EDGE) as usize;
    Outcome::of(&parallel::map(frames, |number| (0..pixels).map(|index| pixel(number, index)).collect()))
}

/// A generator for a pixel of a frame.
fn generator(seed: u64, frame: usize, pixel: usize) -> Random {
    let mut scramble = Random::new(seed << 48 ^ (frame as u64) << 24 ^ pixel as u64);
    Random::new((scramble.uniform() * (1u64 << 53) as f64) as u64)
}
