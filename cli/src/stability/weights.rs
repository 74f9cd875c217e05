//! Weights between ways to find the same light, and paths that end at random.

use super::random::Random;
use super::{Effort, Outcome, Row, ratios, worst};
use common::method::Roulette;
use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::integrator::{power_heuristic, survival};
use tracer::math::Rgb;

/// The power heuristic.
pub(super) const MIS: Row = Row {
    id: "mis-weights",
    title: "Multiple importance sampling: the power heuristic",
    fails: "Densities are squared: past 1.8e19 the squares are infinite, below 1e-23 they are 0, and the weight is \
            not a number.",
    instead: "The weight is computed from the ratio of the densities; a delta is a flag, not a huge density.",
    measure: mis,
};

/// Roulette in a closed furnace.
pub(super) const ROULETTE: Row = Row {
    id: "roulette",
    title: "Russian roulette at a fixed probability",
    fails: "Survivors of a fixed probability are divided by it at every bounce: where surfaces reflect more than it \
            allows for, throughput grows without end, and with it the variance (infinite for albedos above 0.84).",
    instead: "A path survives with its throughput, if that is below 1, and only after three bounces: no path grows \
              brighter than it began.",
    measure: furnace,
};

/// Roulette in glass.
pub(super) const ROULETTE_GLASS: Row = Row {
    id: "roulette-glass",
    title: "Russian roulette in glass",
    fails: "Inside glass radiance is smaller by eta^2 and gets it back on leaving; a roulette that does not know this \
            kills paths that lose nothing, and those that survive come out too bright.",
    instead: "Roulette looks at throughput times eta^2.",
    measure: panes,
};

/// Veach's power heuristic as textbooks print it.
fn textbook_heuristic(a: f32, b: f32) -> f32 {
    a * a / (a * a + b * b)
}

fn mis(_: Effort) -> Outcome {
    let mut table = Table::new(["pdf", "other_pdf", "textbook_weight", "ours_weight", "weight"]);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for pdf in ratios(1e-30, 1e30, 61) {
        let mut most = [0.0f64; 2];
        for ratio in [1.0, 0.5, 2.0, 1e-3, 1e3] {
            let (a, b) = (pdf as f32, (pdf * ratio) as f32);
            let (x, y) = (f64::from(a), f64::from(b));
            let truth = 1.0 / (1.0 + (y / x) * (y / x));
            let weights = [power_heuristic(a, b), textbook_heuristic(a, b)];
            // Both ways together must count once.
            let sums = [power_heuristic(b, a) + weights[0], textbook_heuristic(b, a) + weights[1]];
            table.push([x, y, weights[1].into(), weights[0].into(), truth].map(Into::into));
            for ((most, weight), sum) in most.iter_mut().zip(weights).zip(sums) {
                let error = worst([(f64::from(weight) - truth).abs(), (f64::from(sum) - 1.0).abs()]);
                *most = worst([*most, if error.is_nan() { f64::INFINITY } else { error }]);
            }
        }
        ours.push((pdf, most[0]));
        theirs.push((pdf, most[1]));
    }
    let bound = 1e-6;
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound,
        figure: "error of a weight, or of their sum (infinite: not a number)",
        chart: Chart {
            title: "Weights of two densities whose ratio is 1e-3 to 1e3".into(),
            x: Axis::log("density", "1/sr"),
            y: Axis::log("worst error of the weight or of the sum", "").between(1e-9, 10.0),
            series: vec![
                Series::new("ours: by ratio", Style::Line, ours),
                Series::new("textbook: by squares", Style::Line, theirs),
            ],
            guides: vec![Guide::Level { y: bound, label: "bound".into() }],
            notes: vec!["A weight that is not a number counts as infinitely wrong.".into()],
        },
        table,
    }
}

