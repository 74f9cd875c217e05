//! Means and variances: sums in f32 against the film's moments.

use super::random::Random;
use super::{Effort, Outcome, Row, ratios, worst};
use common::film::Moments;
use plot::{Axis, Chart, Guide, Series, Style, Table};

/// The sum of squares in f32.
pub(super) const VARIANCE: Row = Row {
    id: "variance",
    title: "Variance from sums of squares",
    fails: "s2 - s1^2/n subtracts two numbers that agree in all their digits once the spread is small against the \
            mean: in f32 the estimate is then noise, often 0 or negative, which an adaptive sampler reads as converged.",
    instead: "The film keeps a mean and a sum of squared deviations in f64, merged by Chan's formula.",
    measure: variance,
};

/// The mean from an f32 sum.
pub(super) const SUMS: Row = Row {
    id: "sums",
    title: "Sums of many samples",
    fails: "An f32 sum of unit samples stops at 2^24, where adding 1 rounds to adding nothing, so the mean falls as \
            samples are added.",
    instead: "The film merges means in f64.",
    measure: sums,
};

/// Samples of one estimate.
const SAMPLES: u32 = 1024;

fn variance(effort: Effort) -> Outcome {
    let trials = effort.of(400, 60);
    let mut table = Table::new([
        "sigma_over_mu",
        "textbook_mean_relative_error",
        "textbook_share_not_positive",
        "ours_mean_relative_error",
        "ours_worst_relative_error",
    ]);
    let (mut ours, mut textbook, mut lost) = (Vec::new(), Vec::new(), Vec::new());
    let mut ours_worst = 0.0f64;
    let mut random = Random::new(1);
    for spread in ratios(1e-4, 1.0, 13) {
        let (mut mine, mut theirs, mut not_positive, mut most) = (0.0, 0.0, 0.0, 0.0f64);
        for _ in 0..trials {
            let values: Vec<f32> = (0..SAMPLES).map(|_| (1.0 + spread * random.normal()) as f32).collect();
            let truth = two_pass(&values);
            let estimate = sum_of_squares(&values);
            let moments =
                values.iter().fold(Moments::default(), |sum, &v| sum.merge(Moments::batch(1, [f64::from(v); 3])));
            // The variance of the mean, times n, is that of a sample.
            let found = moments.variance_of_mean().unwrap_or(f64::NAN) * f64::from(SAMPLES);
            let error = (found / truth - 1.0).abs();
            mine += error / f64::from(trials);
            most = worst([most, error]);
            theirs += (estimate / truth - 1.0).abs() / f64::from(trials);
            not_positive += f64::from(u8::from(estimate <= 0.0)) / f64::from(trials);
        }
        table.push([spread, theirs, not_positive, mine, most].map(Into::into));
        ours_worst = worst([ours_worst, most]);
        ours.push((spread, mine));
        textbook.push((spread, theirs));
        lost.push((spread, not_positive));
    }
    let bound = 1e-9;
    Outcome {
        textbook: worst(textbook.iter().map(|p| p.1)),
        ours: ours_worst,
        bound,
        figure: "relative error of the variance",
        chart: Chart {
            title: "Estimated variance of 1,024 samples as their spread shrinks".into(),
            x: Axis::log("standard deviation / mean", ""),
            y: Axis::log("mean relative error of the variance", ""),
            series: vec![
                Series::new("ours: Chan's merge, f64", Style::Line, ours),
                Series::new("textbook: s2 - s1^2/n, f32", Style::Line, textbook),
                Series::new("textbook: share of estimates <= 0", Style::Points, lost.into_iter().filter(|p| p.1 > 0.0)),
            ],
            guides: vec![Guide::Level { y: bound, label: "bound".into() }],
            notes: vec![],
        },
        table,
    }
}

/// The textbook estimate of the variance, as an f32 renderer would keep it.
fn sum_of_squares(values: &[f32]) -> f64 {
    let (s1, s2) = values.iter().fold((0.0f32, 0.0f32), |(s1, s2), v| (s1 + v, s2 + v * v));
    let n = values.len() as f32;
    f64::from((s2 - s1 * s1 / n) / (n - 1.0))
}

/// The reference: two passes in f64.
fn two_pass(values: &[f32]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / (n - 1.0)
}

/// Samples between two looks at the sums, and of a batch of ours.
const STEP: u32 = 16;

fn sums(_: Effort) -> Outcome {
    let mut table = Table::new(["samples", "textbook_unit", "textbook_uniform", "ours_unit", "ours_uniform"]);
    let mut random = Random::new(2);
    // Running sums of samples that are all 1, and of uniform ones; exact sums of the latter in integers.
    let (mut units, mut uniform, mut exact) = (0.0f32, 0.0f32, 0u64);
    let (mut our_units, mut our_uniform) = (Moments::default(), Moments::default());
    let mut curves = [const { Vec::new() }; 4];
    let (mut samples, mut next) = (0u32, 1024);
    while samples < 1 << 26 {
        let mut batch = 0.0f64;
        for _ in 0..STEP {
            let value = random.single();
            units += 1.0;
            uniform += value;
            batch += f64::from(value);
            // A multiple of 2^-24.
            exact += (value * (1u32 << 24) as f32) as u64;
        }
        our_units = our_units.merge(Moments::batch(STEP, [1.0; 3]));
        our_uniform = our_uniform.merge(Moments::batch(STEP, [batch / f64::from(STEP); 3]));
        samples += STEP;
        if samples == next {
            next *= 2;
            let n = f64::from(samples);
            let mean = exact as f64 / f64::from(1u32 << 24) / n;
            let error = |found: f64, truth: f64| (found / truth - 1.0).abs();
            let errors = [
                error(f64::from(units) / n, 1.0),
                error(f64::from(uniform) / n, mean),
                error(our_units.mean[0], 1.0),
                error(our_uniform.mean[0], mean),
            ];
            table.push([n, errors[0], errors[1], errors[2], errors[3]].map(Into::into));
            for (curve, e) in curves.iter_mut().zip(errors) {
                curve.push((n, e));
            }
        }
    }
    let [textbook_units, textbook_uniform, ours_units, ours_uniform] = curves;
    let bound = 1e-12;
    Outcome {
        textbook: worst(textbook_units.iter().chain(&textbook_uniform).map(|p| p.1)),
        ours: worst(ours_units.iter().chain(&ours_uniform).map(|p| p.1)),
        bound,
        figure: "relative error of the mean",
        chart: Chart {
            title: "Mean of many samples".into(),
            x: Axis::log("samples", ""),
            y: Axis::log("relative error of the mean", ""),
            series: vec![
                Series::new("ours: f64, uniform samples", Style::Line, ours_uniform),
                Series::new("textbook: f32, uniform samples", Style::Line, textbook_uniform),
                Series::new("ours: f64, unit samples", Style::Line, ours_units),
                Series::new("textbook: f32, unit samples", Style::Line, textbook_units),
            ],
            guides: vec![
                Guide::Level { y: bound, label: "bound".into() },
                Guide::At { x: f64::from(1 << 24), label: "2^24 samples".into() },
            ],
            notes: vec![],
        },
        table,
    }
}
