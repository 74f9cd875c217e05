//! `tessera bench auto`: what `auto` chooses for a scene against the best choice that could be named there.
//!
//! Every combination of the choices that `auto` makes is rendered once, the best of them also with paths that split; the
//! best of these, and what `auto` chose, are then rendered with many seeds in turn, and held against a reference. `auto` itself never sees a clock or a
//! reference: here both are looked at.

use std::path::PathBuf;

use clap::value_parser;
use common::{
    job::{JobRequest, MAX_SAMPLES},
    method::{Aim, Direct, LightPick, LightSampling, Method, MethodChoices, Reuse, Roulette},
    plan::{Facts, LEAST_PIXELS, Trial, label},
};
use serde::Serialize;

use super::{
    command::careful,
    options::Bench,
    reference::{Pixels, Reference},
    stage::Stage,
};
use crate::{
    args::JobOptions,
    bench::process_seconds,
    bundle::Bundle,
    error::Failure,
    output, plan, print,
    request::{self, method_of},
};

/// Samples per pixel with which every combination is tried once.
const FIRST: u32 = 16;
/// So many of the best are tried with paths that go on in several ways as well.
const SPLIT: usize = 6;
/// The numbers of ways.
const SPLITS: [u32; 4] = [2, 4, 8, 16];
/// Most of them that are tried with all seeds.
const FINALISTS: usize = 6;
/// Only those within this factor of the best.
const WITHIN: f64 = 1.4;
/// Samples of each half of a reference against those of a picture.
const REFERENCE: u32 = 8;

/// Options of `bench auto`.
#[derive(Debug, clap::Args)]
pub struct BenchAutoArgs {
    /// Scene files
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Pixels of a picture, about; the scene says its shape
    #[arg(long, value_name = "N", default_value_t = 16_384, value_parser = value_parser!(u32).range(LEAST_PIXELS as i64..=67_108_864))]
    pub pixels: u32,
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = value_parser!(u32).range(16..=i64::from(MAX_SAMPLES / REFERENCE)))]
    pub samples: u32,
    /// Pictures of each choice in the second round
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = value_parser!(u32).range(3..=1000))]
    pub seeds: u32,
    /// Write the table here, as Markdown
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Cache, threads, JSON.
    #[command(flatten)]
    pub bench: Bench,
}

/// What was found for one scene.
#[derive(Debug, Serialize)]
struct Row {
    scene: String,
    size: [u32; 2],
    /// Combinations that were rendered.
    combinations: usize,
    /// What `auto` chose, and its efficiency, 1 / (relMSE x processor seconds).
    chosen: String,
    chosen_efficiency: f64,
    /// The best of all.
    best: String,
    best_efficiency: f64,
    /// The one's efficiency over the other's.
    ratio: f64,
    /// Standard error of the ratio: the jackknife over seeds.
    ratio_error: f64,
    /// Processor seconds that `auto` took to choose: for a frame of this size of which nothing is asked, and for the scene as it
    /// is written.
    pilot_seconds: f64,
    pilot_seconds_of_scene: f64,
    finalists: Vec<Finalist>,
}

/// A choice that was tried with all seeds.
#[derive(Debug, Clone, Serialize)]
struct Finalist {
    name: String,
    /// Mean relMSE, the reference's noise taken out.
    relmse: f64,
    /// Nanoseconds a sample, by the clock of the processor.
    nanoseconds: f64,
    /// Counted work of a sample, about nanoseconds, as the pilot has it.
    counted: f64,
    efficiency: f64,
    #[serde(skip)]
    shots: Vec<[f64; 2]>,
}

/// Runs `tessera bench auto`.
///
/// # Errors
/// A scene that cannot be read or rendered, or a file that cannot be written.
pub fn command(args: &BenchAutoArgs) -> Result<(), Failure> {
    let rows: Vec<Row> = args.scenes.iter().map(|scene| row(args, scene)).collect::<Result<_, _>>()?;
    if let Some(path) = &args.output {
        output::write(path, markdown(&rows, args).as_bytes())?;
    }
    if args.bench.json { print::json(&rows) } else { print::lines(markdown(&rows, args).lines().map(str::to_owned)) }
}

