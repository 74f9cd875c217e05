//! Stopping rules on pixels whose truth is known: how often the interval holds it, and at what cost.
//!
//! Ours is [`common::adaptive::Rule`], the very code that plans passes; the textbook rule stands beside
//! it. Every truth has mean 1.

use common::{
    adaptive::{Rule, Verdict},
    film::Moments,
    pass::BATCH,
};

/// What a pixel's samples are drawn from; the mean is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Truth {
    /// 1/p with probability p, else 0: a light that few paths find.
    Bernoulli(f64),
    /// exp of a normal of this standard deviation: a product of many factors.
    Lognormal(f64),
    /// Many small contributions with a tail.
    Exponential,
    /// No noise at all.
    Constant,
    /// Uniform noise, and with this probability a spike of this height: a firefly.
    Spikes(f64, f64),
}

/// Uniform in 0.99 to 1.01: what surrounds a lone noisy pixel.
const QUIET: f64 = 0.01;
/// Samples between two looks of the textbook rule.
const TEXTBOOK_BATCH: u32 = 32;
/// A pixel and its eight neighbours.
const GROUP: usize = 9;

impl Truth {
    /// The truths of the study.
    const ALL: &[Truth] = &[
        Truth::Bernoulli(0.5),
        Truth::Bernoulli(0.1),
        Truth::Bernoulli(0.03),
        Truth::Bernoulli(0.01),
        Truth::Lognormal(0.5),
        Truth::Lognormal(1.0),
        Truth::Lognormal(1.5),
        Truth::Exponential,
        Truth::Constant,
        Truth::Spikes(0.02, 20.0),
        Truth::Spikes(1e-4, 2000.0),
    ];

    /// Its name in tables.
    fn name(self) -> String {
        match self {
            Truth::Bernoulli(p) => format!("Bernoulli {p}"),
            Truth::Lognormal(sigma) => format!("lognormal {sigma}"),
            Truth::Exponential => "exponential".into(),
            Truth::Constant => "constant".into(),
            Truth::Spikes(p, height) => format!("spikes of {height} at {p}"),
        }
    }

    fn draw(self, rng: &mut Random) -> f64 {
        match self {
            Truth::Bernoulli(p) => {
                if rng.uniform() < p {
                    1.0 / p
                } else {
                    0.0
                }
            }
            Truth::Lognormal(sigma) => (sigma * rng.normal() - 0.5 * sigma * sigma).exp(),
            Truth::Exponential => -(1.0 - rng.uniform()).ln(),
            Truth::Constant => 1.0,
            Truth::Spikes(p, height) => {
                let spike = if rng.uniform() < p { height } else { 0.0 };
                (2.0 * rng.uniform() + spike) / (1.0 + p * height)
            }
        }
    }
}

/// What surrounds the pixel that is studied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Neighbours {
    /// Eight pixels of the same truth.
    Alike,
    /// Eight pixels with almost no noise.
    Quiet,
}

/// What a rule did over many trials.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Outcome {
    /// Share of final intervals that hold the truth.
    coverage: f64,
    /// Mean over pixels, every pixel weighing the same, as a viewer sees it; the truth is 1.
    mean: f64,
    /// Standard error of `mean`.
    mean_error: f64,
    /// Mean samples of a pixel.
    samples: f64,
}

/// Samples taken, mean, half-width of the final interval.
type End = (f64, f64, f64);

