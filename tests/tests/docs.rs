//! What the documents say: pages that are made from the program are as it makes them, links lead somewhere, and
//! the scenes and settings that are printed as examples are read.

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// Every Markdown file of the project.
fn pages() -> Vec<PathBuf> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_string();
            if path.is_dir() {
                if name != "target" && !name.starts_with('.') && name != "node_modules" {
                    walk(&path, found);
                }
            } else if name.ends_with(".md") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(&root(), &mut found);
    found.sort();
    found
}

/// The text without code, where brackets mean something else.
fn prose(text: &str) -> String {
    let mut fenced = false;
    let lines = text.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence && !line.starts_with("    ")
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Targets of `[text](target)` and `![text](target)`.
fn links(text: &str) -> Vec<String> {
    let parts = text.split("](").skip(1);
    parts.filter_map(|part| part.split_once(')')).map(|(target, _)| target.trim().to_string()).collect()
}

/// The name under which a heading is linked to.
fn anchor(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[test]
fn every_link_leads_somewhere() {
    let (mut seen, mut broken) = (0, Vec::new());
    for page in pages() {
        let text = prose(&std::fs::read_to_string(&page).unwrap());
        for target in links(&text) {
            // Other hosts are not asked.
            if target.starts_with("http://") || target.starts_with("https://") {
                continue;
            }
            seen += 1;
            let (file, section) = target.split_once('#').unwrap_or((&target, ""));
            let file = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let found = file.exists()
                && (section.is_empty()
                    || std::fs::read_to_string(&file).is_ok_and(|text| {
                        text.contains(&format!("id=\"{section}\""))
                            || text.lines().any(|line| line.starts_with('#') && anchor(line) == section)
                    }));
            if !found {
                broken.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(seen > 30, "there are links: {seen}");
    assert!(broken.is_empty(), "links that lead nowhere:\n{}", broken.join("\n"));
}

#[test]
fn pages_made_from_the_program_are_as_it_makes_them() {
    for (path, text) in [
        ("docs/reference/cli.md", cli::reference::commands()),
        ("docs/reference/scene.md", cli::reference::scene()),
        ("docs/reference/api.md", cli::reference::api()),
        ("docs/openapi.json", format!("{:#}\n", coordinator::http::openapi())),
    ] {
        let path = root().join(path);
        if std::env::var_os("UPDATE_DOCS").is_some() {
            std::fs::write(&path, &text).unwrap();
        }
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        let line = found.lines().zip(text.lines()).position(|(a, b)| a != b);
        assert!(
            found == text,
            "{}: line {:?} is not what the program says; write it again by UPDATE_DOCS=1 cargo test --release -p tessera-tests --test docs",
            path.display(),
            line.map(|line| line + 1)
        );
    }
}

#[test]
fn scenes_printed_in_the_documents_are_read() {
    let mut seen = 0;
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        for block in text.split("```json\n").skip(1) {
            let block = block.split("```").next().unwrap();
            if block.contains("\"tessera\": 1") {
                seen += 1;
                let read = common::scene::SceneFile::parse(block.as_bytes());
                assert!(read.is_ok(), "{}: {}", page.display(), read.unwrap_err());
            }
        }
    }
    assert!(seen >= 2, "there are scenes in the documents: {seen}");
}

#[test]
fn commands_printed_in_the_documents_parse() {
    let mut seen = 0;
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        let mut joined = String::new();
        for line in text.lines().filter_map(|line| line.strip_prefix("    ")) {
            let line = line.trim_start_matches("$ ");
            joined = if joined.is_empty() { line.to_string() } else { format!("{joined} {}", line.trim_start()) };
            if let Some(open) = joined.strip_suffix('\\') {
                joined = open.trim_end().to_string();
                continue;
            }
            let line = std::mem::take(&mut joined);
            let command = line.strip_prefix("cargo run --release -- ").or_else(|| line.strip_prefix("tessera "));
            let Some(command) = command else { continue };
            let words: Vec<&str> = command.split(" #").next().unwrap().split_whitespace().collect();
            // Pipes and placeholders are for people.
            if words.iter().any(|word| ["|", "&&", "&", ">"].contains(word) || word.contains('$')) {
                continue;
            }
            seen += 1;
            let parsed = cli::parses(&words);
            assert!(parsed.is_ok(), "{}: {line}: {}", page.display(), parsed.unwrap_err());
        }
    }
    assert!(seen > 40, "there are commands in the documents: {seen}");
}
