//! Tables as comma-separated values.

use std::fmt::Write;

/// A table of numbers and words, written as CSV (RFC 4180, lines end in LF).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table with these columns.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = S>) -> Self {
        Self { columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Adds a row, one cell a column. Numbers are written so that reading gives the same number back.
    ///
    /// # Panics
    /// If there are more or fewer cells than columns.
    pub fn push<S: ToString>(&mut self, cells: impl IntoIterator<Item = S>) {
        let cells: Vec<String> = cells.into_iter().map(|cell| cell.to_string()).collect();
        assert_eq!(cells.len(), self.columns.len(), "a row has one cell a column");
        self.rows.push(cells);
    }

    /// Names of the columns.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The table as CSV, header first.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut out = String::new();
        for row in std::iter::once(&self.columns).chain(&self.rows) {
            for (i, cell) in row.iter().enumerate() {
                let comma = if i == 0 { "" } else { "," };
                // Writing to a String does not fail.
                let _ = if cell.contains([',', '"', '\n', '\r']) {
                    write!(out, "{comma}\"{}\"", cell.replace('"', "\"\""))
                } else {
                    write!(out, "{comma}{cell}")
                };
            }
            out.push('\n');
        }
        out
    }
}