/// Mean and standard deviation, in that order.
fn spread(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// Radiance of a path in a closed furnace of emission 1.
fn furnace_path(rule: Roulette, albedo: f32, random: &mut Random) -> f64 {
    let (mut throughput, mut radiance) = (1.0f32, 1.0f64);
    for depth in 1..10_000 {
        throughput *= albedo;
        if let Some(q) = survival(rule, depth, Rgb::splat(throughput)) {
            if random.single() >= q {
                break;
            }
            throughput /= q;
        }
        radiance += f64::from(throughput);
    }
    radiance
}

fn furnace(effort: Effort) -> Outcome {
    let paths = effort.of(100_000, 20_000);
    let mut table = Table::new(["albedo", "rule", "paths", "mean_over_truth", "deviation_over_truth"]);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut random = Random::new(20);
    let mut bias = 0.0;
    for albedo in [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.84, 0.88, 0.92, 0.95, 0.97, 0.99] {
        let truth = 1.0 / (1.0 - albedo);
        for (name, rule, curve) in
            [("ours", Roulette::Throughput, &mut ours), ("textbook", Roulette::Fixed, &mut theirs)]
        {
            let values: Vec<f64> = (0..paths).map(|_| furnace_path(rule, albedo as f32, &mut random) / truth).collect();
            let (mean, deviation) = spread(&values);
            if rule == Roulette::Throughput {
                // In standard errors: the mean must be that without roulette, which is the truth.
                bias = worst([bias, (mean - 1.0).abs() / (deviation.max(1e-6) / f64::from(paths).sqrt())]);
            }
            table.push([albedo.into(), name.into(), paths.into(), mean.into(), deviation.into()]);
            curve.push((albedo, deviation));
        }
    }
    let bound = 1.1;
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        // A rule that changes the mean is no use, however little it scatters.
        ours: if bias < 4.5 { worst(ours.iter().map(|p| p.1)) } else { f64::INFINITY },
        bound,
        figure: "standard deviation of a path, of the mean (infinite: the mean is wrong)",
        chart: Chart {
            title: "Spread of a path's radiance in a closed furnace, Le / (1 - albedo)".into(),
            x: Axis::linear("albedo", "").between(0.0, 1.0),
            y: Axis::log("standard deviation / mean", ""),
            series: vec![
                Series::new("ours: by throughput", Style::Line, ours),
                Series::new("textbook: survive with 0.7", Style::Line, theirs),
            ],
            guides: vec![
                Guide::Level { y: bound, label: "bound".into() },
                Guide::At { x: 0.7f64.sqrt(), label: "above: the textbook's variance is infinite".into() },
            ],
            notes: vec![],
        },
        table,
    }
}

/// What is left of a path that passes clear panes of glass; each is entered and left.
fn panes_path(count: u32, knows_eta: bool, random: &mut Random) -> f64 {
    const ETA2: f32 = 1.5 * 1.5;
    let (mut throughput, mut eta2, mut depth) = (1.0f32, 1.0f32, 0);
    for side in 0..2 * count {
        let enters = side % 2 == 0;
        throughput *= if enters { 1.0 / ETA2 } else { ETA2 };
        eta2 *= if enters { ETA2 } else { 1.0 / ETA2 };
        depth += 1;
        let seen = if knows_eta { throughput * eta2 } else { throughput };
        if let Some(q) = survival(Roulette::Throughput, depth, Rgb::splat(seen)) {
            if random.single() >= q {
                return 0.0;
            }
            throughput /= q;
        }
    }
    f64::from(throughput)
}

fn panes(effort: Effort) -> Outcome {
    let paths = effort.of(100_000, 20_000);
    let mut table = Table::new(["panes", "paths", "textbook_deviation", "ours_deviation"]);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut random = Random::new(21);
    for count in 0..=10 {
        let mut deviation = |knows_eta| {
            let values: Vec<f64> = (0..paths).map(|_| panes_path(count, knows_eta, &mut random)).collect();
            spread(&values).1
        };
        let (mine, textbook) = (deviation(true), deviation(false));
        table.push([count.into(), paths.into(), textbook.into(), mine.into()]);
        ours.push((f64::from(count), mine));
        theirs.push((f64::from(count), textbook));
    }
    let bound = 1e-2;
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound,
        figure: "standard deviation of a path, of the mean",
        chart: Chart {
            title: "Spread of a path that passes clear panes of glass, n 1.5, and loses nothing".into(),
            x: Axis::linear("panes", ""),
            y: Axis::linear("standard deviation / mean", ""),
            series: vec![
                Series::new("ours: throughput x eta^2", Style::Line, ours),
                Series::new("textbook: throughput alone", Style::Line, theirs),
            ],
            ..Chart::default()
        },
        table,
    }
}
