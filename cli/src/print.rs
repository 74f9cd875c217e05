//! Answers on standard output. A reader who has seen enough closes it (`tessera jobs | head`): nothing is wrong then.

use std::io::{ErrorKind, Write};

use serde::Serialize;

use crate::error::Failure;

/// Print a value as JSON.
///
/// # Errors
/// Standard output cannot be written.
pub fn json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::Work(error.to_string()))?;
    lines([text])
}

/// Print lines.
///
/// # Errors
/// Standard output cannot be written.
pub fn lines(lines: impl IntoIterator<Item = String>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    let written = lines.into_iter().try_for_each(|line| writeln!(out, "{line}")).and_then(|()| out.flush());
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::Work(format!("standard output: {error}"))),
        _ => Ok(()),
    }
}

/// Print rows under a head, columns aligned.
///
/// # Errors
/// Standard output cannot be written.
pub fn table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> Result<(), Failure> {
    let rows: Vec<Vec<String>> = [head.iter().map(ToString::to_string).collect()].into_iter().chain(rows).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    lines(rows.iter().map(|row| {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}")).collect();
        cells.join("  ").trim_end().to_string()
    }))
}
