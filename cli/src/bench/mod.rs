//! `tessera bench`: how fast the parts are, measured by themselves. It knows nothing of farms.

mod figures;
pub mod rays;
mod render;

use std::path::PathBuf;

use clap::Subcommand;

use crate::{
    chart::{BenchAutoArgs, bench_auto},
    error::Failure,
};

pub(crate) use render::process_seconds;

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Render a scene at a fixed number of samples, without a farm, and print samples per processor second
    Render(render::BenchRenderArgs),
    /// Build a scene's acceleration structure and trace rays of every kind, on one core and on all
    Rays(figures::BenchRaysArgs),
    /// Hold what `--direct auto` chooses against the best choice that could be named, scene by scene
    Auto(BenchAutoArgs),
}

/// What all measure with: a scene, and how the figures are told.
#[derive(Debug, clap::Args)]
pub struct Measured {
    /// A scene file, or a bare mesh file
    pub scene: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Runs `tessera bench`.
///
/// # Errors
/// A scene that cannot be read or rendered, or a file that cannot be written.
pub fn command(command: BenchCommand) -> Result<(), Failure> {
    match command {
        BenchCommand::Render(args) => render::command(args),
        BenchCommand::Rays(args) => figures::command(args),
        BenchCommand::Auto(args) => bench_auto(&args),
    }
}
