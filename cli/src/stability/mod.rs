//! Each method at the place where it fails: the textbook form beside the one that renders.
//!
//! A [`Row`] sweeps the quantity that breaks a method, and measures the error of the textbook form and
//! of ours against a reference in double precision or closed form. What is ours is called in `tracer` and
//! `common`, by the functions that rendering uses; no formula of theirs is repeated here. [`run`] writes
//! for each row a chart and a CSV, and one page with the table of all; a bound that does not hold makes
//! the command fail.

mod command;
mod lights;
mod microfacet;
mod offsets;
pub(crate) mod page;
pub(crate) mod random;
mod schlick;
mod shapes;
mod slabs;
mod statistics;
mod stopping;
mod trees;
mod triangles;
mod weights;

pub use command::{StabilityArgs, command};

use plot::{Chart, Table};
use std::path::{Path, PathBuf};

/// How much work a row may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// A few seconds for all rows: what CI runs.
    Quick,
    /// What the documents show.
    Full,
}

impl Effort {
    /// `full`, or `quick` under [`Effort::Quick`].
    fn of<T>(self, full: T, quick: T) -> T {
        if self == Effort::Quick { quick } else { full }
    }
}

/// One method and its failure.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Its name on the command line and of its files: lower case, words joined by `-`.
    pub id: &'static str,
    /// The method, in words.
    pub title: &'static str,
    /// Why the textbook form fails: one sentence.
    pub fails: &'static str,
    /// What ours does instead: one sentence.
    pub instead: &'static str,
    /// Measures it.
    pub measure: fn(Effort) -> Outcome,
}

/// What a row measured.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The error against the quantity that breaks the method.
    pub chart: Chart,
    /// The same figures, and those that the chart leaves out.
    pub table: Table,
    /// What the figures below are, in words; the smaller the better.
    pub figure: &'static str,
    /// The textbook form's worst.
    pub textbook: f64,
    /// Our worst.
    pub ours: f64,
    /// What ours may not exceed.
    pub bound: f64,
}

impl Outcome {
    /// Whether ours keeps the bound; an error that is not a number does not.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.ours <= self.bound
    }
}

/// Every row, in the order of the page.
pub const ROWS: &[Row] = &[
    triangles::LEAKS,
    slabs::SLABS,
    trees::BUILD,
    offsets::SCALE,
    offsets::GAP,
    lights::TRIANGLE,
    lights::RECTANGLE,
    lights::SPHERE,
    schlick::ANGLE,
    schlick::INDEX,
    schlick::METALS,
    microfacet::GGX,
    weights::MIS,
    weights::ROULETTE,
    weights::ROULETTE_GLASS,
    lights::CHOICE,
    statistics::VARIANCE,
    stopping::STOPPING,
    statistics::SUMS,
];

/// What to run and where to put it.
#[derive(Debug, Clone)]
pub struct Options {
    /// Folder for charts and CSVs; made where it is missing.
    pub out: PathBuf,
    /// The page with the table; `None`: `README.md` in `out`.
    pub page: Option<PathBuf>,
    /// Rows to run, by id or by its first words; empty for all.
    pub only: Vec<String>,
    /// How much work.
    pub effort: Effort,
}

/// What was found, row by row.
#[derive(Debug, Clone)]
pub struct Report {
    /// Each row that ran and its outcome.
    pub rows: Vec<(Row, Outcome)>,
}

impl Report {
    /// Rows whose bound does not hold.
    pub fn broken(&self) -> impl Iterator<Item = &(Row, Outcome)> {
        self.rows.iter().filter(|(_, outcome)| !outcome.holds())
    }

    /// The table as JSON, for `--json`.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        let rows = self.rows.iter().map(|(row, outcome)| {
            serde_json::json!({
                "row": row.id,
                "figure": outcome.figure,
                "textbook": finite(outcome.textbook),
                "ours": finite(outcome.ours),
                "bound": finite(outcome.bound),
                "holds": outcome.holds(),
            })
        });
        serde_json::json!({ "rows": rows.collect::<Vec<_>>(), "broken": self.broken().count() })
    }

    /// The table in words, for the terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = format!("{:24} {:>10} {:>10} {:>10}  \n", "", "textbook", "ours", "bound");
        for (row, o) in &self.rows {
            let mark = if o.holds() { "" } else { "BROKEN " };
            let [textbook, ours, bound] = [o.textbook, o.ours, o.bound].map(page::figure);
            out += &format!("{:24} {textbook:>10} {ours:>10} {bound:>10}  {mark}{}\n", row.id, o.figure);
        }
        out
    }
}

/// JSON has no word for infinity.
fn finite(v: f64) -> serde_json::Value {
    serde_json::Number::from_f64(v).map_or_else(|| format!("{v}").into(), Into::into)
}

/// Why the command failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No row has this name.
    #[error("--only {0}: no such row; expected one of {1}")]
    NoSuchRow(String, String),
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {error}", path.display())]
    Write {
        /// Its path.
        path: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// These rows ran, and ours left its bound.
    #[error("bounds do not hold: {0}")]
    Broken(String),
}

impl Error {
    /// The process' exit code: 2 where the input was wrong, 1 where the work failed.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::NoSuchRow(..) => 2,
            Self::Write { .. } | Self::Broken(_) => 1,
        }
    }
}

/// Runs those of `rows` that the options name, and writes charts, CSVs and the page.
///
/// # Errors
/// When no row has the name asked for, or a file cannot be written.
pub fn run(rows: &[Row], options: &Options) -> Result<Report, Error> {
    let chosen = choose(rows, &options.only)?;
    let unwritten = |path: &Path, error| Error::Write { path: path.to_path_buf(), error };
    std::fs::create_dir_all(&options.out).map_err(|error| unwritten(&options.out, error))?;
    let write = |path: &Path, bytes: &[u8]| std::fs::write(path, bytes).map_err(|error| unwritten(path, error));
    let mut report = Report { rows: Vec::new() };
    for row in chosen {
        let outcome = (row.measure)(options.effort);
        let file = |extension: &str| options.out.join(format!("{}.{extension}", row.id));
        write(&file("svg"), plot::svg(&outcome.chart).as_bytes())?;
        write(&file("png"), &plot::png(&outcome.chart))?;
        write(&file("csv"), outcome.table.csv().as_bytes())?;
        report.rows.push((row, outcome));
    }
    let page = options.page.clone().unwrap_or_else(|| options.out.join("README.md"));
    write(&page, page::page(&report, &page::way(&page, &options.out)).as_bytes())?;
    Ok(report)
}

fn choose(rows: &[Row], only: &[String]) -> Result<Vec<Row>, Error> {
    for name in only {
        if !rows.iter().any(|row| row.id.starts_with(name.as_str())) {
            let ids: Vec<&str> = rows.iter().map(|row| row.id).collect();
            return Err(Error::NoSuchRow(name.clone(), ids.join(", ")));
        }
    }
    let wanted = |row: &Row| only.is_empty() || only.iter().any(|name| row.id.starts_with(name.as_str()));
    Ok(rows.iter().copied().filter(wanted).collect())
}

/// `count` values from `low` to `high`, both included, in equal ratios.
fn ratios(low: f64, high: f64, count: usize) -> Vec<f64> {
    let step = (high / low).ln() / (count.max(2) - 1) as f64;
    (0..count).map(|i| if i + 1 == count { high } else { low * (step * i as f64).exp() }).collect()
}

/// The largest value; NaN if any is, for a figure that is not a number may not pass as small.
fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}

#[cfg(test)]
mod tests;
