//! `tessera bench`: how fast the parts are, measured by themselves. It knows nothing of farms.

mod figures;
pub mod rays;
mod render;

use clap::Subcommand;

use crate::error::Failure;

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Render a scene at a fixed number of samples, without a farm, and print samples per processor second
    Render(render::BenchRenderArgs),
    /// Build a scene's acceleration structure and trace rays of every kind, on one core and on all
    Rays(figures::BenchRaysArgs),
}

/// Runs `tessera bench`.
///
/// # Errors
/// A scene that cannot be read or rendered, or a file that cannot be written.
pub fn command(command: BenchCommand) -> Result<(), Failure> {
    match command {
        BenchCommand::Render(args) => render::command(args),
        BenchCommand::Rays(args) => figures::command(args),
    }
}
