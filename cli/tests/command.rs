//! The command as people run it: what it writes, and how it refuses.

use std::{
    net::TcpListener,
    path::Path,
    process::{Command, Output},
};

use serde_json::Value;

fn tessera(folder: &Path, line: &str) -> Output {
    with(folder, line, &[])
}

/// The same with variables set.
fn with(folder: &Path, line: &str, variables: &[(&str, &str)]) -> Output {
    command(folder, line, variables).output().unwrap()
}

fn command(folder: &Path, line: &str, variables: &[(&str, &str)]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tessera"));
    for (variable, _) in std::env::vars().filter(|(name, _)| name.starts_with("TESSERA_") || name == "RUST_LOG") {
        command.env_remove(variable);
    }
    // Nothing comes from the user's own settings.
    command.env("XDG_CONFIG_HOME", folder).envs(variables.iter().copied());
    command.args(line.split_whitespace()).current_dir(folder);
    command
}

const SCENE: &str = include_str!("../../tests/data/small.json");

/// A folder with a sound scene and several that are not.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mesh = r#""shapes": [{"type": "sphere"}, {"type": "mesh", "file": "meshes/x.obj"}"#;
    for (name, text) in [
        ("good.json", SCENE.to_string()),
        ("unknown.json", SCENE.replace("\"film\"", "\"flim\"")),
        ("mesh.json", SCENE.replace("\"shapes\": [", &format!("{mesh},"))),
        ("type.json", SCENE.replace("[0, 1, 5]", "\"here\"")),
        ("huge.json", SCENE.replace("\"width\": 24", "\"width\": 1000000")),
        ("cut.json", SCENE[..SCENE.len() / 2].to_string()),
        ("bad.obj", "v 0 0 0\nf 1 2 3\n".into()),
        ("tri.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into()),
        ("file", String::new()),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

#[test]
fn every_mistake_has_its_sentence_and_exit_code() {
    let folder = folder();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap();
    // Nobody listens where somebody has just stopped listening.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    for (line, code, expected) in [
        ("render absent.json -o out", 2, "absent.json: no such file"),
        ("render unknown.json -o out", 2, "unknown.json: flim: unknown field `flim`"),
        ("render mesh.json -o out", 2, "mesh.json: shapes[1].file: meshes/x.obj: no such file"),
        ("render type.json -o out", 2, "type.json: camera.position: invalid type: string \"here\""),
        ("render huge.json -o out", 2, "huge.json: film: 1000000x16 is not within 1x1 to 16384x16384"),
        ("render cut.json -o out", 2, "cut.json: not valid JSON"),
        ("render bad.obj -o out", 2, "bad.obj: "),
        ("render good.json -o out --resolution 99999x99999", 2, "99999x99999 is not within"),
        ("render good.json -o out --crop 20,0,8,8", 2, "--crop: 8x8 at 20,0 is not inside the 24x16 frame"),
        ("render good.json -o out --samples 4 --adaptive on", 2, "--adaptive: "),
        ("render good.json -o out --direct fast", 2, "'fast' for '--direct <HOW>'"),
        ("render good.json -o file", 2, "file: cannot be written to: is a file, not a folder"),
        ("render good.json -o nowhere/a.png", 2, "nowhere: cannot be written to: no such folder"),
        ("render good.json -o a.jpg", 2, "a.jpg: .jpg images are not written"),
        ("render good.json -o a.png --frames 1-2", 2, "a.png: 1-2 are several frames"),
        ("render good.json", 2, "--output <OUT>"),
        ("render --resume . -o out", 2, "--resume .: no render was kept there"),
        ("render --resume . -o out --samples 4", 2, "--resume goes on with what was asked for before"),
        ("jobs --config absent.toml", 2, "absent.toml: no such file"),
        ("submit good.json --coordinator http://FREE", 1, "http://FREE cannot be reached: connection refused"),
        ("jobs --coordinator http://FREE", 1, "http://FREE cannot be reached: connection refused"),
        ("jobs --coordinator https://FREE", 2, "https is not supported yet"),
        ("jobs --coordinator FREE", 2, "is not a coordinator's address such as http://"),
        ("worker --coordinator FREE", 2, "is not a coordinator's address such as http://"),
        ("coordinator --listen TAKEN --data data", 1, "--listen TAKEN: the address is already in use"),
        ("coordinator --listen 0.0.0.0:0 --data data", 2, "give a token by --token-file or TESSERA_TOKEN"),
        ("coordinator --listen 127.0.0.1:0 --data data --token-file absent", 2, "absent: no such file"),
        ("coordinator --listen 127.0.0.1:0 --data file", 2, "file: cannot be written to: is a file, not a folder"),
        ("render good.json -o out --data file", 2, "file: cannot be written to: is a file, not a folder"),
        ("scene check mesh.json", 2, "shapes[1].file"),
        ("chart good.json -o c --methods fast", 2, "--methods: \"fast\" is not a method; expected values such as auto"),
        ("chart good.json -o c --methods mis,mis", 2, "--methods: mis is named twice"),
        ("chart good.json -o c --samples 4", 2, "--samples: chart takes --budgets"),
        ("chart good.json -o c --frames 1-2", 2, "--frames: chart takes one frame"),
        ("chart good.json -o c --budgets 16 --methods on", 2, "--budgets: on needs 64 samples per pixel or more"),
        ("chart good.json -o c --budgets 4,x", 2, "'x' for '--budgets <LIST>'"),
        ("chart good.json -o c --reference absent.exr", 2, "absent.exr: no such file"),
        (
            "chart good.json -o c --reference absent.exr --methods direct,mis",
            2,
            "--reference: methods that differ in only",
        ),
        ("chart good.json -o file", 2, "file: cannot be written to: is a file, not a folder"),
        ("compare absent.exr file", 2, "absent.exr: no such file"),
        ("compare good.json file", 2, "good.json: neither an EXR nor a PNG"),
        ("compare file file -o diff.jpg", 2, "--output diff.jpg: expected a name that ends in .png"),
        ("job 17 --coordinator http://FREE", 2, "\"17\" is not of the form jNUMBER"),
        ("scene check good.json --log =", 2, "--log"),
        ("plan mesh.json", 2, "shapes[1].file"),
        ("bench render mesh.json", 2, "shapes[1].file"),
        ("bench render good.json --noise 0.1", 2, "bench render: the target is --samples alone"),
        ("bench render good.json --crop 0,0,8,8", 2, "--crop"),
    ] {
        let fill = |text: &str| text.replace("FREE", &free.to_string()).replace("TAKEN", &taken.to_string());
        let (line, expected) = (fill(line), fill(expected));
        let output = tessera(folder.path(), &line);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        assert!(said.starts_with("error: ") && said.contains(&expected), "{line}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{line}: one sentence: {said}");
    }
    assert!(!folder.path().join("out/report.json").exists());
}

#[test]
fn a_render_writes_its_files_and_its_report() {
    let folder = folder();
    let output = tessera(folder.path(), "render good.json -o out --samples 16 --tile 8 --json --threads 2");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("dashboard http://127.0.0.1:"), "{said}");
    assert!(said.contains("samples (16.0 a pixel, 16 at most) in "), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let written: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("out/report.json")).unwrap()).unwrap();
    assert_eq!(report, written);
    assert_eq!(report["scene"], "good.json");
    assert_eq!(report["resolution"], serde_json::json!([24, 16]));
    assert_eq!(report["samples"], serde_json::json!({"total": 24 * 16 * 16, "mean": 16.0, "max": 16}));
    assert_eq!((&report["target_met"], &report["workers"]), (&Value::Bool(true), &Value::from(1)));
    for number in ["/rays", "/cpu_seconds", "/seconds/load", "/seconds/build", "/seconds/render", "/seconds/wall"] {
        assert!(report.pointer(number).and_then(Value::as_f64).is_some_and(|n| n > 0.0), "{number}: {report}");
    }
    assert!(report["tests_per_ray"]["nodes"].is_number() && report["tests_per_ray"]["triangles"].is_number());
    assert!(report.get("attempts").is_some() && report.get("error").is_some());

    let begins = |name: &str, magic: &[u8]| {
        let bytes = std::fs::read(folder.path().join("out").join(name)).unwrap();
        assert!(bytes.starts_with(magic) && bytes.len() > 64, "{name}");
    };
    let (png, exr) = (&b"\x89PNG\r\n\x1a\n"[..], &[0x76, 0x2f, 0x31, 0x01][..]);
    begins("frame-0001.png", png);
    begins("frame-0001.exr", exr);
    begins("frame-0001.samples.png", png);
    begins("frame-0001.error.png", png);
    let names = std::fs::read_dir(folder.path().join("out")).unwrap().count();
    assert_eq!(names, 5, "four images and the report, nothing half written");
}

