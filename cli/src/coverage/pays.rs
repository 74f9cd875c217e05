//! Whether adaptive sampling pays: processor seconds to the same error, against the same samples everywhere.

use common::{
    adaptive::Rule,
    pass::{BATCH, Work},
};
use plot::{Axis, Chart, Guide, Series, Style};

use super::{Bound, Effort, Figure, Grid, Part, Section, Value, bias::mean, intervals, refine, stage::Stage};
use crate::error::Failure;

/// Adaptive against uniform.
pub(super) const PART: Part = Part { id: "pays", measure };

const SCENES: [&str; 4] = ["cornell-box", "cornell-spheres", "veach-plates", "mesh-light"];
/// Share of pixels that are to keep the target.
const SHARE: f64 = common::adaptive::FRAME_SHARE;

fn measure(effort: &Effort) -> Result<Section, Failure> {
    let edge = effort.of(64, 24);
    let samples = effort.of(1024, 256);
    let blocks = effort.of(2, 1);
    let scenes = effort.of(&SCENES[..], &SCENES[..1]);
    let mut grid = Grid::new(
        "pays",
        "Processor seconds of one thread, means over the blocks, which took turns; the ratio is uniform over adaptive, so \
         more than 1 means that adaptive sampling pays.",
        &[
            "scene",
            "noise",
            "uniform samples",
            "uniform met",
            "adaptive samples",
            "adaptive met",
            "uniform s",
            "adaptive s",
            "ratio",
            "+-",
        ],
    );
    let mut line = Series::new("processor seconds, uniform over adaptive", Style::Bars, []);
    let mut bounds = Vec::new();
    for (place, &name) in scenes.iter().enumerate() {
        let stage = Stage::open(effort, name, edge)?;
        let uniform = |seed| stage.render(seed, &Work::Uniform { first: 0, samples });
        // The target that so many samples everywhere bring 99% of pixels to.
        let film = uniform(1);
        let any = Rule::new(1.0, 0.95, samples, BATCH);
        let relative = intervals(&any, stage.frame, &film);
        let scale = |index: usize| film[index].luminance().abs().max(common::adaptive::FLOOR);
        let mut errors: Vec<f64> = relative.iter().enumerate().map(|(i, end)| end.0 / scale(i)).collect();
        errors.sort_by(f64::total_cmp);
        let noise = errors[((errors.len() as f64 * SHARE) as usize).min(errors.len() - 1)];
        let rule = Rule::new(noise, 0.95, 4 * samples, BATCH);
        let met = |film: &[_]| {
            let ends = intervals(&rule, stage.frame, film);
            ends.iter().filter(|end| end.1).count() as f64 / ends.len() as f64
        };
        let (mut ratios, mut columns) = (Vec::new(), [const { Vec::new() }; 5]);
        for block in 0..blocks {
            let start = clock()?;
            let ours = refine(&rule, stage.frame, Vec::new(), |work| stage.render(10 + block, work)).0;
            let between = clock()?;
            let theirs = uniform(20 + block);
            let end = clock()?;
            ratios.push((end - between) / (between - start));
            let mean_samples = ours.iter().map(|p| f64::from(p.samples)).sum::<f64>() / ours.len() as f64;
            let all = [met(&theirs), mean_samples, met(&ours), end - between, between - start];
            columns.iter_mut().zip(all).for_each(|(column, value)| column.push(value));
        }
        let (ratio, error) = mean(&ratios);
        let [uniform_met, ours_samples, ours_met, uniform_seconds, ours_seconds] =
            columns.map(|column| mean(&column).0);
        line.points.push(super::tolerances::point(place as f64, ratio, 0.0));
        grid.rows.push(vec![
            name.into(),
            Value::Number(noise, 3),
            Value::Number(samples.into(), 0),
            Value::Number(uniform_met, 4),
            Value::Number(ours_samples, 0),
            Value::Number(ours_met, 4),
            Value::Number(uniform_seconds, 1),
            Value::Number(ours_seconds, 1),
            Value::Number(ratio, 2),
            Value::Number(error, 2),
        ]);
        bounds.push(Bound {
            what: format!(
                "processor seconds of {name} sampled uniformly, over adaptively, to the shares met in its table"
            ),
            found: ratio,
            low: 1.0,
            high: f64::INFINITY,
            goal: None,
        });
    }
    let chart = Chart {
        title: format!("What adaptive sampling saves: seconds to bring {}% of pixels under the target", SHARE * 100.0),
        x: Axis::names("scene", scenes.iter().copied()),
        y: Axis::linear("ratio of processor seconds, uniform over adaptive", ""),
        series: vec![line],
        guides: vec![Guide::Level { y: 1.0, label: "no gain".into() }],
        notes: vec![],
    };
    let says = "The gain is that of the hardest hundredth of the pixels over the average one: uniform sampling takes \
                everywhere what they need. Where a whole frame is about as noisy, there is little to gain.";
    Ok(Section {
        title: "Adaptive sampling pays",
        text: format!(
            "Each scene at {edge} x {edge}: {samples} samples everywhere bring 99% of its pixels under some noise; that noise \
             is then asked of the adaptive rule (cap {} samples). Both are judged by the same pooled interval. Rendered on one thread, adaptive and uniform in turn, {blocks} times.",
            4 * samples
        ),
        figures: vec![Figure { id: "pays".into(), chart, says: says.into() }],
        grids: vec![grid],
        bounds,
    })
}

/// Processor seconds of this process so far.
#[cfg(unix)]
fn clock() -> Result<f64, Failure> {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Ok(now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9)
}

/// Processor seconds of this process so far.
#[cfg(not(unix))]
fn clock() -> Result<f64, Failure> {
    Err(Failure::Work("processor time cannot be measured on this system: leave out this part with --only".into()))
}
