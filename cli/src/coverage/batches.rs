//! The size of a batch: what independent scrambles cost of what well-spread points gain.

use common::{film::Moments, pass::Work};
use plot::{Axis, Chart, Guide, Series, Style};

use super::{Effort, Figure, Grid, Part, Section, Value, parallel, stage::Stage, tolerances::point};
use crate::error::Failure;

/// Error by batch size.
pub(super) const PART: Part = Part { id: "batches", measure };

const SIZES: [u32; 6] = [1, 4, 8, 16, 32, 64];
/// Samples of a pixel.
const SAMPLES: u32 = 256;

fn measure(effort: &Effort) -> Result<Section, Failure> {
    let edge = effort.of(24, 12);
    let seeds = effort.of(24, 4);
    let scenes = ["cornell-box", "veach-plates"];
    let mut grid = Grid::new(
        "batches",
        "Variance of a pixel's estimate from 256 samples, relative to its luminance squared plus 0.01 and averaged over \
         the frame, against that with batches of 16.",
        &["scene", "batch", "relative variance", "against batches of 16"],
    );
    let mut series = Vec::new();
    for name in scenes {
        let stage = Stage::open(effort, name, edge)?;
        let found = SIZES.map(|size| {
            let work = Work::Uniform { first: 0, samples: SAMPLES };
            let films = parallel::map(seeds, |seed| stage.in_batches(size, 1 + seed as u64, &work));
            variance(&films)
        });
        let at_16 = found[SIZES.iter().position(|size| *size == 16).unwrap_or(0)];
        let mut line = Series::new(name, Style::Line, []);
        for (size, found) in SIZES.into_iter().zip(found) {
            line.points.push(point(f64::from(size), found / at_16, 0.0));
            let row = [Value::Number(size.into(), 0), Value::Number(found, 5), Value::Number(found / at_16, 3)];
            grid.rows.push([Value::from(name)].into_iter().chain(row).collect());
        }
        series.push(line);
    }
    let chart = Chart {
        title: "Variance from 256 samples, by the size of the batches they come in".into(),
        x: Axis::log("samples of a batch", ""),
        y: Axis::linear("variance against batches of 16", ""),
        series,
        guides: vec![Guide::At { x: 16.0, label: "what renders".into() }],
        notes: vec![],
    };
    let says = "Batches of 1 are independent samples. Longer sets are spread better, and their gain grows slowly past 16 \
                on scenes whose paths bounce; but 64 samples in batches of 16 are four batches, in batches of 64 a single one, \
                which says nothing of its error.";
    Ok(Section {
        title: "The size of a batch",
        text: format!(
            "{SAMPLES} samples of each pixel at {edge} x {edge}, {seeds} seeds; the spread between seeds is the error."
        ),
        figures: vec![Figure { id: "batches".into(), chart, says: says.into() }],
        grids: vec![grid],
        ..Section::default()
    })
}

/// Mean over pixels of the variance between films, relative to luminance squared plus 0.01.
fn variance(films: &[Vec<Moments>]) -> f64 {
    let pixels = films.first().map_or(0, Vec::len);
    let of = |index: usize| {
        let values: Vec<f64> = films.iter().map(|film| film[index].luminance()).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let spread = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
        spread / (mean * mean + 0.01)
    };
    (0..pixels).map(of).sum::<f64>() / pixels as f64
}
