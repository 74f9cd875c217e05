//! Bias: many adaptive renders of a small frame against a reference.

use common::{film::Moments, pass::Work};
use plot::{Axis, Chart, Guide, Series, Style};

use super::{
    Bound, Effort, Figure, Grid, Part, Section, Value, parallel, refine,
    stage::Stage,
    tolerances::{point, rule},
};
use crate::error::Failure;

/// Bias of repeated renders.
pub(super) const PART: Part = Part { id: "bias", measure };

/// Edge of a frame, pixels.
const EDGE: u32 = 4;
/// Noises asked for, each with the most samples of a pixel.
const NOISES: [(f64, u32); 3] = [(0.2, 1024), (0.1, 4096), (0.05, 16_384)];
/// Scenes, and what the bias may be at each noise, either way, in shares; a noise without one is not measured.
const SCENES: [(&str, [Option<f64>; 3]); 3] = [
    ("cornell-box", [Some(0.02), Some(0.005), Some(0.002)]),
    ("mesh-light", [Some(0.02), Some(0.005), Some(0.002)]),
    // Half of its pixels end at the most samples; at 5% nearly all would.
    ("cornell-spheres", [Some(0.04), Some(0.01), None]),
];
/// What it should be.
const GOAL: f64 = 0.002;
/// Samples of a pixel of the reference come in this many parts of [`PART_BATCHES`].
const PARTS: usize = 50;
const PART_BATCHES: u32 = 4000;
const REFERENCE_SEED: u64 = 1 << 33;

/// Mean luminance of a frame: every pixel weighs the same, whatever it took.
pub(super) fn level(film: &[Moments]) -> f64 {
    film.iter().map(Moments::luminance).sum::<f64>() / film.len() as f64
}

/// Mean and its standard error.
pub(super) fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let spread = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, (spread / n).sqrt())
}

/// What many renders by one rule came to.
struct Pooled {
    /// Error of the mean, a share of it.
    bias: f64,
    /// Its standard error, that of the reference included.
    error: f64,
    /// Mean samples of a pixel.
    samples: f64,
}

fn measure(effort: &Effort) -> Result<Section, Failure> {
    let renders = effort.of(1000, 60);
    let textbook_renders = effort.of(300, 60);
    let parts = effort.of(PARTS, 6);
    let scenes = effort.of(&SCENES[..], &SCENES[..1]);
    let mut grid = Grid::new(
        "bias",
        "Error of the pooled mean, with its standard error (that of the reference is in it).",
        &["scene", "noise", "ours, %", "+-", "textbook, %", "textbook +-", "samples", "textbook samples"],
    );
    let mut series = Vec::new();
    let mut bounds = Vec::new();
    for &(name, limits) in scenes {
        let stage = Stage::open(effort, name, EDGE)?;
        let levels = parallel::map(parts, |part| {
            let samples = PART_BATCHES * common::pass::BATCH;
            level(&stage.render(REFERENCE_SEED, &Work::Uniform { first: part as u32 * samples, samples }))
        });
        let (truth, truth_error) = mean(&levels);
        let pooled = |renders: usize, of: &(dyn Fn(u64) -> Vec<Moments> + Sync)| {
            let all = parallel::map(renders, |seed| {
                let film = of(1 + seed as u64);
                (level(&film), film.iter().map(|p| f64::from(p.samples)).sum::<f64>() / film.len() as f64)
            });
            let (levels, samples): (Vec<f64>, Vec<f64>) = all.into_iter().unzip();
            let (found, error) = mean(&levels);
            Pooled { bias: found / truth - 1.0, error: error.hypot(truth_error) / truth, samples: mean(&samples).0 }
        };
        let mut lines = [format!("ours: {name}"), format!("textbook: {name}")].map(|n| Series::new(n, Style::Line, []));
        for (place, (&target, limit)) in NOISES.iter().zip(limits).enumerate() {
            // The quick study takes the noise in the middle.
            let Some(limit) = limit.filter(|_| !effort.quick || place == 1) else { continue };
            let rule = rule(target);
            let ours =
                pooled(renders, &|seed| refine(&rule, stage.frame, Vec::new(), |work| stage.render(seed, work)).0);
            let (tolerance, max_samples) = target;
            let work = Work::Textbook { batch: 32, tolerance, max_samples };
            let theirs = pooled(textbook_renders, &|seed| stage.render(seed, &work));
            for (line, found) in lines.iter_mut().zip([&ours, &theirs]) {
                line.points.push(point(place as f64, 100.0 * found.bias, 200.0 * found.error));
            }
            grid.rows.push(vec![
                name.into(),
                Value::Number(tolerance, 2),
                Value::Number(100.0 * ours.bias, 3),
                Value::Number(100.0 * ours.error, 3),
                Value::Number(100.0 * theirs.bias, 3),
                Value::Number(100.0 * theirs.error, 3),
                Value::Number(ours.samples, 0),
                Value::Number(theirs.samples, 0),
            ]);
            // So few renders know it to a few standard errors only.
            let slack = effort.of(0.0, 3.0 * ours.error);
            bounds.push(Bound {
                what: format!("bias of the pooled mean of {renders} renders of {name}, noise {tolerance} (a share)"),
                found: ours.bias,
                low: -limit - slack,
                high: limit + slack,
                goal: Some((-GOAL, GOAL)),
            });
        }
        series.extend(lines);
    }
    let chart = Chart {
        title: "Bias of the pooled mean of many adaptive renders".into(),
        x: Axis::names("noise asked for", NOISES.iter().map(|(noise, _)| format!("{}%", noise * 100.0))),
        y: Axis::linear("bias", "% of the mean"),
        series,
        guides: vec![
            Guide::Level { y: 100.0 * GOAL, label: "goal: within 0.2%".into() },
            Guide::Level { y: -100.0 * GOAL, label: String::new() },
        ],
        notes: vec!["bars: two standard errors, the reference's included".into()],
    };
    Ok(Section {
        title: "Bias",
        text: format!(
            "{renders} adaptive renders of {EDGE} x {EDGE} pixels, each with another seed ({textbook_renders} with the textbook \
             rule), against a reference of {} samples a pixel. The mean of a render is the mean over its pixels, whatever \
             number of samples each took.",
            parts as u32 * PART_BATCHES * common::pass::BATCH
        ),
        figures: vec![Figure { id: "bias".into(), chart, says: SAYS.into() }],
        grids: vec![grid],
        bounds,
    })
}

const SAYS: &str = "A rule that stops on what it has seen bends the mean: up where a pixel stops when it happens to be \
    bright (its interval is then short against it), down where it stops before it has seen rare light. The first is \
    known: the samples N that a pixel takes go with s^2 / m^2, of its own mean m, and since the mean of all its samples \
    obeys Wald's identity, E[m_N] = mu - Cov(N, m_N) / E[N], a pixel of symmetric noise ends (noise / 1.96)^2 x 2 too \
    bright, 0.5% at a noise of 10% and 0.13% at 5%; one whose variance rises with its mean, as light that comes by \
    rare events does, about half of that. It falls with the square of the noise asked for, faster than the error \
    that each pixel is allowed, and no rule whose target is relative to the pixel's own mean is without it. At the edge \
    of the box's lamp sixteen well-spread points hold the lamp once or not at all; where all four batches of a pilot \
    hold it once, nothing seems to vary, and one such pixel in twelve stopped there, 29% too bright, before the rule \
    looked at the spread within batches as well (the frame's mean was then 1.3% too high). So small a frame of the \
    spheres says little of their caustics (see the bias of rendered pixels).";