#[test]
fn a_bare_mesh_renders_into_one_file_and_what_was_made_up_is_said() {
    let folder = folder();
    let output = tessera(folder.path(), "render tri.obj -o a.png --samples 4 --resolution 16x16");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("note: Made from tri.obj") && said.contains("camera") && said.contains("light"), "{said}");
    assert!(folder.path().join("a.png").is_file());
    assert!(output.stdout.is_empty());
}

#[test]
fn scenes_are_checked_converted_and_described() {
    let folder = folder();
    let check = tessera(folder.path(), "scene check good.json");
    assert_eq!(
        String::from_utf8(check.stdout).unwrap(),
        "good.json: sound: 2 shapes, 0 materials, 0 files, 24x16 pixels\n"
    );
    assert!(tessera(folder.path(), "scene convert tri.obj tri.json").status.success());
    let check = tessera(folder.path(), "scene check tri.json");
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stderr));
    let elsewhere = tessera(folder.path(), "scene convert tri.obj ../tri.json");
    assert_eq!(elsewhere.status.code(), Some(2));
    let schema: Value = serde_json::from_slice(&tessera(folder.path(), "scene schema").stdout).unwrap();
    assert_eq!(schema["title"], "SceneFile");
}

#[test]
fn one_sample_is_replayed_with_the_radiance_it_has_in_the_image() {
    let folder = folder();
    // One sample a pixel: the image is the samples.
    let options = "--samples 1 --resolution 24x16 --seed 5";
    let rendered = tessera(folder.path(), &format!("render good.json -o a.exr {options}"));
    assert!(rendered.status.success(), "{}", String::from_utf8_lossy(&rendered.stderr));
    let image = exr::prelude::read_first_rgba_layer_from_file(
        folder.path().join("a.exr"),
        |size, _| vec![[0.0f32; 3]; size.area()],
        |pixels, at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.y() * 24 + at.x()] = [r, g, b],
    );
    let pixels = image.unwrap().layer_data.channel_data.pixels;
    let lit = pixels.iter().position(|rgb| rgb[0] > 0.0).expect("some sample found the lamp");
    let replay =
        tessera(folder.path(), &format!("render good.json --pixel {},{} --sample 0 {options}", lit % 24, lit / 24));
    let said = String::from_utf8(replay.stdout).unwrap();
    assert!(replay.status.success(), "{}", String::from_utf8_lossy(&replay.stderr));
    let [r, g, b] = pixels[lit];
    assert!(said.contains(&format!("radiance [{r}, {g}, {b}]")), "{:?} in {said}", pixels[lit]);
    let outside = tessera(folder.path(), "render good.json --pixel 24,0 --sample 0");
    assert_eq!(outside.status.code(), Some(2));
}

