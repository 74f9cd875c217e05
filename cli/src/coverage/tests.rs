//! The command as a whole: files, page, and what a broken bound does.

use super::command::verdict;
use super::*;

fn options(out: &Path) -> Options {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes");
    Options { out: out.into(), page: None, only: vec![], effort: Effort { trials: 25, quick: true, scenes } }
}

fn section(found: f64) -> Section {
    let bound = Bound { what: "a share".into(), found, low: 0.9, high: 1.0, goal: Some((0.94, 0.97)) };
    let mut grid = Grid::new("a-table", "It shows.", &["what", "share"]);
    grid.rows.push(vec!["one".into(), Value::Number(found, 2)]);
    Section { title: "A part", text: "Words.".into(), grids: vec![grid], bounds: vec![bound], ..Section::default() }
}

#[test]
fn a_broken_bound_fails_and_a_missed_goal_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let parts: [(Part, bool, bool); 4] = [
        (Part { id: "good", measure: |_| Ok(section(0.95)) }, true, true),
        (Part { id: "missed", measure: |_| Ok(section(0.92)) }, true, false),
        (Part { id: "broken", measure: |_| Ok(section(0.5)) }, false, false),
        (Part { id: "no-number", measure: |_| Ok(section(f64::NAN)) }, false, false),
    ];
    for (part, holds, reached) in parts {
        let sections = run(&[part], &options(folder.path())).unwrap();
        assert_eq!(verdict(&sections).is_ok(), holds, "{}", part.id);
        let page = std::fs::read_to_string(folder.path().join("README.md")).unwrap();
        assert_eq!(page.contains("**broken**"), !holds, "{}", part.id);
        assert_eq!(page.contains("(missed)"), !reached, "{}", part.id);
        assert!(page.contains("## A part") && page.contains("[CSV](a-table.csv)"), "{page}");
        assert!(std::fs::read_to_string(folder.path().join("a-table.csv")).unwrap().starts_with("what,share\none,"));
    }
}

#[test]
fn only_takes_the_name_of_a_part() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = Options { only: vec!["simulate".into()], ..options(folder.path()) };
    let Err(Failure::Input(message)) = run(PARTS, &wrong) else { panic!("there is no such part") };
    assert!(message.contains("--only simulate") && message.contains("simulated"), "{message}");
}

#[test]
fn a_small_run_of_the_simulation_keeps_its_bounds_and_writes_every_file() {
    let folder = tempfile::tempdir().unwrap();
    let charts = folder.path().join("accuracy");
    let page = folder.path().join("accuracy.md");
    let only = vec!["simulated".to_owned()];
    let sections = run(PARTS, &Options { page: Some(page.clone()), only, ..options(&charts) }).unwrap();
    assert!(verdict(&sections).is_ok(), "{}", page::bounds(&sections));
    let page = std::fs::read_to_string(page).unwrap();
    let [section] = sections.as_slice() else { panic!("one part") };
    for figure in &section.figures {
        assert!(page.contains(&format!("(accuracy/{}.svg)", figure.id)), "{}", figure.id);
        assert!(std::fs::read(charts.join(format!("{}.png", figure.id))).unwrap().starts_with(b"\x89PNG"));
    }
    for grid in &section.grids {
        let csv = std::fs::read_to_string(charts.join(format!("{}.csv", grid.id))).unwrap();
        assert_eq!(csv.lines().count(), grid.rows.len() + 1);
    }
}

#[test]
fn a_small_run_on_rendered_pixels_keeps_its_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let only = ["rendered", "bias"].map(str::to_owned).to_vec();
    let sections = run(PARTS, &Options { only, ..options(folder.path()) }).unwrap();
    assert!(verdict(&sections).is_ok(), "{}", page::bounds(&sections));
    // Coverage of all pixels, of the worst decile, and the pooled mean of repeated renders.
    assert_eq!(sections.iter().map(|section| section.bounds.len()).collect::<Vec<_>>(), [2, 1]);
}
