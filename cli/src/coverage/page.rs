//! The page that shows what was found.

use std::fmt::Write;

use super::{Bound, Section};

/// What opens the page: what the error bar means.
const OPENING: &str = include_str!("opening.md");

/// The page as Markdown; `charts` is the way from the page to the charts.
pub(super) fn page(sections: &[Section], charts: &str) -> String {
    let mut out = String::from(OPENING);
    out += "\n## What is held\n\nA figure outside its bound makes the command fail. Where the goal was stricter than what could \
            be had, both are told.\n\n";
    out += &bounds(sections);
    for section in sections {
        // Writing to a String does not fail.
        let _ = write!(out, "\n## {}\n\n{}\n", section.title, section.text.trim());
        for figure in &section.figures {
            let _ = write!(out, "\n![{}]({charts}{}.svg)\n\n{}\n", figure.chart.title, figure.id, figure.says.trim());
        }
        for grid in &section.grids {
            if grid.only_csv {
                let _ = write!(out, "\n{} [CSV]({charts}{}.csv)\n", grid.says.trim(), grid.id);
            } else {
                let table = grid.markdown();
                let _ = write!(out, "\n{} [CSV]({charts}{}.csv)\n\n{table}", grid.says.trim(), grid.id);
            }
        }
    }
    out
}

/// All bounds as a table.
pub(super) fn bounds(sections: &[Section]) -> String {
    let mut out = String::from("| Figure | Found | Bound | Goal |\n|---|---:|---:|---:|\n");
    for bound in sections.iter().flat_map(|section| &section.bounds) {
        let broken = if bound.holds() { "" } else { " (**broken**)" };
        let missed = if bound.reached() { "" } else { " (missed)" };
        let goal = bound.goal.map_or_else(String::new, |goal| span(goal) + missed);
        let Bound { what, found, low, high, .. } = bound;
        let _ = writeln!(out, "| {what} | {}{broken} | {} | {goal} |", short(*found), span((*low, *high)));
    }
    out
}

fn span((low, high): (f64, f64)) -> String {
    match (low.is_finite(), high.is_finite()) {
        (true, true) => format!("{} to {}", short(low), short(high)),
        (true, false) => format!("at least {}", short(low)),
        _ => format!("at most {}", short(high)),
    }
}

fn short(v: f64) -> String {
    let text = format!("{v:.5}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}