#[test]
fn a_bench_counts_what_it_renders_and_writes_the_picture() {
    let folder = folder();
    let line = "bench render good.json --samples 4 --runs 2 --threads 2 --json -o a.pfm";
    let output = tessera(folder.path(), line);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["samples"], &report["width"]), (&Value::from(4), &Value::from(24)));
    assert_eq!(report["runs"].as_array().map(Vec::len), Some(2));
    for run in report["runs"].as_array().unwrap() {
        // A camera ray each, and more where something was hit.
        assert!(run["rays"].as_u64().is_some_and(|rays| rays > 24 * 16 * 4), "{run}");
        let rate = run["msamples_per_cpu_second"].as_f64().unwrap() * run["cpu_seconds"].as_f64().unwrap();
        assert!((rate * 1e6 - f64::from(24 * 16 * 4)).abs() < 0.5, "{run}");
    }
    let picture = std::fs::read(folder.path().join("a.pfm")).unwrap();
    assert!(picture.starts_with(b"PF\n24 16\n-1.0\n"));
    assert_eq!(picture.len(), b"PF\n24 16\n-1.0\n".len() + 24 * 16 * 12);
}

#[test]
fn images_are_compared_by_layer_and_size() {
    let folder = folder();
    let done = |line: &str| {
        let output = tessera(folder.path(), line);
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    for (name, seed) in [("a", 1), ("b", 2)] {
        done(&format!("render good.json -o {name} --samples 16 --seed {seed}"));
    }
    let compared = |line: &str| -> Value { serde_json::from_slice(&done(&format!("compare {line} --json"))).unwrap() };
    let (a, b) = ("a/frame-0001.exr", "b/frame-0001.exr");
    let own = compared(&format!("{a} {a}"));
    for measure in ["rmse", "mae", "relmse", "bias", "flip", "max"] {
        assert_eq!(own[measure], 0.0, "{measure}: {own}");
    }
    let two = compared(&format!("{a} {b} -o diff.png"));
    assert!(two["rmse"].as_f64().unwrap() > 0.0 && two["flip"].as_f64().unwrap() > 0.0, "{two}");
    assert_eq!((&two["reference"], &two["resolution"]), (&Value::from(b), &serde_json::json!([24, 16])));
    let picture = image::open(folder.path().join("diff.png")).unwrap();
    assert!(picture.width() >= 24 && picture.height() > 16, "a legend stands below");
    // The PNG holds what the EXR does, to a byte's steps and clipped at 1.
    let png = compared(&format!("a/frame-0001.png {a}"));
    // Half a step of sRGB is at most 0.0045 of linear light.
    assert!((1e-6..0.0046).contains(&png["max"].as_f64().unwrap()), "{png}");
    let layer = compared(&format!("{a} {b} --layer samples"));
    assert_eq!(
        (&layer["channels"][0], &layer["rmse"], &layer["flip"]),
        (&"samples.Y".into(), &0.0.into(), &Value::Null)
    );
    let text = String::from_utf8(done(&format!("compare {a} {b}"))).unwrap();
    assert!(text.contains("against the reference b/frame-0001.exr: R G B, 24x16") && text.contains("flip"), "{text}");

    done("render good.json -o small.exr --samples 1 --resolution 12x8");
    for (line, expected) in [
        (format!("compare small.exr {a}"), "small.exr is 12x8 pixels and a/frame-0001.exr is 24x16"),
        (
            format!("compare {a} {b} --layer colour"),
            "--layer colour: there is no such layer; its channels are A, B, G, R",
        ),
        (format!("compare a/frame-0001.png {b} --layer depth"), "--layer depth: a PNG has no layers"),
        ("compare cut.exr small.exr".into(), "cut.exr: not a sound EXR"),
        ("compare cut.png small.exr".into(), "cut.png: not a sound PNG"),
    ] {
        for name in ["exr", "png"] {
            let whole = std::fs::read(folder.path().join(format!("a/frame-0001.{name}"))).unwrap();
            std::fs::write(folder.path().join(format!("cut.{name}")), &whole[..whole.len() / 2]).unwrap();
        }
        let output = tessera(folder.path(), &line);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(expected) && said.trim_end().lines().count() == 1, "{line}: {said}");
    }
}

