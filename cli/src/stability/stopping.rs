//! When a pixel has samples enough: the textbook rule against `common::adaptive`.

use super::random::Random;
use super::{Effort, Outcome, Row, worst};
use common::adaptive::Rule;
use common::film::Moments;
use plot::{Axis, Chart, Guide, Series, Style, Table};

/// Stopping at 1.96 s / sqrt(n).
pub(super) const STOPPING: Row = Row {
    id: "stopping",
    title: "The stopping rule",
    fails: "A rule that looks at one pixel after every batch stops the first time the interval happens to be short: \
            where light is rare, that is when it has been missed, and a pixel still black stops at once since 0 <= 0.",
    instead: "Few looks, sized by prediction; a variance shared with the neighbours; Student's quantile; and zero \
              variance is never convergence.",
    measure: stopping,
};

/// Relative half-width at which a pixel is done, and samples that no pixel exceeds.
const TOLERANCE: f64 = 0.05;
const CAP: u32 = 16_384;
/// Samples of one of our batches.
const BATCH: u32 = 16;

/// A distribution of radiance with mean 1.
type Source = fn(&mut Random) -> f64;

const SOURCES: [(&str, Source); 8] = [
    ("p .5", |r| bernoulli(r, 0.5)),
    ("p .1", |r| bernoulli(r, 0.1)),
    ("p .03", |r| bernoulli(r, 0.03)),
    ("p .01", |r| bernoulli(r, 0.01)),
    ("logn .5", |r| lognormal(r, 0.5)),
    ("logn 1", |r| lognormal(r, 1.0)),
    ("logn 1.5", |r| lognormal(r, 1.5)),
    ("exp", |r| -(1.0 - r.uniform()).ln()),
];

fn bernoulli(random: &mut Random, p: f64) -> f64 {
    if random.uniform() < p { 1.0 / p } else { 0.0 }
}

fn lognormal(random: &mut Random, sigma: f64) -> f64 {
    (sigma * random.normal() - 0.5 * sigma * sigma).exp()
}

/// What became of one pixel.
struct End {
    samples: f64,
    mean: f64,
    half_width: f64,
}

fn stopping(effort: Effort) -> Outcome {
    // Groups of nine pixels alike; the textbook rule sees the same number of pixels, one by one.
    let groups = effort.of(100, 12);
    let mut table = Table::new(["distribution", "rule", "coverage", "mean", "samples"]);
    let (mut ours, mut textbook) = (Vec::new(), Vec::new());
    let rule = Rule::new(TOLERANCE, 0.95, CAP, BATCH);
    let mut random = Random::new(3);
    for (place, (name, source)) in SOURCES.into_iter().enumerate() {
        let mine: Vec<End> = (0..groups).flat_map(|_| predicted(&rule, &mut random, source)).collect();
        let theirs: Vec<End> = (0..groups * 9).map(|_| looked_at_often(&mut random, source)).collect();
        for (rule, ends, bars) in [("ours", &mine, &mut ours), ("textbook", &theirs, &mut textbook)] {
            let count = ends.len() as f64;
            let coverage = ends.iter().filter(|e| (e.mean - 1.0).abs() <= e.half_width).count() as f64 / count;
            let samples: f64 = ends.iter().map(|e| e.samples).sum();
            let mean = ends.iter().map(|e| e.mean).sum::<f64>() / count;
            table.push([name.into(), rule.into(), coverage.into(), mean.into(), (samples / count).into()]);
            bars.push((place as f64, coverage));
        }
    }
    let shortfall = |bars: &[(f64, f64)]| worst(bars.iter().map(|b| 0.95 - b.1));
    Outcome {
        textbook: shortfall(&textbook),
        ours: shortfall(&ours),
        // 900 pixels that share their variance in nines know their coverage to about 0.012.
        bound: effort.of(0.03, 0.1),
        figure: "coverage missing from 95% intervals",
        chart: Chart {
            title: "Share of 95% intervals that hold the truth when a pixel stops (tolerance 5%)".into(),
            x: Axis::names(
                "radiance of a sample: Bernoulli (probability), lognormal (sigma), exponential",
                SOURCES.map(|s| s.0),
            ),
            y: Axis::linear("coverage", "").between(0.0, 1.08),
            series: vec![
                Series::new("ours: common::adaptive", Style::Bars, ours),
                Series::new("textbook: look after every 32 samples", Style::Bars, textbook),
            ],
            guides: vec![Guide::Level { y: 0.95, label: "what the intervals claim".into() }],
            notes: vec![],
        },
        table,
    }
}

/// The textbook rule: batches of 32, stop when 1.96 s / sqrt(n) <= tolerance x mean.
fn looked_at_often(random: &mut Random, source: Source) -> End {
    let (mut n, mut s1, mut s2) = (0.0f64, 0.0f64, 0.0f64);
    loop {
        for _ in 0..32 {
            let x = source(random);
            (n, s1, s2) = (n + 1.0, s1 + x, s2 + x * x);
        }
        let (mean, variance) = (s1 / n, ((s2 - s1 * s1 / n) / (n - 1.0)).max(0.0));
        let half_width = 1.96 * (variance / n).sqrt();
        if half_width <= TOLERANCE * mean || n >= f64::from(CAP) {
            return End { samples: n, mean, half_width };
        }
    }
}

/// Our rule on nine pixels alike that see each other.
fn predicted(rule: &Rule, random: &mut Random, source: Source) -> Vec<End> {
    let mut pixels = [Moments::default(); 9];
    let mut wanted = [rule.pilot(); 9];
    loop {
        for (pixel, &batches) in pixels.iter_mut().zip(&wanted) {
            while pixel.batches < batches {
                let mean = (0..BATCH).map(|_| source(random)).sum::<f64>() / f64::from(BATCH);
                *pixel = pixel.merge(Moments::batch(BATCH, [mean; 3]));
            }
        }
        let verdicts = pixels.map(|pixel| rule.judge(&pixel, &pixels));
        // A pixel stops only when its neighbours have met the target too.
        let done = verdicts.iter().all(|v| v.met);
        wanted = verdicts.map(|v| v.batches);
        if done || pixels.iter().zip(&wanted).all(|(pixel, batches)| pixel.batches >= *batches) {
            let end = |(p, v): (&Moments, &common::adaptive::Verdict)| End {
                samples: p.samples.into(),
                mean: p.luminance(),
                half_width: v.half_width,
            };
            return pixels.iter().zip(&verdicts).map(end).collect();
        }
    }
}
