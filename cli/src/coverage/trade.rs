//! What each constant of the rule buys, and what it costs.

use common::{
    adaptive::{Constants, Rule},
    pass::BATCH,
};
use plot::{Axis, Chart, Series, Style};

use super::{
    Effort, Figure, Grid, Part, Section, Truth, Value,
    simulated::{Around, frames, ours},
    tolerances::{goal, point},
};
use crate::error::Failure;

/// Coverage against cost.
pub(super) const PART: Part = Part { id: "trade", measure };

/// Where it is studied.
const TOLERANCE: f64 = 0.1;
const CAP: u32 = 4096;

fn measure(effort: &Effort) -> Result<Section, Failure> {
    let frames = (frames(effort.trials) / 3).max(2);
    // Cost against what renders, mean coverage.
    let study = |constants: Constants, around: &[Around], truths: &[Truth]| {
        let rule = Rule::with(constants, TOLERANCE, 0.95, CAP, BATCH);
        let cells = around.iter().flat_map(|around| truths.iter().map(move |truth| (*around, *truth)));
        let found: Vec<_> =
            cells.map(|(around, truth)| ours(std::slice::from_ref(&rule), truth, around, frames, 50)).collect();
        let n = found.len() as f64;
        let logs = found.iter().map(|o| o.samples.ln()).sum::<f64>();
        (found.iter().map(|o| o.coverage).sum::<f64>() / n, (logs / n).exp())
    };
    let alike = |constants| study(constants, &[Around::Alike], &Truth::TEXTBOOK);
    let edges =
        |constants| study(constants, &[Around::Quiet, Around::Border], &[Truth::Exponential, Truth::Lognormal(1.0)]);
    let (as_is, as_is_edges) = (alike(Constants::default()), edges(Constants::default()));
    let is = Constants::default();
    let kinds: [(&str, Vec<(String, Constants)>); 7] = [
        ("slack of predictions", variants(&[1.0, 1.02, 1.05, 1.2, 1.5], |slack| Constants { slack, ..is })),
        ("widening", variants(&[1.0, 1.01, 1.05, 1.1], |widening| Constants { widening, ..is })),
        ("widening for few batches", variants(&[0.0, 1.0, 2.0, 4.0], |few| Constants { few, ..is })),
        ("luck", variants(&[0.0, 0.5, 1.0, 2.0], |luck| Constants { luck, ..is })),
        ("significance", variants(&[2.0, 4.0, 8.0, 1e9], |significance| Constants { significance, ..is })),
        ("strength of neighbours", variants(&[0.0, 32.0, 128.0, 4096.0], |s| Constants { strength: s as u32, ..is })),
        ("batches of the pilot", variants(&[2.0, 4.0, 8.0, 16.0], |pilot| Constants { pilot: pilot as u32, ..is })),
    ];
    let mut grid = Grid::new(
        "trade",
        "Each constant varied alone at a tolerance of 10%; samples are relative to the rule that renders.",
        &["constant", "value", "coverage, alike", "samples, alike", "coverage, at edges", "samples, at edges"],
    );
    let mut series = [Vec::new(), Vec::new()];
    for (name, values) in kinds {
        let mut lines = [Series::new(name, Style::Line, []), Series::new(name, Style::Line, [])];
        for (value, constants) in values {
            let (a, e) = (alike(constants), edges(constants));
            lines[0].points.push(point(a.1 / as_is.1, a.0, 0.0));
            lines[1].points.push(point(e.1 / as_is_edges.1, e.0, 0.0));
            grid.rows.push(vec![
                name.into(),
                value.into(),
                Value::Number(a.0, 3),
                Value::Number(a.1 / as_is.1, 3),
                Value::Number(e.0, 3),
                Value::Number(e.1 / as_is_edges.1, 3),
            ]);
        }
        let [a, e] = lines;
        series[0].push(a);
        series[1].push(e);
    }
    let [alike, edges] = series;
    let chart = |title: &str, series| Chart {
        title: title.into(),
        x: Axis::linear("samples against the rule that renders", ""),
        y: Axis::linear("mean coverage", "").between(0.86, 1.0),
        series,
        guides: goal(),
        notes: vec![],
    };
    let figure = |id: &str, chart, says: &str| Figure { id: id.into(), chart, says: says.into() };
    Ok(Section {
        title: "What each constant buys",
        text: format!(
            "Each constant of the rule varied alone, the others as they render, at a tolerance of 10% ({} pixels a point). \
             \"Alike\" is the mean over the five distributions on which the textbook rule holds; \"edges\" that over \
             exponential and lognormal pixels alone among quiet ones and at a border.",
            frames * 225
        ),
        figures: vec![
            figure(
                "trade-alike",
                chart("Coverage against cost, pixels alike (tolerance 10%)", alike),
                "Among pixels alike the rule sits where coverage is what intervals claim. Widening buys coverage at its \
                 square in samples, as it must; a larger pilot or more slack costs samples and buys little here.",
            ),
            figure(
                "trade-edges",
                chart("Coverage against cost, noisy pixels at edges (tolerance 10%)", edges),
                "At edges the constant that matters is the significance at which quieter neighbours lose their say: \
                 without it (`none` in the table) a pixel at the border of noise is talked out of a part of \
                 its own.",
            ),
        ],
        grids: vec![grid],
        ..Section::default()
    })
}

fn variants(values: &[f64], of: impl Fn(f64) -> Constants) -> Vec<(String, Constants)> {
    let name = |value: f64| if value >= 1e6 { "none".into() } else { format!("{value}") };
    values.iter().map(|value| (name(*value), of(*value))).collect()
}
