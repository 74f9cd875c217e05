//! Coverage of rendered pixels, by decile of their variance, and of jobs that were continued.

use common::{adaptive::Rule, film::Moments, pass::Work};
use plot::{Axis, Chart, Series, Style};

use super::{
    Bound, Effort, Figure, Grid, Part, Section, Value, intervals, parallel, refine,
    stage::Stage,
    tolerances::{goal, point, rule},
};
use crate::error::Failure;

/// Rendered coverage.
pub(super) const PART: Part = Part { id: "rendered", measure };

/// Scenes, and the least coverage of all their pixels and of the worst decile that is held.
const SCENES: [(&str, f64, f64); 5] = [
    ("cornell-box", 0.94, 0.91),
    ("mesh-light", 0.94, 0.89),
    ("veach-plates", 0.94, 0.9),
    ("shells", 0.94, 0.9),
    ("cornell-spheres", 0.86, 0.82),
];

/// Coarse target, and the one that it is continued to; each with its most samples of a pixel.
const COARSE: (f64, u32) = (0.2, 1024);
const FINE: (f64, u32) = (0.1, 4096);
/// Samples of a reference against those of the coarse target, pixel by pixel.
const REFERENCE: u32 = 100;
/// Seed of references; runs count from 1.
const REFERENCE_SEED: u64 = 1 << 32;

/// How a run came to its end.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Coarse,
    Fine,
    Continued,
    TextbookCoarse,
    TextbookFine,
    Fixed,
}

const WAYS: [(Way, &str); 6] = [
    (Way::Coarse, "ours, noise 0.2"),
    (Way::TextbookCoarse, "textbook, 0.2"),
    (Way::Fixed, "256 samples each"),
    (Way::Fine, "ours, noise 0.1"),
    (Way::TextbookFine, "textbook, 0.1"),
    (Way::Continued, "ours, 0.2 continued to 0.1"),
];

/// Pixels of a run: estimate, half-width, samples.
type Run = Vec<(f64, f64, u32)>;

impl Way {
    fn run(self, stage: &Stage, seed: u64) -> Run {
        let ours = |targets: &[(f64, u32)]| {
            let mut film = Vec::new();
            let mut ends = Vec::new();
            for &target in targets {
                let rule = rule(target);
                film = refine(&rule, stage.frame, film, |work| stage.render(seed, work)).0;
                ends = intervals(&rule, stage.frame, &film);
            }
            let of =
                |(pixel, (half_width, _)): (&Moments, &(f64, bool))| (pixel.luminance(), *half_width, pixel.samples);
            film.iter().zip(&ends).map(of).collect()
        };
        match self {
            Way::Coarse => ours(&[COARSE]),
            Way::Fine => ours(&[FINE]),
            Way::Continued => ours(&[COARSE, FINE]),
            Way::TextbookCoarse => textbook(stage, COARSE, seed),
            Way::TextbookFine => textbook(stage, FINE, seed),
            Way::Fixed => {
                let film = stage.render(seed, &Work::Uniform { first: 0, samples: 256 });
                let ends = intervals(&rule(FINE), stage.frame, &film);
                film.iter().zip(&ends).map(|(p, end)| (p.luminance(), end.0, p.samples)).collect()
            }
        }
    }
}

/// The textbook rule. A pixel that stopped promised that its half-width is within the tolerance; one at the cap
/// has the interval of its batches.
fn textbook(stage: &Stage, (tolerance, cap): (f64, u32), seed: u64) -> Run {
    let alone = Rule::new(tolerance, 0.95, cap, 32);
    let film = stage.render(seed, &Work::Textbook { batch: 32, tolerance, max_samples: cap });
    let half_width = |pixel: &Moments| {
        let promised = tolerance * pixel.luminance();
        if pixel.samples < cap { promised } else { alone.judge(pixel, [pixel]).half_width.max(promised) }
    };
    film.iter().map(|pixel| (pixel.luminance(), half_width(pixel), pixel.samples)).collect()
}

/// A scene's pixels as they are.
struct Truths {
    reference: Vec<Moments>,
    /// Pixels that are not known, by rising variance; and by rising variance against their neighbours'.
    by_variance: Vec<usize>,
    by_contrast: Vec<usize>,
}

