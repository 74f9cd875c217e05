//! What can be held of the container files without a container engine: that they are well-formed, fit each
//! other and the workspace, and keep their promises about tokens, health and scaling.

use std::path::{Path, PathBuf};

use serde_json::Value;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn compose() -> Value {
    serde_saphyr::from_str(&read("docker-compose.yml")).unwrap()
}

fn words(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect()
}

/// Instructions of the Dockerfile: continuation lines joined, comments left out.
fn instructions() -> Vec<(String, String)> {
    let text = read("Dockerfile").replace("\\\n", " ");
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines
        .map(|line| line.split_once(' ').map(|(word, rest)| (word.to_owned(), rest.trim().to_owned())).unwrap())
        .collect()
}

#[test]
fn the_coordinator_listens_beyond_loopback_with_a_required_token_and_keeps_its_data() {
    let compose = compose();
    let coordinator = &compose["services"]["coordinator"];
    let command = words(&coordinator["command"]);
    assert_eq!(command, ["coordinator", "--listen", "0.0.0.0:7878", "--data", "/data"]);
    let token = coordinator["environment"]["TESSERA_TOKEN"].as_str().unwrap();
    assert!(token.starts_with("${TESSERA_TOKEN:?"), "compose refuses to start without a token: {token}");
    let volume = words(&coordinator["volumes"])[0].split_once(':').unwrap();
    assert_eq!(volume.1, "/data");
    assert!(compose["volumes"].as_object().unwrap().contains_key(volume.0), "{} is a named volume", volume.0);
    assert!(words(&coordinator["healthcheck"]["test"]).iter().any(|word| word.ends_with(":7878/readyz")));
}

#[test]
fn workers_can_be_scaled_and_wait_for_a_healthy_coordinator() {
    let compose = compose();
    let worker = &compose["services"]["worker"];
    assert_eq!(words(&worker["command"]), ["worker", "--coordinator", "http://coordinator:7878"]);
    assert_eq!(
        worker["environment"]["TESSERA_TOKEN"],
        compose["services"]["coordinator"]["environment"]["TESSERA_TOKEN"]
    );
    assert_eq!(worker["depends_on"]["coordinator"]["condition"], "service_healthy");
    assert!(!words(&worker["healthcheck"]["test"]).is_empty());
    for field in ["container_name", "ports", "hostname"] {
        assert!(worker.get(field).is_none(), "`{field}` belongs to one container: `--scale worker=N` would fail");
    }
    assert_eq!(worker["image"], compose["services"]["coordinator"]["image"]);
}

#[test]
fn the_image_builds_what_the_lock_file_says_and_does_not_run_as_root() {
    let all = instructions();
    let of = |word: &str| all.iter().filter(|(w, _)| w == word).map(|(_, rest)| rest.as_str()).collect::<Vec<_>>();
    assert!(of("RUN").iter().any(|run| run.contains("cargo build --locked --release -p tessera-cli")));
    let stages = of("FROM");
    assert_eq!(stages.len(), 2);
    let toolchain = stages[0].strip_prefix("rust:").unwrap().split('-').next().unwrap();
    let wanted =
        read("Cargo.toml").lines().find_map(|line| Some(line.strip_prefix("rust-version = ")?.replace('"', "")));
    let number = |version: &str| -> Vec<u32> { version.split('.').map(|part| part.parse().unwrap()).collect() };
    assert!(number(toolchain) >= number(&wanted.unwrap()), "rust {toolchain} is older than rust-version");
    assert!(!matches!(of("USER")[..], [] | ["root"] | ["0"]));
    assert_eq!(of("HEALTHCHECK").len(), 1);
    assert_eq!(of("ENTRYPOINT"), [r#"["tessera"]"#]);
    let command: Value = serde_json::from_str(of("CMD")[0]).unwrap();
    assert_eq!(command, compose()["services"]["coordinator"]["command"]);
    for copy in of("COPY").into_iter().filter(|copy| !copy.starts_with("--from")) {
        let source = copy.split_whitespace().next().unwrap();
        assert!(root().join(source).exists(), "COPY {copy}");
    }
}
