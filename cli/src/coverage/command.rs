//! `tessera coverage`: its options, and what it prints.

use std::path::PathBuf;

use super::{Effort, Options, PARTS, Section, broken, page, run};
use crate::error::Failure;

/// Options of `coverage`.
#[derive(Debug, clap::Args)]
pub struct CoverageArgs {
    /// A folder for charts (SVG and PNG) and CSVs
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// The page with tables and charts [default: README.md in the folder]
    #[arg(long, value_name = "FILE")]
    pub page: Option<PathBuf>,
    /// Only this part; may be repeated
    #[arg(long, value_name = "PART")]
    pub only: Vec<String>,
    /// Simulated trials, of nine pixels each
    #[arg(long, value_name = "N", default_value_t = 900, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub trials: u32,
    /// Less of everything, with wider bounds: in full, the part bias alone takes 16 minutes of one core
    #[arg(long)]
    pub quick: bool,
    /// Folder of the shipped scenes
    #[arg(long, value_name = "DIR", default_value = "scenes")]
    pub scenes: PathBuf,
    /// Print what is held to bounds as JSON
    #[arg(long)]
    pub json: bool,
}

/// Runs `tessera coverage`, prints what is held to bounds, and fails where one does not hold.
///
/// # Errors
/// A broken bound, a part or a scene that does not exist, or a file that cannot be written.
pub fn command(args: CoverageArgs) -> Result<(), Failure> {
    let trials = if args.quick { args.trials.min(100) } else { args.trials };
    let effort = Effort { trials, quick: args.quick, scenes: args.scenes };
    let sections = run(PARTS, &Options { out: args.output, page: args.page, only: args.only, effort })?;
    crate::print::lines([if args.json { json(&sections) } else { page::bounds(&sections) }])?;
    verdict(&sections)
}

/// An error that names the figures that left their bounds, if there are any.
pub(super) fn verdict(sections: &[Section]) -> Result<(), Failure> {
    let broken: Vec<String> = broken(sections).map(|b| format!("{} is {:.4}", b.what, b.found)).collect();
    if broken.is_empty() { Ok(()) } else { Err(Failure::Work(format!("bounds do not hold: {}", broken.join("; ")))) }
}

fn json(sections: &[Section]) -> String {
    let bounds = sections.iter().flat_map(|section| &section.bounds).map(|b| {
        serde_json::json!({
            "what": b.what, "found": b.found, "low": b.low, "high": b.high,
            "holds": b.holds(), "goal_reached": b.reached(),
        })
    });
    format!("{:#}", serde_json::json!({ "bounds": bounds.collect::<Vec<_>>() }))
}