fn summarise(ends: &[End]) -> Outcome {
    let n = ends.len() as f64;
    // A constant is held by an interval of no width, but for the last bits of the mean.
    let held = ends.iter().filter(|(_, mean, half)| (mean - 1.0).abs() <= half + 1e-12).count();
    let mean = ends.iter().map(|end| end.1).sum::<f64>() / n;
    let variance = ends.iter().map(|end| (end.1 - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Outcome {
        coverage: held as f64 / n,
        mean,
        mean_error: (variance / n).sqrt(),
        samples: ends.iter().map(|end| end.0).sum::<f64>() / n,
    }
}

/// The textbook rule: look after every 32 samples, stop when 1.96 s / sqrt(n) <= tolerance x mean.
fn textbook(truth: Truth, tolerance: f64, cap: u32, trials: u32, seed: u64) -> Outcome {
    let ends: Vec<End> = (0..u64::from(trials) * GROUP as u64)
        .map(|trial| {
            let mut rng = generator(seed, trial);
            let (mut n, mut mean, mut m2) = (0.0, 0.0, 0.0);
            loop {
                for _ in 0..TEXTBOOK_BATCH {
                    n += 1.0;
                    let delta = truth.draw(&mut rng) - mean;
                    mean += delta / n;
                    m2 += delta * delta * (1.0 - 1.0 / n);
                }
                let half = 1.96 * (m2 / (n - 1.0) / n).sqrt();
                if half <= tolerance * mean || n >= f64::from(cap) {
                    return (n, mean, half);
                }
            }
        })
        .collect();
    summarise(&ends)
}

/// Our rule on a block of three by three pixels, each the neighbour of all.
fn ours(truth: Truth, around: Neighbours, rule: &Rule, trials: u32, seed: u64) -> Outcome {
    // A lone pixel is one in nine of those drawn: more trials, for like numbers.
    let (trials, studied) = match around {
        Neighbours::Alike => (trials, GROUP),
        Neighbours::Quiet => (trials.saturating_mul(4), 1),
    };
    let ends: Vec<End> = (0..u64::from(trials))
        .flat_map(|trial| {
            let mut rng = generator(seed, trial);
            block(truth, around, rule, &mut rng).into_iter().take(studied)
        })
        .collect();
    summarise(&ends)
}

fn block(truth: Truth, around: Neighbours, rule: &Rule, rng: &mut Random) -> Vec<End> {
    let mut draw = |pixel: usize| match around {
        Neighbours::Quiet if pixel > 0 => 1.0 + QUIET * (2.0 * rng.uniform() - 1.0),
        _ => truth.draw(rng),
    };
    let mut pixels = [Moments::default(); GROUP];
    let mut goals = [rule.pilot(); GROUP];
    loop {
        for (i, (moments, goal)) in pixels.iter_mut().zip(goals).enumerate() {
            while moments.batches < goal {
                let sum: f64 = (0..BATCH).map(|_| draw(i)).sum();
                *moments = moments.merge(Moments::batch(BATCH, [sum / f64::from(BATCH); 3]));
            }
        }
        let verdicts = pixels.map(|own| rule.judge(&own, &pixels));
        goals = verdicts.map(|verdict| verdict.batches);
        if goals.iter().zip(&pixels).all(|(goal, moments)| *goal <= moments.batches) {
            let end = |(m, v): (&Moments, &Verdict)| (f64::from(m.samples), m.mean[0], v.half_width);
            return pixels.iter().zip(&verdicts).map(end).collect();
        }
    }
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Box and Muller.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn generator(seed: u64, trial: u64) -> Random {
    let mut scramble = Random(seed << 32 | trial);
    Random((scramble.uniform() * (1u64 << 53) as f64) as u64)
}

const TOLERANCE: f64 = 0.05;
const CAP: u32 = 16_384;

fn rule() -> Rule {
    Rule::new(TOLERANCE, 0.95, CAP, BATCH)
}

#[test]
fn intervals_hold_the_truth_as_often_as_they_say_and_the_mean_is_not_bent() {
    for truth in [Truth::Bernoulli(0.5), Truth::Bernoulli(0.03), Truth::Lognormal(1.0), Truth::Exponential] {
        let ours = ours(truth, Neighbours::Alike, &rule(), 60, 1);
        assert!((0.93..=0.985).contains(&ours.coverage), "{}: {ours:?}", truth.name());
        assert!((ours.mean - 1.0).abs() < 0.004 + 3.0 * ours.mean_error, "{}: {ours:?}", truth.name());
    }
}

#[test]
fn a_lone_noisy_pixel_is_not_talked_out_of_its_noise() {
    let lone = ours(Truth::Exponential, Neighbours::Quiet, &rule(), 150, 2);
    assert!(lone.coverage > 0.91, "{lone:?}");
}

#[test]
fn the_textbook_rule_stops_at_black_and_we_do_not() {
    let rare = Truth::Bernoulli(0.01);
    let textbook = textbook(rare, TOLERANCE, CAP, 60, 3);
    assert!(textbook.coverage < 0.5 && textbook.mean < 0.5, "{textbook:?}");
    let ours = ours(rare, Neighbours::Alike, &rule(), 40, 3);
    assert!(ours.coverage > 0.92 && (ours.mean - 1.0).abs() < 0.02, "{ours:?}");
}

#[test]
fn it_costs_little_where_the_textbook_rule_holds() {
    for truth in [Truth::Bernoulli(0.5), Truth::Exponential, Truth::Lognormal(0.5)] {
        let ratio =
            ours(truth, Neighbours::Alike, &rule(), 60, 4).samples / textbook(truth, TOLERANCE, CAP, 60, 4).samples;
        assert!(ratio < 1.2, "{}: {ratio}", truth.name());
    }
}

#[test]
fn every_truth_has_mean_one() {
    let mut rng = generator(5, 0);
    for &truth in Truth::ALL {
        let (n, mut sum, mut squares) = (400_000, 0.0, 0.0);
        for _ in 0..n {
            let x = truth.draw(&mut rng);
            sum += x;
            squares += x * x;
        }
        let n = f64::from(n);
        let mean = sum / n;
        let error = ((squares / n - mean * mean) / n).sqrt();
        assert!((mean - 1.0).abs() <= 4.0 * error + 1e-12, "{}: {mean} +- {error}", truth.name());
    }
}