#[test]
fn a_chart_measures_methods_against_a_reference_that_is_kept() {
    let folder = folder();
    let chart = |options: &str| -> Value {
        let line = format!("chart good.json --cache kept -o chart --seeds 3 --budgets 64,16 --json {options}");
        let output = tessera(folder.path(), &line);
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let options = "--methods hemisphere,light+one+area,direct,on --reference-samples 512 --threads 2 --max-depth 3";
    let found = chart(options);
    let at = |pointer: &str| found.pointer(pointer).unwrap_or_else(|| panic!("{pointer} in {found}"));
    let names: Vec<_> = found["methods"].as_array().unwrap().iter().map(|method| &method["name"]).collect();
    assert_eq!(names, ["textbook", "hemisphere", "light+one+area", "direct", "on"]);
    assert_eq!((at("/methods/1/method/direct"), at("/methods/2/method/max_depth")), (&"hemisphere".into(), &3.into()));
    assert_eq!(at("/methods/0/method/roulette"), "fixed");
    // Budgets ascend; ours begins with its pilot.
    assert_eq!((at("/methods/1/budgets/0/budget"), at("/methods/4/budgets/0/budget")), (&16.into(), &64.into()));
    let number = |pointer: &str| at(pointer).as_f64().unwrap_or_else(|| panic!("{pointer} in {found}"));
    for method in 0..5 {
        let last = if method == 4 { 0 } else { 1 };
        let of = |what: &str| number(&format!("/methods/{method}/budgets/{last}/{what}"));
        assert!(of("relmse/low") <= of("relmse/mean") && of("relmse/mean") <= of("relmse/high"), "{found}");
        let product = of("efficiency") * of("relmse/mean") * of("cpu_seconds");
        assert!((product - 1.0).abs() < 1e-9, "{product}");
        // Nothing here is biased: the interval holds 0, or misses it by no more than half its width.
        let [low, high] = ["low", "high"].map(|end| number(&format!("/methods/{method}/bias/{end}")));
        let slack = 0.5 * (high - low);
        assert!(low - slack < 0.0 && high + slack > 0.0, "method {method}: {low} to {high}");
    }
    assert!(number("/methods/1/budgets/1/relmse/mean") > 4.0 * number("/methods/2/budgets/1/relmse/mean"), "{found}");
    // A method that renders direct light alone is held against direct light alone.
    assert_eq!((at("/methods/3/reference"), at("/methods/2/reference")), (&1.into(), &0.into()));
    assert!(number("/references/0/relmse") < number("/methods/2/budgets/1/relmse/mean"));
    assert_eq!((at("/references/1/samples"), at("/references/1/noise_taken_out")), (&1024.into(), &true.into()));

    let text = |name: &str| std::fs::read_to_string(folder.path().join("chart").join(name)).unwrap();
    assert_eq!(text("chart.csv").lines().count(), 1 + 3 * (4 * 2 + 1));
    assert!(text("README.md").contains("| light+one+area |") && text("README.md").contains("(error.svg)"));
    for name in ["error", "bias", "efficiency"] {
        assert!(text(&format!("{name}.svg")).starts_with("<svg"), "{name}");
        assert!(folder.path().join(format!("chart/{name}.png")).is_file(), "{name}");
    }
    assert_eq!(serde_json::from_str::<Value>(&text("chart.json")).unwrap(), found);

    // The halves are kept: a second chart reads them, and may be given them by name.
    let kept = || {
        let entries = std::fs::read_dir(folder.path().join("kept")).unwrap().map(|entry| entry.unwrap());
        let mut files: Vec<_> = entries.map(|e| (e.path(), e.metadata().unwrap().modified().unwrap())).collect();
        files.sort();
        files
    };
    let before = kept();
    assert_eq!(before.len(), 4);
    chart(options);
    assert_eq!(kept(), before);
    let file = |i: usize| found.pointer(&format!("/references/0/files/{i}")).unwrap().as_str().unwrap().to_owned();
    let given = chart(&format!("--methods mis --max-depth 3 --reference {} --reference {}", file(0), file(1)));
    assert_eq!(given["references"][0]["relmse"], found["references"][0]["relmse"]);
    let small = tessera(folder.path(), &format!("chart good.json -o c --resolution 8x8 --reference {}", file(0)));
    let said = String::from_utf8(small.stderr).unwrap();
    assert_eq!(small.status.code(), Some(2));
    assert!(said.contains("is 24x16 pixels, and the chart is of 8x8"), "{said}");
}

#[test]
fn settings_come_from_options_then_variables_then_the_file() {
    let folder = folder();
    let path = folder.path().join("tessera");
    std::fs::create_dir(&path).unwrap();
    std::fs::write(path.join("config.toml"), "coordinator = \"http://127.0.0.1:1\"\nthreads = 3\n").unwrap();
    std::fs::write(folder.path().join("other.toml"), "coordinator = \"http://127.0.0.1:3\"\n").unwrap();
    let variable = ("TESSERA_COORDINATOR", "http://127.0.0.1:2");
    for (line, variables, port) in [
        ("jobs", &[][..], 1),
        ("jobs", &[variable], 2),
        ("jobs --coordinator http://127.0.0.1:4", &[variable], 4),
        ("jobs --config other.toml", &[], 3),
        ("jobs", &[("TESSERA_CONFIG", "other.toml")], 3),
    ] {
        let output = with(folder.path(), line, variables);
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(text.contains(&format!("http://127.0.0.1:{port} cannot be reached")), "{line} {variables:?}: {text}");
    }
    let shown = with(folder.path(), "config --json", &[variable]);
    let shown: Value = serde_json::from_slice(&shown.stdout).unwrap();
    let of = |name: &str| {
        let all = shown["settings"].as_array().unwrap();
        let one = all.iter().find(|setting| setting["name"] == name).unwrap();
        (one["value"].as_str().map(String::from), one["from"].as_str().unwrap().to_string())
    };
    assert_eq!(of("coordinator"), (Some(variable.1.into()), variable.0.into()));
    assert_eq!(of("threads"), (Some("3".into()), "file".into()));
    assert_eq!(of("cache"), (None, "default".into()));
    assert_eq!(shown["file_exists"], true);
}

#[test]
fn shells_get_a_script_that_knows_the_commands() {
    let folder = folder();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = tessera(folder.path(), &format!("completions {shell}"));
        let script = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && script.contains("coordinator") && script.contains("noise"), "{shell}");
    }
}