fn row(args: &BenchAutoArgs, scene: &std::path::Path) -> Result<Row, Failure> {
    let mut bundle = Bundle::read(scene)?;
    let own = request::of(&JobOptions::default(), &bundle)?;
    let own = JobRequest { method: MethodChoices { direct: Some(Direct::Auto), ..own.method }, ..own };
    let size = shape(bundle.resolution(&own), args.pixels);
    let request = JobRequest { resolution: Some(size), ..own.clone() };
    let count = args.bench.threads();
    let method = method_of(&request, &bundle);
    let (_, seconds_of_scene) = plan::of(&mut bundle, &own)?;
    let seconds = pilot_seconds(&mut bundle, &request)?;
    let stage = Stage::open(&mut bundle, &request, MAX_SAMPLES, count)?;
    let facts = *stage.facts();

    let kind = (method.max_depth, method.only);
    let reference_request = JobRequest { method: careful(kind, &request.method), ..request.clone() };
    let reference_stage = Stage::open(&mut bundle, &reference_request, MAX_SAMPLES, count)?;
    let folder = args.bench.cache()?;
    let samples = args.samples * REFERENCE;
    eprintln!("{}: {}x{} pixels, reference", scene.display(), size[0], size[1]);
    let reference = Reference::render(&reference_stage, bundle.asset().0, samples, &folder, &mut |_| {})?;

    let chosen = label(stage.method(), &facts);
    let mut stages: Vec<(String, Stage)> = Vec::new();
    for method in combinations(&method, &facts) {
        if facts.lights == 1 && matches!(method.light_pick, Some(LightPick::One | LightPick::All)) {
            // The same as by power.
            continue;
        }
        let name = label(&method, &facts);
        if !stages.iter().any(|(other, _)| *other == name)
            && let Some(stage) = stage.with_method(&method)
        {
            stages.push((name, stage));
        }
    }
    let shoot = |stage: &Stage, samples: u32, seed: u64| -> Result<[f64; 2], Failure> {
        let run = stage.run(samples, seed)?;
        let image: Pixels = run.pixels.iter().map(|pixel| pixel.mean.map(|value| value as f32)).collect();
        Ok([reference.distance(&image).relmse, run.cpu_seconds])
    };
    eprintln!("{}: {} combinations", scene.display(), stages.len());
    let mut first = Vec::new();
    let turn = |first: &mut Vec<(f64, String, Stage)>, stages: Vec<(String, Stage)>| -> Result<(), Failure> {
        for (name, stage) in stages {
            let [relmse, seconds] = shoot(&stage, FIRST, 1)?;
            first.push((relmse * seconds, name, stage));
        }
        first.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(())
    };
    turn(&mut first, stages)?;
    if facts.delta {
        let mut aimed = Vec::new();
        for (_, _, stage) in first.iter().take(SPLIT) {
            let method = Method { aim: Aim::Delta, ..stage.method().clone() };
            aimed.extend(stage.with_method(&method).map(|stage| (label(&method, &facts), stage)));
        }
        turn(&mut first, aimed)?;
    }
    let mut split = Vec::new();
    for (_, _, stage) in first.iter().take(SPLIT) {
        for splits in SPLITS {
            let method = Method { splits, ..stage.method().clone() };
            split.extend(stage.with_method(&method).map(|stage| (label(&method, &facts), stage)));
        }
        if !facts.opacity {
            let method = Method { reuse: Reuse::Paths, ..stage.method().clone() };
            split.extend(stage.with_method(&method).map(|stage| (label(&method, &facts), stage)));
        }
    }
    turn(&mut first, split)?;
    // Choices of `auto` are among the combinations, but for splits of what is not among the best.
    if !first.iter().any(|(_, name, _)| *name == chosen)
        && let Some(stage) = stage.with_method(stage.method())
    {
        turn(&mut first, vec![(chosen.clone(), stage)])?;
    }
    let combinations = first.len();
    let limit = first[0].0 * WITHIN;
    let keep = |(rank, (product, name, _)): (usize, &(f64, String, Stage))| {
        *name == chosen || rank < FINALISTS && *product <= limit
    };
    let kept: Vec<bool> = first.iter().enumerate().map(keep).collect();
    let mut finalists: Vec<(Finalist, Stage)> = Vec::new();
    for ((_, name, stage), _) in first.into_iter().zip(kept).filter(|(_, kept)| *kept) {
        let counted = stage.counted_work();
        let blank = Finalist { name, relmse: 0.0, nanoseconds: 0.0, counted, efficiency: 0.0, shots: Vec::new() };
        finalists.push((blank, stage));
    }
    eprintln!("{}: {} of them with {} seeds", scene.display(), finalists.len(), args.seeds);
    let n = finalists.len();
    for seed in 0..args.seeds as usize {
        for turn in 0..n {
            let (finalist, stage) = &mut finalists[(turn + seed) % n];
            finalist.shots.push(shoot(stage, args.samples, 2 + seed as u64)?);
        }
    }
    let in_all = f64::from(size[0]) * f64::from(size[1]) * f64::from(args.samples);
    let mut finalists: Vec<Finalist> = finalists.into_iter().map(|(finalist, _)| finalist).collect();
    for finalist in &mut finalists {
        let [relmse, seconds] = means(finalist.shots.iter());
        (finalist.relmse, finalist.nanoseconds) = (relmse, seconds / in_all * 1e9);
        finalist.efficiency = 1.0 / (relmse * seconds);
    }
    finalists.sort_by(|a, b| b.efficiency.total_cmp(&a.efficiency));
    let best = &finalists[0];
    let auto = finalists.iter().find(|finalist| finalist.name == chosen);
    let auto = auto.ok_or_else(|| Failure::Work(format!("{}: {chosen} was not tried", scene.display())))?;
    let (ratio, ratio_error) = ratio(&auto.shots, &best.shots);
    Ok(Row {
        scene: scene.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        size,
        combinations,
        chosen_efficiency: auto.efficiency,
        chosen,
        best: best.name.clone(),
        best_efficiency: best.efficiency,
        ratio,
        ratio_error,
        pilot_seconds: seconds,
        pilot_seconds_of_scene: seconds_of_scene,
        finalists,
    })
}

