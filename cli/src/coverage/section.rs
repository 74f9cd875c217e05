//! What a part of the study found: words, tables, charts, and figures that are held to bounds.

use plot::{Chart, Table};

/// A part of the page.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Its heading.
    pub title: &'static str,
    /// What was done and what it shows: Markdown.
    pub text: String,
    /// Tables, each a CSV too.
    pub grids: Vec<Grid>,
    /// Charts.
    pub figures: Vec<Figure>,
    /// What must hold.
    pub bounds: Vec<Bound>,
}

/// A chart.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Its name as a file.
    pub id: String,
    /// The chart.
    pub chart: Chart,
    /// What it shows, in two or three sentences.
    pub says: String,
}

/// A table.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Its name as a file.
    pub id: String,
    /// What it shows.
    pub says: String,
    /// Headings, in words that also name the columns of the CSV.
    pub columns: Vec<&'static str>,
    /// Rows, one value a column.
    pub rows: Vec<Vec<Value>>,
    /// Whether the page leaves the table to the CSV.
    pub only_csv: bool,
}

/// What stands in one place of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Words.
    Words(String),
    /// A number, and how many decimals the page shows.
    Number(f64, usize),
    /// Nothing.
    Empty,
}

/// A figure and what it may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Bound {
    /// What it is.
    pub what: String,
    /// What was found.
    pub found: f64,
    /// Least it may be.
    pub low: f64,
    /// Most it may be.
    pub high: f64,
    /// What it should be, where that is more than what is held.
    pub goal: Option<(f64, f64)>,
}

impl Bound {
    /// Whether the figure keeps its bound; one that is not a number does not.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.found >= self.low && self.found <= self.high
    }

    /// Whether the figure is what it should be.
    #[must_use]
    pub fn reached(&self) -> bool {
        let (low, high) = self.goal.unwrap_or((self.low, self.high));
        self.found >= low && self.found <= high
    }
}

impl Grid {
    /// A table that the page shows.
    pub(super) fn new(id: &str, says: &str, columns: &[&'static str]) -> Self {
        let (id, says) = (id.into(), says.into());
        Self { id, says, columns: columns.into(), rows: Vec::new(), only_csv: false }
    }

    /// The table as CSV.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut table = Table::new(self.columns.iter().copied());
        for row in &self.rows {
            table.push(row.iter().map(|value| match value {
                Value::Words(words) => words.as_str().into(),
                Value::Number(number, _) => (*number).into(),
                Value::Empty => "".into(),
            }));
        }
        table.csv()
    }

    /// The table as Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let rule = self.columns.iter().enumerate().map(|(i, _)| if i == 0 { "---" } else { "---:" }.into()).collect();
        let mut out = line(self.columns.iter().map(|c| (*c).into()).collect()) + &line(rule);
        for row in &self.rows {
            out += &line(row.iter().map(Value::shown).collect());
        }
        out
    }
}

impl Value {
    fn shown(&self) -> String {
        match self {
            Value::Words(words) => words.clone(),
            Value::Number(number, decimals) => format!("{number:.decimals$}"),
            Value::Empty => String::new(),
        }
    }
}

impl From<&str> for Value {
    fn from(words: &str) -> Self {
        Value::Words(words.into())
    }
}

impl From<String> for Value {
    fn from(words: String) -> Self {
        Value::Words(words)
    }
}
