//! `--json` on every command: what comes out is one JSON document that holds what the command is about, and the exit code
//! is that of the same command without it.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::processes::{Coordinator, tessera};

const SCENE: &str = include_str!("../../data/small.json");

/// Commands in this order, each with its options, its exit code, and what its answer holds (JSON pointer). Where `FARM`
/// stands, it is told the coordinator.
const TABLE: &[(&str, &str, i32, &str)] = &[
    ("render", "good.json -o out --samples 8", 0, "/target_met"),
    ("render", "absent.json -o out", 2, ""),
    ("submit", "good.json --samples 64 --watch -o farm FARM", 0, "/target_met"),
    ("submit", "good.json --samples 4 FARM", 0, "/id"),
    ("jobs", "FARM", 0, "/jobs/0/id"),
    ("job", "j1 FARM", 0, "/statistics/cpu_seconds"),
    ("job", "j99 FARM", 2, ""),
    ("continue", "j1 --samples 256 FARM", 0, "/quality/samples"),
    ("submit", "good.json --samples 1000000 FARM", 0, "/id"),
    ("pause", "j3 FARM", 0, "/status"),
    ("resume", "j3 FARM", 0, "/status"),
    ("cancel", "j3 FARM", 0, "/status"),
    ("workers", "FARM", 0, "/workers/0/threads"),
    ("plan", "good.json", 0, "/chosen"),
    ("scene check", "good.json", 0, "/resolution/1"),
    ("scene check", "bad.json", 2, ""),
    ("scene convert", "tri.obj tri.json", 0, "/notes/0"),
    ("chart", "good.json -o chart --methods light --budgets 1,2 --reference-samples 8 --cache cache", 0, "/methods"),
    ("compare", "out/frame-0001.exr farm/frame-0001.exr", 0, "/rmse"),
    ("compare", "out/frame-0001.exr absent.exr", 2, ""),
    ("stability", "--only triangle-leaks --quick -o stability", 0, "/rows/0/holds"),
    ("soak", "--samples 100 --scenes good.json --only good", 0, "/samples"),
    ("coverage", "--only batches --trials 20 --quick --scenes SCENES -o coverage", 0, "/bounds"),
    ("bench render", "good.json --runs 1 --samples 1", 0, "/median/rays"),
    ("bench rays", "good.json --runs 1", 0, "/rays/0/mrays"),
    ("bench auto", "good.json --seeds 3 --samples 16 --cache cache", 0, "/0/ratio"),
    ("config", "", 0, ""),
];
/// What runs until it is ended, is no result, or is JSON in any case.
const WITHOUT: &[&str] = &["coordinator", "worker", "completions", "scene schema"];

#[tokio::test]
async fn every_command_prints_json_where_it_is_asked_to() {
    let named: BTreeSet<String> = cli::reference::names().into_iter().collect();
    let covered: BTreeSet<String> =
        TABLE.iter().map(|row| row.0).chain(WITHOUT.iter().copied()).map(str::to_owned).collect();
    assert_eq!(named, covered, "every command is in the table, or in the list of those without");

    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("good.json", SCENE.to_owned()),
        ("bad.json", SCENE.replace("film", "flim")),
        ("tri.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into()),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let farm = Coordinator::start(&folder.path().join("data")).await;
    let _worker = farm.worker("json");
    farm.named("json").await;
    let scenes = crate::processes::repository("scenes").canonicalize().unwrap();
    for (words, options, code, holds) in TABLE {
        let told = format!("--coordinator {}", farm.url);
        let options = options.replace("FARM", &told).replace("SCENES", scenes.to_str().unwrap());
        let line = format!("{words} {options} --json");
        let arguments: Vec<&str> = line.split_whitespace().collect();
        let output = tessera(&arguments).current_dir(folder.path()).output().unwrap();
        let (text, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert_eq!(output.status.code(), Some(*code), "{line}: {said}");
        assert!(!said.contains('\u{1b}') && !text.contains('\u{1b}'), "{line}: no colours where there is no terminal");
        if *code == 0 {
            let value: Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{line}: {error}: {text}"));
            assert!(value.pointer(holds).is_some(), "{line}: nothing at {holds:?} in {value:#}");
        } else {
            assert_eq!(text, "", "{line}: an error is not a result");
            assert_eq!(said.trim_end().lines().count(), 1, "{line}: one sentence: {said}");
            assert!(said.starts_with("error: "), "{line}: {said}");
        }
    }
}