impl Truths {
    fn of(stage: &Stage) -> Truths {
        // As many samples as the rule asks for, and a hundred times that; in parts, since rows differ in cost.
        let rule = rule(COARSE);
        let pilot = refine(&rule, stage.frame, Vec::new(), |work| stage.render_on_all(REFERENCE_SEED, work)).0;
        let parts = parallel::map(REFERENCE as usize, |part| {
            let batches: Vec<u32> = pilot.iter().map(|p| if p.known { 1 } else { p.batches }).collect();
            let first = batches.iter().map(|n| n * part as u32).collect();
            stage.render(REFERENCE_SEED + 1, &Work::PerPixel { first, batches })
        });
        let mut reference = vec![Moments::default(); stage.frame.area()];
        for part in parts {
            reference = reference.iter().zip(part).map(|(sum, part)| sum.merge(part)).collect();
        }
        let variance = |index: usize| reference[index].m2 / f64::from(reference[index].batches.max(2) - 1);
        let mut by_variance: Vec<usize> = (0..reference.len()).filter(|&i| !reference[i].known).collect();
        by_variance.sort_by(|&a, &b| variance(a).total_cmp(&variance(b)));
        let edge = stage.frame.w as usize;
        let contrast = |index: usize| {
            let (x, y) = (index % edge, index / edge);
            let rows = y.saturating_sub(1)..(y + 2).min(edge);
            let around = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(edge)).map(move |x| y * edge + x));
            let (sum, n) =
                around.filter(|&i| !reference[i].known).fold((0.0, 0.0), |(s, n), i| (s + variance(i), n + 1.0));
            variance(index) / (sum / f64::max(n, 1.0)).max(f64::MIN_POSITIVE)
        };
        let mut by_contrast = by_variance.clone();
        by_contrast.sort_by(|&a, &b| contrast(a).total_cmp(&contrast(b)));
        Truths { reference, by_variance, by_contrast }
    }

    /// Whether a run's interval holds the truth. The reference has an error of its own: the interval of the
    /// difference is wider than the run's by sqrt(1 + n / N) with n and N samples.
    fn holds(&self, index: usize, (estimate, half_width, samples): (f64, f64, u32)) -> bool {
        let reference = &self.reference[index];
        let wider = (1.0 + f64::from(samples) / f64::from(reference.samples)).sqrt();
        (estimate - reference.luminance()).abs() <= half_width * wider + 1e-9
    }

    /// Coverage in each tenth of `order`.
    fn deciles(&self, order: &[usize], runs: &[Run]) -> Vec<f64> {
        (0..10)
            .map(|tenth| {
                let pixels = &order[order.len() * tenth / 10..order.len() * (tenth + 1) / 10];
                let held =
                    pixels.iter().map(|&i| runs.iter().filter(|run| self.holds(i, run[i])).count()).sum::<usize>();
                held as f64 / (pixels.len() * runs.len()).max(1) as f64
            })
            .collect()
    }

    /// Coverage of all, its standard error from the spread between runs, mean samples, and signed error of the
    /// mean of the frame relative to it.
    fn summary(&self, runs: &[Run]) -> [f64; 4] {
        let each = |run: &Run| {
            let held = self.by_variance.iter().filter(|&&i| self.holds(i, run[i])).count();
            held as f64 / self.by_variance.len().max(1) as f64
        };
        let shares: Vec<f64> = runs.iter().map(each).collect();
        let n = shares.len() as f64;
        let mean = shares.iter().sum::<f64>() / n;
        let spread = shares.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (n - 1.0).max(1.0);
        let samples =
            runs.iter().flatten().map(|end| f64::from(end.2)).sum::<f64>() / (n * self.reference.len() as f64);
        let truth: f64 = self.reference.iter().map(Moments::luminance).sum();
        let bias = runs.iter().flatten().map(|end| end.0).sum::<f64>() / (n * truth) - 1.0;
        [mean, (spread / n).sqrt(), samples, bias]
    }
}

