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

    /// Adds a row, one cell a column.
    ///
    /// # Panics
    /// If there are more or fewer cells than columns.
    pub fn push(&mut self, cells: impl IntoIterator<Item = Cell>) {
        let cells: Vec<String> = cells.into_iter().map(|cell| cell.0).collect();
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

/// What stands in one place of a table: words as they are, numbers to seven significant digits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cell(String);

impl From<f64> for Cell {
    fn from(v: f64) -> Self {
        let rounded: f64 = format!("{v:.6e}").parse().unwrap_or(v);
        let plain = rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs()) || !rounded.is_finite();
        Self(if plain { format!("{rounded}") } else { format!("{rounded:e}") })
    }
}

macro_rules! as_written {
    ($($ty:ty),+) => {$(
        impl From<$ty> for Cell {
            fn from(v: $ty) -> Self {
                Self(v.to_string())
            }
        }
    )+};
}

as_written!(&str, String, i32, u32, usize);
