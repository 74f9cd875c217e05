//! The size of a batch, and batches in sets: what independent scrambles cost of what well-spread points gain.

use common::{
    film::Moments,
    pass::{BATCH, BATCHES_PER_SET, Work},
};
use plot::{Axis, Chart, Guide, Series, Style};

use super::{Bound, Effort, Figure, Grid, Part, Section, Value, parallel, stage::Stage, tolerances::point};
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
    let mut sets = Grid::new(
        "sets",
        "Samples in batches of 16, each drawn by itself or so many to a set: variance of a pixel's estimate as above, what \
         the spread between its batches tells of it, and the second over the first.",
        &["scene", "samples", "batches of a set", "relative variance", "as told", "told over true"],
    );
    let mut bounds = Vec::new();
    let mut series = Vec::new();
    for name in scenes {
        let stage = Stage::open(effort, name, edge)?;
        let found = SIZES.map(|size| {
            let work = Work::Uniform { first: 0, samples: SAMPLES };
            let films = parallel::map(seeds, |seed| stage.in_batches(size, 1, 1 + seed as u64, &work));
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
        for (samples, set) in [(64, 1), (64, BATCHES_PER_SET), (256, 1), (256, BATCHES_PER_SET), (256, 16)] {
            let work = Work::Uniform { first: 0, samples };
            let films = parallel::map(seeds, |seed| stage.in_batches(BATCH, set, 101 + seed as u64, &work));
            let (found, told) = (variance(&films), told(&films));
            let numbers = [(f64::from(samples), 0), (set.into(), 0), (found, 5), (told, 5), (told / found, 3)];
            let row = numbers.map(|(value, decimals)| Value::Number(value, decimals));
            sets.rows.push([Value::from(name)].into_iter().chain(row).collect());
            if set <= BATCHES_PER_SET {
                let how = if set == 1 { "batches by themselves" } else { "batches in sets" };
                // What is told of independent batches is their variance; of batches in sets it may not be less.
                let most = if set == 1 { effort.of(1.15, 2.5) } else { 2.5 };
                bounds.push(Bound {
                    what: format!("variance told over true, {name}, {samples} samples, {how}"),
                    found: told / found,
                    low: effort.of(0.87, 0.4),
                    high: most,
                    goal: None,
                });
            }
        }
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
                which says nothing of its error. A fixed number of samples has both: its batches of 16 are the parts of sets of \
                64, spread evenly by themselves and together (consecutive parts of one scrambled sequence), so that each four \
                of them err as a batch of 64 does. Their spread then tells the error of four batches by themselves: error bars \
                of fixed counts are too wide, by the square root of the last column below. Where a noise target is asked for, \
                batches are drawn by themselves: a rule that stops by an error that is too large stops late.";
    Ok(Section {
        title: "The size of a batch, and sets of batches",
        text: format!(
            "{SAMPLES} samples of each pixel at {edge} x {edge}, {seeds} seeds; the spread between seeds is the error."
        ),
        figures: vec![Figure { id: "batches".into(), chart, says: says.into() }],
        grids: vec![grid, sets],
        bounds,
    })
}

/// Mean over films and pixels of the variance of the mean that a pixel's batches tell, relative as in [`variance`].
fn told(films: &[Vec<Moments>]) -> f64 {
    let pixels = films.first().map_or(0, Vec::len);
    let of = |index: usize| {
        let n = films.len() as f64;
        let mean = films.iter().map(|film| film[index].luminance()).sum::<f64>() / n;
        let told = films.iter().filter_map(|film| film[index].variance_of_mean()).sum::<f64>() / n;
        told / (mean * mean + 0.01)
    };
    (0..pixels).map(of).sum::<f64>() / pixels as f64
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
