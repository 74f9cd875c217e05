//! The command as a whole: files, page, and what a broken bound does.

use super::command::verdict;
use super::*;
use plot::{Axis, Series, Style};

fn options(out: &std::path::Path) -> Options {
    Options { out: out.into(), page: None, only: vec![], effort: Effort::Quick }
}

fn outcome(ours: f64) -> Outcome {
    let mut table = Table::new(["x", "textbook", "ours"]);
    table.push([1.0, 1.0, ours].map(Into::into));
    let chart = Chart {
        title: "A row".into(),
        x: Axis::linear("x", ""),
        y: Axis::linear("error", ""),
        series: vec![Series::new("ours", Style::Line, [(1.0, ours)])],
        ..Chart::default()
    };
    Outcome { chart, table, figure: "error", textbook: 1.0, ours, bound: 0.5 }
}

const ROW: Row =
    Row { id: "a-row", title: "A row", fails: "It fails.", instead: "It does not.", measure: |_| outcome(0.25) };

#[test]
fn a_broken_bound_is_exit_code_1() {
    let folder = tempfile::tempdir().unwrap();
    let kept = run(&[ROW], &options(folder.path())).unwrap();
    assert!(verdict(&kept).is_ok() && kept.broken().count() == 0);
    for ours in [0.75, f64::NAN, f64::INFINITY] {
        let broken = match ours {
            0.75 => Row { measure: |_| outcome(0.75), ..ROW },
            f64::INFINITY => Row { measure: |_| outcome(f64::INFINITY), ..ROW },
            _ => Row { measure: |_| outcome(f64::NAN), ..ROW },
        };
        let report = run(&[ROW, broken], &options(folder.path())).unwrap();
        assert_eq!(report.broken().count(), 1, "{ours}");
        let error = verdict(&report).unwrap_err();
        assert_eq!((error.exit_code(), error.to_string().as_str()), (1, "bounds do not hold: a-row"));
        assert!(report.text().contains("BROKEN"));
        assert_eq!(report.json()["rows"][1]["holds"], false);
        let page = std::fs::read_to_string(folder.path().join("README.md")).unwrap();
        assert!(page.contains("**broken**"));
    }
}

#[test]
fn a_quick_run_keeps_every_bound_and_writes_every_file() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("stability.md");
    let charts = folder.path().join("stability");
    let report = run(ROWS, &Options { page: Some(page.clone()), ..options(&charts) }).unwrap();
    assert!(verdict(&report).is_ok(), "{}", report.text());
    let page = std::fs::read_to_string(page).unwrap();
    for (row, outcome) in &report.rows {
        assert!(outcome.textbook > outcome.bound, "{}: the textbook form does not fail\n{}", row.id, report.text());
        assert!(page.contains(&format!("(stability/{}.svg)", row.id)), "{}", row.id);
        let csv = std::fs::read_to_string(charts.join(format!("{}.csv", row.id))).unwrap();
        let mut lines = csv.lines();
        let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
        assert_eq!(columns, outcome.table.columns());
        assert!(columns.iter().any(|c| c.contains("ours") || *c == "rule"), "{}: {columns:?}", row.id);
        assert!(lines.clone().count() >= 3, "{}", row.id);
        assert!(lines.all(|line| line.split(',').count() == columns.len()), "{}", row.id);
        assert!(std::fs::read(charts.join(format!("{}.png", row.id))).unwrap().starts_with(b"\x89PNG"));
        assert!(!outcome.chart.x.label.is_empty() && !outcome.chart.y.label.is_empty(), "{}", row.id);
    }
}

#[test]
fn every_row_of_the_contract_is_there_once() {
    let expected = [
        "triangle-leaks",
        "slab-nan",
        "bvh-build",
        "ray-offset",
        "ray-offset-gap",
        "spherical-triangle",
        "spherical-rectangle",
        "sphere-cone",
        "schlick-angle",
        "schlick-index",
        "schlick-metals",
        "ggx",
        "mis-weights",
        "roulette",
        "roulette-glass",
        "light-choice",
        "variance",
        "stopping",
        "sums",
    ];
    let ids: Vec<&str> = ROWS.iter().map(|row| row.id).collect();
    assert_eq!(ids, expected);
}

#[test]
fn only_takes_an_id_or_its_first_words() {
    let ids = |only: &str| choose(ROWS, &[only.to_string()]).map(|rows| rows.iter().map(|r| r.id).collect::<Vec<_>>());
    assert_eq!(ids("variance").unwrap(), ["variance"]);
    assert!(ids("schlick").unwrap().len() >= 2);
    let error = ids("variants").unwrap_err();
    assert_eq!(error.exit_code(), 2);
    let error = error.to_string();
    assert!(error.contains("variants") && error.contains("sums"), "{error}");
}

#[test]
fn the_page_finds_its_charts() {
    let way = |page: &str, folder: &str| page::way(page.as_ref(), folder.as_ref());
    assert_eq!(way("docs/stability.md", "docs/stability"), "stability/");
    assert_eq!(way("out/README.md", "out"), "");
    assert_eq!(way("a/b/page.md", "./a/c"), "../c/");
}

#[test]
fn figures_read_well() {
    for (v, text) in [
        (0.0, "0"),
        (0.0297, "0.0297"),
        (3.5, "3.5"),
        (1234.0, "1234"),
        (1e-4, "1e-4"),
        (2.34e-7, "2.3e-7"),
        (0.96, "0.96"),
        (f64::INFINITY, "infinite"),
    ] {
        assert_eq!(page::figure(v), text);
    }
}