/// A size of about so many pixels, and not fewer, in the shape of a frame of `resolution`.
fn shape([w, h]: [u32; 2], pixels: u32) -> [u32; 2] {
    let scale = (f64::from(pixels) / (f64::from(w) * f64::from(h))).sqrt();
    let width = ((f64::from(w) * scale).round() as u32).max(1);
    [width, pixels.div_ceil(width)]
}

/// Processor seconds of choosing a method as [`Stage::open`] does, on all threads together.
fn pilot_seconds(bundle: &mut Bundle, request: &JobRequest) -> Result<f64, Failure> {
    let settings = request::settings(request, bundle)?;
    let prepared = bundle.load(request)?.build();
    let named = request.method.clone().or(&bundle.scene.settings.method);
    let trial = Trial { region: request.region(settings.resolution)?, named, quality: None };
    let before = process_seconds();
    let _ = tracer::pilot::choose(&prepared, &settings, &trial);
    Ok(process_seconds() - before)
}

/// Every combination of what `auto` chooses.
fn combinations(method: &Method, facts: &Facts) -> Vec<Method> {
    let mut all = Vec::new();
    for direct in [Direct::Mis, Direct::Light, Direct::Bsdf] {
        if direct == Direct::Bsdf && facts.delta_lights || direct != Direct::Light && !facts.light_can_be_hit() {
            continue;
        }
        for pick in [LightPick::Tree, LightPick::Power, LightPick::One, LightPick::All] {
            for sampling in [LightSampling::SolidAngle, LightSampling::Area] {
                for light_samples in [1, 2, 4] {
                    for roulette in [Roulette::Throughput, Roulette::Late] {
                        all.push(Method {
                            direct,
                            // Where there is nothing to pick from, as the pilot leaves it.
                            light_pick: (!facts.one_emitter).then_some(pick),
                            light_sampling: Some(sampling),
                            light_samples,
                            roulette,
                            ..method.clone()
                        });
                    }
                }
            }
        }
    }
    all
}

