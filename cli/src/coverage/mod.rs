//! How honest the error bars are, and what they cost: the study behind docs/accuracy.md.
//!
//! Each [`Part`] measures one thing, on simulated pixels whose truth is known or on rendered ones beside a
//! reference, and calls what renders: `common::adaptive`, the coordinator's planner, the tracer. No rule is
//! repeated here but the textbook's. [`run`] writes charts, CSVs and one page; a bound that does not hold makes
//! the command fail.

mod batches;
mod bias;
mod command;
mod continued;
mod page;
mod pays;
mod refine;
mod rendered;
mod section;
pub mod simulated;
mod stage;
mod tolerances;
mod trade;
mod truth;

pub use command::{CoverageArgs, command};
pub use refine::{intervals, refine};
pub use section::{Bound, Figure, Grid, Section, Value};
pub use truth::Truth;

use std::path::{Path, PathBuf};

use crate::{error::Failure, parallel};

/// One thing that is measured.
#[derive(Debug, Clone, Copy)]
pub struct Part {
    /// Its name on the command line: lower case, words joined by `-`.
    pub id: &'static str,
    /// Measures it.
    pub measure: fn(&Effort) -> Result<Section, Failure>,
}

/// Every part, in the order of the page.
pub const PARTS: &[Part] =
    &[tolerances::PART, trade::PART, continued::PART, rendered::PART, bias::PART, pays::PART, batches::PART];

/// How much is measured.
#[derive(Debug, Clone)]
pub struct Effort {
    /// Simulated trials, of nine pixels each.
    pub trials: u32,
    /// Whether to take less of everything: seconds, and bounds as wide as so few trials need.
    pub quick: bool,
    /// Folder of the shipped scenes.
    pub scenes: PathBuf,
}

impl Effort {
    /// `full`, or `quick` where less is measured.
    fn of<T>(&self, full: T, quick: T) -> T {
        if self.quick { quick } else { full }
    }
}

/// What to run and where to put it.
#[derive(Debug, Clone)]
pub struct Options {
    /// Folder for charts and CSVs; made where it is missing.
    pub out: PathBuf,
    /// The page; `None`: `README.md` in `out`.
    pub page: Option<PathBuf>,
    /// Parts to run, by id; empty for all.
    pub only: Vec<String>,
    /// How much.
    pub effort: Effort,
}

/// Measures those of `parts` that the options name, and writes charts, CSVs and the page.
///
/// # Errors
/// When no part has the name asked for, a scene cannot be read, or a file cannot be written.
pub fn run(parts: &[Part], options: &Options) -> Result<Vec<Section>, Failure> {
    for name in &options.only {
        if !parts.iter().any(|part| part.id == name) {
            let ids: Vec<&str> = parts.iter().map(|part| part.id).collect();
            return Err(Failure::Input(format!("--only {name}: no such part; expected one of {}", ids.join(", "))));
        }
    }
    std::fs::create_dir_all(&options.out).map_err(|error| unwritten(&options.out, &error))?;
    let wanted = |part: &&Part| options.only.is_empty() || options.only.iter().any(|name| name == part.id);
    let mut sections = Vec::new();
    for part in parts.iter().filter(wanted) {
        let section = (part.measure)(&options.effort)?;
        for figure in &section.figures {
            write(&options.out.join(format!("{}.svg", figure.id)), plot::svg(&figure.chart).as_bytes())?;
            write(&options.out.join(format!("{}.png", figure.id)), &plot::png(&figure.chart))?;
        }
        for grid in &section.grids {
            write(&options.out.join(format!("{}.csv", grid.id)), grid.csv().as_bytes())?;
        }
        sections.push(section);
    }
    let page = options.page.clone().unwrap_or_else(|| options.out.join("README.md"));
    write(&page, page::page(&sections, &crate::stability::page::way(&page, &options.out)).as_bytes())?;
    Ok(sections)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|error| unwritten(path, &error))
}

fn unwritten(path: &Path, error: &std::io::Error) -> Failure {
    Failure::Work(format!("{}: cannot be written: {}", path.display(), crate::error::reason(error)))
}

/// Bounds that do not hold.
pub fn broken(sections: &[Section]) -> impl Iterator<Item = &Bound> {
    sections.iter().flat_map(|section| &section.bounds).filter(|bound| !bound.holds())
}

#[cfg(test)]
mod tests;
