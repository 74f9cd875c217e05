//! `tessera chart`: speed against accuracy. Methods are tried on one scene at doubling budgets with several seeds,
//! held against a reference whose own noise is taken out, and drawn.
//!
//! What is measured is processor time of rendering alone: reading the scene and building its trees are told apart.
//! Methods take turns, so that whatever else the machine does falls on all alike.

mod choice;
mod command;
mod gauge;
mod methods;
mod options;
mod reference;
mod report;
mod stage;
mod study;

#[cfg(test)]
mod tests;

pub use choice::{BenchAutoArgs, command as bench_auto};
pub use command::{ChartArgs, command};
