//! The page that shows a report: a table, and for each row its chart and two sentences.

use super::Report;
use std::fmt::Write;
use std::path::{Component, Path};

/// The page as Markdown; `charts` is the way from the page to the charts.
pub(super) fn page(report: &Report, charts: &str) -> String {
    let mut out = String::from(
        "# Where methods fail\n\n\
         <!-- Written by `tessera stability -o docs/stability --page docs/stability.md`. Do not edit. -->\n\n\
         Each row takes one method to the place where its textbook form fails, and puts the form that Tessera\n\
         renders with beside it. Errors are against a reference in double precision or in closed form; the\n\
         figures are each form's worst over the sweep. `tessera stability` makes this page anew and exits with 1\n\
         where a bound does not hold; the tests run every row in small (`--quick`).\n\n\
         | Method | Figure | Textbook | Ours | Bound |\n|---|---|---:|---:|---:|\n",
    );
    for (row, o) in &report.rows {
        let broken = if o.holds() { "" } else { " (**broken**)" };
        let [textbook, ours, bound] = [o.textbook, o.ours, o.bound].map(figure);
        // Writing to a String does not fail.
        let _ =
            writeln!(out, "| [{}](#{}) | {} | {textbook} | {ours}{broken} | {bound} |", row.title, row.id, o.figure);
    }
    for (row, _) in &report.rows {
        let _ = write!(
            out,
            "\n<a id=\"{id}\"></a>\n## {title}\n\n**Textbook.** {fails}\n\n**Ours.** {instead}\n\n![{title}: textbook form and ours]({charts}{id}.svg)\n\n[CSV]({charts}{id}.csv)\n",
            id = row.id,
            title = row.title,
            fails = row.fails,
            instead = row.instead,
        );
    }
    out
}

/// The way from a page to a folder, with a slash at its end; empty where the page lies in the folder.
/// Both are taken as given: they must start from the same place.
pub(crate) fn way(page: &Path, folder: &Path) -> String {
    let parts = |path: &Path| -> Vec<String> {
        path.components()
            .filter(|part| *part != Component::CurDir)
            .map(|part| part.as_os_str().to_string_lossy().into_owned())
            .collect()
    };
    let (from, to) = (parts(page.parent().unwrap_or(Path::new(""))), parts(folder));
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n("..", from.len() - common);
    up.chain(to[common..].iter().map(String::as_str)).map(|part| format!("{part}/")).collect()
}

/// A figure of the table, to three digits.
pub(crate) fn figure(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    if v.is_nan() || v.is_infinite() {
        return if v.is_nan() { "not a number".into() } else { "infinite".into() };
    }
    if v.fract() == 0.0 && v.abs() < 1e7 {
        return format!("{v}");
    }
    if (0.001..1000.0).contains(&v.abs()) {
        // Three digits, and no zeros that say nothing.
        let digits = (2 - v.abs().log10().floor() as i32).clamp(0, 5) as usize;
        let text = format!("{v:.digits$}");
        return if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text };
    }
    let text = format!("{v:.1e}");
    text.replace(".0e", "e")
}