#[test]
fn a_method_left_open_is_chosen_once_reported_and_has_the_bytes_of_the_same_method_named() {
    let folder = folder();
    // Samples enough that a trial is worth its work.
    let options = "--resolution 128x128 --samples 32 --threads 2 --json";
    let run = |line: &str| {
        let output = tessera(folder.path(), line);
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let plan = run(&format!("plan good.json {options}").replace(" --threads 2", ""));
    let open = run(&format!("render good.json -o open {options}"));
    for (key, value) in open["plan"].as_object().unwrap() {
        assert_eq!(*value, plan[key], "the trial of `plan` is that of the farm: {key}");
    }
    let ruled_out = plan["ruled_out"].as_array().unwrap();
    assert!(ruled_out.iter().any(|one| one["why"].as_str().unwrap().contains("number of samples")), "{plan}");
    assert!(!plan["left_out"].as_array().unwrap().is_empty(), "{plan}");
    assert!(plan["considered"].as_array().unwrap().len() > 2, "{plan}");
    assert_eq!(plan["facts"]["delta"], false);
    let method = &plan["method"];
    let named: Vec<String> = ["direct", "light_sampling", "light_samples", "splits", "reuse", "aim", "roulette"]
        .iter()
        .map(|name| {
            let value = &method[name];
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            format!("--{} {value}", name.replace('_', "-"))
        })
        .collect();
    let closed = run(&format!("render good.json -o closed {options} {}", named.join(" ")));
    assert_eq!(closed["plan"], Value::Null, "nothing was left open");
    let image = |folder_name: &str| std::fs::read(folder.path().join(folder_name).join("frame-0001.exr")).unwrap();
    assert!(image("open") == image("closed"));

    let said = tessera(folder.path(), "plan good.json --resolution 128x128 --samples 32");
    let said = String::from_utf8(said.stdout).unwrap();
    assert!(said.contains("has not") && said.contains("* ") && said.contains("efficiency"), "{said}");
}

/// `tessera jobs | head` and the like.
#[test]
fn a_reader_who_has_seen_enough_is_no_error() {
    let folder = folder();
    for line in [
        "completions bash",
        "config",
        "scene schema",
        "scene check good.json --json",
        "plan good.json",
        "compare good.png good.png",
        "render good.json -o out --samples 1 --json",
        "stability --only triangle-leaks --quick -o stability",
        "--help",
    ] {
        image::RgbImage::new(8, 8).save(folder.path().join("good.png")).unwrap();
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = command(folder.path(), line, &[]).stdout(writer).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{line}: {said}");
        assert!(!said.contains("error") && !said.contains("panicked"), "{line}: {said}");
    }
}