fn means<'a>(shots: impl Iterator<Item = &'a [f64; 2]>) -> [f64; 2] {
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for shot in shots {
        (sums[0], sums[1], count) = (sums[0] + shot[0], sums[1] + shot[1], count + 1.0);
    }
    sums.map(|sum| sum / count)
}

/// Efficiency of the one over that of the other, seed by seed the same, and its standard error.
fn ratio(one: &[[f64; 2]], other: &[[f64; 2]]) -> (f64, f64) {
    let without = |left_out: Option<usize>| {
        let of = |shots: &[[f64; 2]]| {
            let [relmse, seconds] =
                means(shots.iter().enumerate().filter(|(i, _)| Some(*i) != left_out).map(|(_, shot)| shot));
            relmse * seconds
        };
        of(other) / of(one)
    };
    let n = one.len() as f64;
    let each: Vec<f64> = (0..one.len()).map(|i| without(Some(i))).collect();
    let mean = each.iter().sum::<f64>() / n;
    let spread: f64 = each.iter().map(|value| (value - mean) * (value - mean)).sum();
    (without(None), (spread * (n - 1.0) / n).sqrt())
}

fn markdown(rows: &[Row], args: &BenchAutoArgs) -> String {
    let mut text = format!(
        "{} samples a pixel, {} seeds; efficiency is 1 / (relMSE x processor seconds); ± is one standard error.\n\n",
        args.samples, args.seeds
    );
    text += "| Scene | Pixels | `auto` chose | Efficiency | Best of all | Efficiency | `auto` / best |\n";
    text += "|---|---|---|---:|---|---:|---:|\n";
    for row in rows {
        let Row { scene, size: [w, h], combinations, chosen, best, .. } = row;
        let (own, most) = (row.chosen_efficiency, row.best_efficiency);
        let against = if chosen == best {
            "1, it is the best".to_owned()
        } else {
            format!("{:.2} ± {:.2}", row.ratio, row.ratio_error)
        };
        text += &format!(
            "| {scene} | {w} x {h} | `{chosen}` | {own:.4} | `{best}`, of {combinations} | {most:.4} | {against} |\n"
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_is_that_of_error_times_seconds() {
        let (ratio, error) = ratio(&[[2.0, 1.0], [2.0, 1.0], [2.0, 1.0]], &[[1.0, 3.0], [1.0, 3.0], [1.0, 3.0]]);
        assert_eq!((ratio, error), (1.5, 0.0));
        let (ratio, error) = super::ratio(&[[1.0, 1.0]; 4], &[[0.8, 1.0], [1.2, 1.0], [0.8, 1.0], [1.2, 1.0]]);
        // The standard error of the mean of 0.8, 1.2, 0.8, 1.2.
        assert!((ratio - 1.0).abs() < 1e-12 && (error - 0.2 / 3f64.sqrt()).abs() < 1e-12, "{ratio} {error}");
    }

    #[test]
    fn shapes_have_enough_pixels() {
        assert_eq!(shape([512, 512], 16_384), [128, 128]);
        let [w, h] = shape([768, 512], 16_384);
        assert!(w * h >= 16_384 && w * h < 16_700 && (f64::from(w) / f64::from(h) - 1.5).abs() < 0.03, "{w} {h}");
    }

    #[test]
    fn combinations_are_what_a_scene_leaves_open() {
        let of = |facts: &Facts| {
            let all = combinations(&Method::default(), facts);
            let mut names: Vec<String> = all.iter().map(|method| label(method, facts)).collect();
            names.sort();
            names.dedup();
            names
        };
        let lamp = Facts { lights: 1, area_lights: true, one_emitter: true, ..Facts::default() };
        // Two ways with light samples x 2 places x 3 counts x 2 roulettes, and one without x 2.
        assert_eq!(of(&lamp).len(), 26);
        let point = Facts { lights: 1, delta_lights: true, one_emitter: true, ..Facts::default() };
        assert!(of(&point).iter().all(|name| name.starts_with("light")), "{:?}", of(&point));
    }
}
