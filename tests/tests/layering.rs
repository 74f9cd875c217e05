//! The rules that ARCHITECTURE.md states as absences, held against the source text. Which crate may depend on
//! which, .ci/run proves by `cargo tree`; here are the rules within crates, and that documents stay true.

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// Files below a folder with an extension, by their path from the root, with their text.
fn files(folder: &str, extension: &str) -> Vec<(String, String)> {
    fn walk(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, extension, found);
            } else if path.extension().is_some_and(|e| e == extension) {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), extension, &mut found);
    found.sort();
    let name = |path: &Path| path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/");
    found.iter().map(|path| (name(path), std::fs::read_to_string(path).unwrap())).collect()
}

/// The program of a source file: without comments and without its unit tests, which come last.
fn program(text: &str) -> String {
    let text = text.split("\n#[cfg(test)]").next().unwrap();
    text.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

/// Whether a file holds tests alone.
fn is_test(path: &str) -> bool {
    path.split('/').any(|part| matches!(part, "tests" | "tests.rs" | "testing"))
}

/// No program text below `folder` holds any of `words`.
fn absent(folder: &str, words: &[&str]) {
    let all = files(folder, "rs");
    assert!(!all.is_empty(), "{folder} holds sources");
    for (path, text) in all.into_iter().filter(|(path, _)| !is_test(path)) {
        let program = program(&text);
        for word in words {
            let line = program.lines().position(|line| line.contains(word));
            assert!(line.is_none(), "{path}:{}: `{word}` has no place in {folder}", line.unwrap_or(0) + 1);
        }
    }
}

const CLOCKS: [&str; 3] = ["Instant", "SystemTime", "std::time"];
const FILES_AND_SOCKETS: [&str; 4] = ["std::fs", "std::net", "std::process", "std::env::"];

#[test]
fn pure_crates_see_no_clock_file_or_socket() {
    for folder in ["common/src", "import/src", "tracer/src", "plot/src"] {
        absent(folder, &CLOCKS);
        absent(folder, &FILES_AND_SOCKETS);
    }
}

#[test]
fn the_scheduler_decides_from_its_state_and_the_time_it_is_given() {
    absent("coordinator/src/farm", &["tokio", "axum", "sqlx", "object_store", "async ", "Instant", "SystemTime"]);
    absent("coordinator/src/farm", &FILES_AND_SOCKETS);
}

/// Functions of the standard library whose bits differ between platforms.
#[test]
fn pixels_are_made_without_the_platforms_mathematics() {
    let methods = [
        "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sin_cos", "exp", "exp2", "ln", "log2", "powf", "cbrt",
        "mul_add",
    ];
    let called: Vec<String> = methods
        .iter()
        .flat_map(|name| [format!(".{name}("), format!("f32::{name}("), format!("f64::{name}(")])
        .collect();
    absent("tracer/src", &called.iter().map(String::as_str).collect::<Vec<_>>());
    absent("tracer/src", &["Vec3A", "Vec4", "Mat4", "Affine3A", "_mm256_fmadd", "_mm_fmadd"]);
}

#[test]
fn unsafe_code_is_where_the_simd_kernels_are() {
    for folder in ["common", "import", "worker", "coordinator", "cli", "plot"] {
        absent(&format!("{folder}/src"), &["unsafe "]);
    }
}

#[test]
fn every_source_file_says_what_it_is() {
    for folder in ["common", "import", "tracer", "worker", "coordinator", "cli", "plot", "tests"] {
        for (path, text) in files(&format!("{folder}/src"), "rs").into_iter().filter(|(path, _)| !is_test(path)) {
            let first = text.lines().next().unwrap_or_default();
            assert!(first.starts_with("//! ") && first.len() > 12, "{path} opens with a line on what it is");
        }
    }
}

/// Words in `backticks` that look like paths of this repository, and targets of links.
fn paths(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for quoted in text.split('`').skip(1).step_by(2) {
        let top = quoted.split('/').next().unwrap_or_default();
        let ours =
            ["common", "import", "tracer", "worker", "coordinator", "cli", "plot", "tests", "scenes", "docs", ".ci"];
        if quoted.contains('/') && ours.contains(&top) && !quoted.contains([' ', '*', '{', '<']) {
            found.push(quoted.to_owned());
        }
    }
    for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
        if !target.contains("://") && !target.starts_with('#') {
            found.push(target.to_owned());
        }
    }
    found
}

#[test]
fn documents_name_only_files_that_exist() {
    for document in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"] {
        let text = std::fs::read_to_string(root().join(document)).unwrap();
        for path in paths(&text) {
            assert!(root().join(&path).exists(), "{document} names {path}");
        }
    }
}

#[test]
fn the_architecture_describes_every_crate_and_every_folder_of_sources() {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    for member in ["common", "import", "tracer", "worker", "coordinator", "cli", "plot", "tests"] {
        let source = root().join(member).join("src");
        let folders = std::fs::read_dir(&source).unwrap().map(|entry| entry.unwrap().path());
        let folders = folders
            .filter(|path| path.is_dir() && !path.ends_with("bin") && std::fs::read_dir(path).unwrap().count() > 0);
        let inner = folders.map(|path| path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned());
        for folder in inner.chain([member.to_owned()]) {
            assert!(text.contains(&format!("`{folder}`")), "ARCHITECTURE.md says nothing of `{folder}`");
        }
    }
}