fn measure(effort: &Effort) -> Result<Section, Failure> {
    let edge = effort.of(32, 16);
    let scenes = effort.of(&SCENES[..], &SCENES[..1]);
    let runs_of = |way: Way| match way {
        Way::Fine | Way::Continued | Way::TextbookFine => effort.of(4, 2),
        Way::Coarse | Way::TextbookCoarse | Way::Fixed => effort.of(16, 6),
    };
    let mut section = Section {
        title: "Rendered pixels",
        text: format!(
            "The shipped scenes at {edge} x {edge} pixels (the whole frame, so that edges are many), rendered in process \
             and planned as one tile by the coordinator's planner, with {} seeds at noise 0.2 and {} at noise 0.1, beside \
             a reference of {REFERENCE} times the samples that each pixel takes at noise 0.2. The reference's own \
             standard error is then a tenth of that of a pixel at 0.2, and a fifth at 0.1; intervals are widened by \
             sqrt(1 + n/N) to account for it. Pixels whose value is known (background, lights seen directly) are left \
             out. Caps: {} samples at 0.2, {} at 0.1. A textbook pixel is held to what it promises: the tolerance.",
            runs_of(Way::Coarse),
            runs_of(Way::Fine),
            COARSE.1,
            FINE.1,
        ),
        ..Section::default()
    };
    let mut table = Grid::new(
        "rendered",
        "All pixels that are not known. Bias is the signed error of the frame's mean.",
        &["scene", "rule", "coverage", "+-", "worst decile", "mean samples", "bias, %"],
    );
    let mut deciles = Grid::new(
        "rendered-deciles",
        "Coverage by decile of variance, and by decile of variance against the mean variance of the neighbours.",
        &["scene", "rule", "order", "1", "2", "3", "4", "5", "6", "7", "8", "9", "10"],
    );
    deciles.only_csv = true;
    let mut charts = [Vec::new(), Vec::new(), Vec::new()];
    for &(name, least, worst) in scenes {
        let stage = Stage::open(effort, name, edge)?;
        let truths = Truths::of(&stage);
        for (way, words) in WAYS {
            let runs = parallel::map(runs_of(way), |seed| way.run(&stage, 1 + seed as u64));
            let [coverage, error, samples, bias] = truths.summary(&runs);
            let by_variance = truths.deciles(&truths.by_variance, &runs);
            let low = by_variance.iter().copied().fold(1.0, f64::min);
            table.rows.push(vec![
                name.into(),
                words.into(),
                Value::Number(coverage, 3),
                Value::Number(error, 3),
                Value::Number(low, 3),
                Value::Number(samples, 0),
                Value::Number(100.0 * bias, 2),
            ]);
            let by_contrast = truths.deciles(&truths.by_contrast, &runs);
            for (order, shares) in [("variance", &by_variance), ("contrast", &by_contrast)] {
                let head = [name.into(), words.into(), order.into()];
                deciles.rows.push(head.into_iter().chain(shares.iter().map(|s| Value::Number(*s, 4))).collect());
            }
            let mut line = |chart: usize, shares: &[f64]| {
                let points = (1..).map(f64::from).zip(shares).map(|(x, y)| point(x, *y, 0.0)).collect();
                charts[chart].push(Series { name: name.into(), style: Style::Line, points });
            };
            match way {
                Way::Coarse => {
                    line(0, &by_variance);
                    line(2, &by_contrast);
                    let what = |which: &str| format!("{which} of rendered pixels of {name}, noise 0.2");
                    let slack = effort.of(0.0, 0.05);
                    let bound = |which: &str, found, low: f64| {
                        let (low, high, goal) = (low - slack, 1.0, Some((0.94, 0.97)));
                        Bound { what: what(which), found, low, high, goal }
                    };
                    section.bounds.push(bound("coverage", coverage, least));
                    section.bounds.push(bound("coverage in the worst decile", low, worst));
                }
                Way::TextbookCoarse => line(1, &by_variance),
                _ => {}
            }
        }
    }
    let [ours, theirs, contrast] = charts;
    let chart = |title: &str, label: &str, low: f64, series: Vec<Series>| Chart {
        title: title.into(),
        x: Axis::linear(label, "").between(1.0, 10.0),
        y: Axis::linear("coverage", "").between(low, 1.0),
        series,
        guides: goal(),
        notes: vec![],
    };
    let variance = "decile of the pixels' variance (10: the noisiest)";
    let figure = |id: &str, chart: Chart, says: &str| Figure { id: id.into(), chart, says: says.into() };
    section.figures = vec![
        figure(
            "rendered-ours",
            chart("Ours at noise 0.2: coverage by decile of variance", variance, 0.75, ours),
            "Quiet pixels beside noisy ones get more than they need: their neighbours' variance counts as theirs until \
             they have batches of their own. The noisiest tenth lies at the edges of lights and highlights, where a pixel \
             has few neighbours like itself. The glass sphere's caustics are paths with a probability far below 1 in 576: \
             many pixels stop before they or any neighbour has seen one, and go on when the frame is judged again and a \
             neighbour has. The same intervals on 256 samples each, with no stopping at all, hold the truth less often \
             there (see the table): it is the seeing that fails.",
        ),
        figure(
            "rendered-textbook",
            chart("Textbook at a tolerance of 0.2: coverage by decile of variance", variance, 0.0, theirs),
            "The textbook rule on the same scenes and seeds. Its variance is that of single samples, which knows nothing of \
             what well-spread points gain: where light is not rare it holds more than it claims. On the spheres, where \
             much of the light comes by rare paths, half of the noisy pixels break its promise.",
        ),
        figure(
            "rendered-contrast",
            chart(
                "Ours at noise 0.2: coverage by decile of contrast",
                "decile of a pixel's variance against the mean of its neighbours' (10: noisier than they)",
                0.75,
                contrast,
            ),
            "The same pixels in the order that is hardest for a rule that asks the neighbours: on the right are those \
             noisier than what surrounds them. Neighbours lower their intervals; that is the price of what they see on \
             the left.",
        ),
    ];
    section.grids = vec![table, deciles];
    Ok(section)
}
