//! What each module must not know of, checked in its source.

use std::path::{Path, PathBuf};

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|end| end == "rs") {
            found.push(path);
        }
    }
    found
}

/// Source lines that are neither comments nor part of a test module at the end of a file.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

#[track_caller]
fn knows_nothing_of(folder: &str, words: &[&str]) {
    let files = sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(folder));
    assert!(!files.is_empty(), "{folder} has no sources");
    for file in files {
        let code = code(&file);
        for word in words {
            assert!(!code.contains(word), "{} knows of {word}", file.display());
        }
    }
}

#[test]
fn pure_modules_know_of_no_runtime_clock_or_disk() {
    let outside = [
        "tokio",
        "async ",
        "Instant",
        "SystemTime",
        "std::time",
        "std::fs",
        "std::net",
        "std::thread",
        "Mutex",
        "axum",
        "sqlx",
        "object_store",
        "HashMap",
    ];
    for folder in ["farm", "plan", "assemble"] {
        knows_nothing_of(folder, &outside);
    }
}

#[test]
fn the_farm_knows_of_no_pixels_stores_or_routes() {
    knows_nothing_of("farm", &["common::film", "crate::store", "crate::http", "crate::service", "crate::plan"]);
    knows_nothing_of("plan", &["crate::"]);
    knows_nothing_of("assemble", &["crate::farm", "crate::store", "crate::service", "crate::http"]);
    knows_nothing_of("store", &["crate::service", "crate::http", "axum"]);
    knows_nothing_of("service", &["axum"]);
}

#[test]
fn the_coordinator_knows_of_no_tracer_or_mesh_formats() {
    knows_nothing_of("", &["tracer::", "tobj", "gltf", "rayon", "import::"]);
    let manifest = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap();
    for name in ["tracer", "import", "worker", "rayon", "tobj"] {
        assert!(!manifest.lines().any(|line| line.starts_with(name)), "the manifest names {name}");
    }
}
