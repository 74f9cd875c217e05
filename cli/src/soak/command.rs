//! `tessera soak`: its options, and what it prints.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use clap::value_parser;
use serde_json::json;
use tempfile::TempDir;

use super::{
    hostile, methods,
    run::{Subject, Tally, run},
};
use crate::{bundle::Bundle, error::Failure, output, print, services::threads};

/// Options of `soak`.
#[derive(Debug, clap::Args)]
pub struct SoakArgs {
    /// Samples to render, at least; 1e9 is short for a one with nine zeros
    #[arg(long, value_name = "N", default_value = "1e8", value_parser = count)]
    pub samples: u64,
    /// A scene file, or a folder of them; may be repeated. Scenes made for trouble are always rendered too
    #[arg(long, value_name = "PATH", default_values = ["scenes", "scenes/analytic"])]
    pub scenes: Vec<PathBuf>,
    /// Only scenes whose names begin so; may be repeated
    #[arg(long, value_name = "NAME")]
    pub only: Vec<String>,
    /// Keep the scenes made for trouble here; without, they are kept only if one has a bad sample
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
    /// Threads to render with [default: all cores]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A whole number, also as 1e9.
fn count(text: &str) -> Result<u64, String> {
    let whole = |value: f64| (1.0..=1e15).contains(&value) && value.fract() == 0.0;
    match (text.parse(), text.parse::<f64>()) {
        (Ok(count), _) if count >= 1 => Ok(count),
        (_, Ok(value)) if whole(value) => Ok(value as u64),
        _ => Err("expected a whole number above 0, such as 100000000 or 1e8".into()),
    }
}

/// A scene that is given gets this many times the samples of one that is made here: there are few of them.
const READ_SHARE: f64 = 4.0;

/// Runs `tessera soak`.
///
/// # Errors
/// A scene that cannot be read, a sample that is not finite or is below 0, or fewer samples than were asked for.
pub fn command(args: SoakArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let mut temporary = None;
    let folder = match &args.keep {
        Some(folder) => {
            output::folder(folder)?;
            folder.clone()
        }
        None => {
            let made = tempfile::Builder::new().prefix("tessera-soak-").tempdir();
            let made = made.map_err(|error| Failure::Work(format!("no temporary folder: {error}")))?;
            temporary.insert(made).path().to_path_buf()
        }
    };
    let mut subjects = Vec::new();
    for path in &args.scenes {
        subjects.extend(read(path)?);
    }
    subjects.extend(write(&folder)?);
    let wanted = |name: &str| args.only.is_empty() || args.only.iter().any(|only| name.starts_with(only.as_str()));
    subjects.retain(|subject| wanted(&subject.name));
    if subjects.is_empty() {
        return Err(Failure::Input(format!("--only {}: no scene has such a name", args.only.join(", --only "))));
    }
    let line = |name: &str, tally: &Tally| {
        if args.json {
            return Ok(());
        }
        let lit = 100.0 * tally.lit as f64 / tally.samples as f64;
        let counts = format!("{:12} samples  {lit:5.1}% lit", tally.samples);
        let bad = format!("{} not finite  {} below 0", tally.not_finite, tally.negative);
        print::lines([format!("{name:40} {counts}  {bad}")].into_iter().chain(tally.replay.clone()))
    };
    let done = |subject: &Subject, tally: &Tally| line(&subject.name, tally);
    let total = run(&subjects, args.samples, threads(args.threads), &done)?;
    line("all", &total)?;
    let seconds = started.elapsed().as_secs_f64();
    let (scenes, cases) = (subjects.len(), subjects.len() * methods::COUNT);
    if args.json {
        print::json(&json!({
            "scenes": scenes, "cases": cases, "seconds": seconds, "samples": total.samples, "lit": total.lit,
            "not_finite": total.not_finite, "negative": total.negative, "replay": total.replay,
        }))?;
    } else {
        print::lines([format!("{scenes} scenes, each by {} methods, in {seconds:.0} s", methods::COUNT)])?;
    }
    match &total.replay {
        None => Ok(()),
        Some(replay) => {
            // The scene must still be there when it is looked for.
            temporary.map(TempDir::keep);
            let bad = total.bad();
            Err(Failure::Work(format!("{bad} samples are not finite or below 0; the first again, alone: {replay}")))
        }
    }
}

/// The scene at `path`, or all of those in it.
fn read(path: &Path) -> Result<Vec<Subject>, Failure> {
    let mut files = vec![path.to_path_buf()];
    if path.is_dir() {
        let entries = fs::read_dir(path).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
        files = entries.map_err(|error| Failure::file(path, &error))?;
        files.retain(|file| file.extension().is_some_and(|extension| extension == "json"));
        files.sort();
        if files.is_empty() {
            return Err(Failure::Input(format!("--scenes {}: no scene file in it", path.display())));
        }
    }
    let subject = |file: &PathBuf| {
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Subject { name, bundle: Bundle::read(file)?, made: false, share: READ_SHARE })
    };
    files.iter().map(subject).collect()
}

/// Write the scenes that are made for trouble, and read them as any other.
pub(super) fn write(folder: &Path) -> Result<Vec<Subject>, Failure> {
    for (name, width, pixels) in hostile::pictures() {
        let path = folder.join(name);
        let height = pixels.len() as u32 / width;
        let saved = image::save_buffer(&path, pixels.as_flattened(), width, height, image::ColorType::Rgb8);
        saved.map_err(|error| Failure::Work(format!("{}: cannot be written: {error}", path.display())))?;
    }
    let mut subjects = Vec::new();
    for hostile::Hostile { name, scene } in hostile::scenes() {
        let path = folder.join(format!("{name}.json"));
        output::write(&path, format!("{scene:#}\n").as_bytes())?;
        subjects.push(Subject { name, bundle: Bundle::read(&path)?, made: true, share: 1.0 });
    }
    Ok(subjects)
}
