//! `tessera stability`: its options, and what it prints.

use super::{Effort, Error, Options, ROWS, Report, run};
use std::io::Write;
use std::path::PathBuf;

/// Options of `stability`.
#[derive(Debug, clap::Args)]
pub struct StabilityArgs {
    /// A folder for charts (SVG and PNG) and CSVs
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// The page with the table and all charts [default: README.md in the folder]
    #[arg(long, value_name = "FILE")]
    pub page: Option<PathBuf>,
    /// Only this row, or the rows whose names begin so; may be repeated
    #[arg(long, value_name = "ROW")]
    pub only: Vec<String>,
    /// Fewer trials: seconds instead of half a minute
    #[arg(long)]
    pub quick: bool,
    /// Print the table as JSON
    #[arg(long)]
    pub json: bool,
}

/// Runs `tessera stability`, prints the table, and fails where a bound is broken.
///
/// # Errors
/// A broken bound, a row that does not exist, or a file that cannot be written.
pub fn command(args: StabilityArgs) -> Result<(), Error> {
    let effort = if args.quick { Effort::Quick } else { Effort::Full };
    let json = args.json;
    let report = run(ROWS, &Options { out: args.output, page: args.page, only: args.only, effort })?;
    let text = if json { format!("{:#}\n", report.json()) } else { report.text() };
    // A reader that has gone away has read enough.
    let _ = std::io::stdout().write_all(text.as_bytes());
    verdict(&report)
}

/// An error that names the rows whose bounds are broken, if there are any.
pub(super) fn verdict(report: &Report) -> Result<(), Error> {
    let broken: Vec<&str> = report.broken().map(|(row, _)| row.id).collect();
    if broken.is_empty() { Ok(()) } else { Err(Error::Broken(broken.join(", "))) }
}
