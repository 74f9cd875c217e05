//! `tessera chart`: its options, and the order in which pictures are taken.

use std::path::PathBuf;

use clap::value_parser;
use common::{
    job::{DEFAULT_MAX_SAMPLES, JobRequest, MAX_SAMPLES},
    method::{Bvh, Direct, Method, MethodChoices, Reuse, Roulette, Sampler, TriangleTest},
};

use super::{
    gauge::Gauge,
    methods::{Named, TEXTBOOK},
    options::Bench,
    reference::{Lasting, Pixels, Reference},
    report::Report,
    stage::Stage,
    study::{Shot, Tried},
};
use crate::{args::JobOptions, bundle::Bundle, error::Failure, output, print, request};

/// Methods that are charted where none are named.
const METHODS: &str = "hemisphere,light+one+area,light+power+solid-angle,mis,auto";
/// Samples of a reference's half against the largest budget.
const REFERENCE: u32 = 32;

/// Options of `chart`.
#[derive(Debug, clap::Args)]
pub struct ChartArgs {
    /// A scene file, or a bare mesh file
    pub scene: PathBuf,
    /// A folder for charts (SVG and PNG), a table (README.md), CSV and JSON
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Methods, with commas between; each is values of the method options joined by +, such as light+one+area, the
    /// rest being defaults. A value that two options share is the first's that the method has not named yet;
    /// option=value says which (sampler=stratified, light-samples=4). The textbook method is always charted too
    #[arg(long, value_name = "LIST", default_value = METHODS)]
    pub methods: String,
    /// Samples per pixel to try each method with. With --adaptive textbook they are the most a pixel gets, with on the
    /// mean [default: 4 to 256, doubling]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = value_parser!(u32).range(1..=i64::from(MAX_SAMPLES)))]
    pub budgets: Vec<u32>,
    /// Pictures of each method and budget
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = value_parser!(u32).range(2..=1000))]
    pub seeds: u32,
    /// An EXR or PNG to hold methods against, instead of rendering one. Given twice: two that are independent of
    /// each other, whose noise is then taken out
    #[arg(long, value_name = "FILE", conflicts_with = "reference_samples")]
    pub reference: Vec<PathBuf>,
    /// Samples per pixel of each half of the reference [default: 32 times the largest budget]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(2..=i64::from(MAX_SAMPLES)))]
    pub reference_samples: Option<u32>,
    /// Cache, threads, JSON.
    #[command(flatten)]
    pub bench: Bench,
    /// What all methods have in common.
    #[command(flatten)]
    pub job: JobOptions,
}

/// Runs `tessera chart`.
///
/// # Errors
/// Options or a scene that cannot be used, or a file that cannot be written.
pub fn command(args: &ChartArgs) -> Result<(), Failure> {
    let report = chart(args)?;
    report.write(&args.output)?;
    for note in &report.notes {
        eprintln!("note: {note}");
    }
    if args.bench.json {
        return print::json(&report.json());
    }
    let (heads, rows) = report.table();
    print::table(&heads, rows.into_iter())
}

/// The methods to be tried, the textbook's first.
fn named(list: &str) -> Result<Vec<Named>, Failure> {
    let wrong = |error: String| Failure::Input(format!("--methods: {error}"));
    let textbook = Named { name: "textbook".into(), ..Named::parse(TEXTBOOK).map_err(wrong)? };
    let mut all = vec![textbook];
    for words in list.split(',').map(str::trim) {
        let method = Named::parse(words).map_err(wrong)?;
        if all[1..].iter().any(|other| other.name == method.name) {
            return Err(wrong(format!("{words} is named twice")));
        }
        // The textbook's own words mean the first.
        if method.choices != all[0].choices {
            all.push(method);
        }
    }
    Ok(all)
}

/// Check the options that mean something else to commands that render one picture.
fn check(job: &JobOptions) -> Result<(), Failure> {
    let target = &job.target;
    let refused = [
        (target.samples.is_some(), "--samples"),
        (target.noise.is_some(), "--noise"),
        (target.time.is_some(), "--time"),
    ];
    if let Some((_, option)) = refused.into_iter().find(|(given, _)| *given) {
        return Err(Failure::Input(format!("{option}: chart takes --budgets, samples per pixel, instead")));
    }
    if job.tile.is_some() {
        return Err(Failure::Input("--tile: chart renders frames whole".into()));
    }
    if job.frames.as_ref().is_some_and(|frames| frames.numbers().len() > 1) {
        return Err(Failure::Input("--frames: chart takes one frame".into()));
    }
    Ok(())
}

fn chart(args: &ChartArgs) -> Result<Report, Failure> {
    check(&args.job)?;
    let named = named(&args.methods)?;
    let mut budgets = args.budgets.clone();
    if budgets.is_empty() {
        budgets = (2..=8).map(|power| 1 << power).collect();
    }
    budgets.sort_unstable();
    budgets.dedup();
    let largest = budgets.last().copied().unwrap_or(1);
    let mut bundle = Bundle::read(&args.scene)?;
    let base = request::of(&args.job, &bundle)?;
    let threads = args.bench.threads();
    let most = args.job.target.max_samples.unwrap_or(DEFAULT_MAX_SAMPLES).max(largest);
    output::folder(&args.output)?;

    let mut notes = Vec::new();
    let mut stages = Vec::new();
    for method in &named {
        let request = JobRequest { method: method.choices.clone().or(&base.method), ..base.clone() };
        let stage = Stage::open(&mut bundle, &request, most, threads)?;
        if largest < stage.least() {
            let least = stage.least();
            return Err(Failure::Input(format!("--budgets: {} needs {least} samples per pixel or more", method.name)));
        }
        if budgets[0] < stage.least() {
            notes.push(format!("{} begins at {} samples per pixel.", method.name, stage.least()));
        }
        stages.push(stage);
    }
    // One reference for all methods that aim at the same light.
    let kind = |method: &Method| (method.max_depth, method.only);
    let mut kinds = Vec::new();
    for stage in &stages {
        let kind = kind(stage.method());
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    if !args.reference.is_empty() && kinds.len() > 1 {
        let message = "--reference: methods that differ in only or max-depth aim at different light, and need references \
                       that are rendered";
        return Err(Failure::Input(message.into()));
    }
    if args.reference.len() > 2 {
        return Err(Failure::Input("--reference: may be given once or twice".into()));
    }

    let pixels = f64::from(stages[0].region().area() as u32);
    let samples = args.reference_samples.unwrap_or(largest.saturating_mul(REFERENCE).min(MAX_SAMPLES));
    let in_all = |stage: &Stage| -> f64 {
        let each: f64 = budgets.iter().filter(|n| **n >= stage.least()).map(|n| f64::from(*n)).sum();
        each * pixels * f64::from(args.seeds)
    };
    let rendered = if args.reference.is_empty() { 2.0 * f64::from(samples) * pixels } else { 0.0 };
    let work = stages.iter().map(in_all).chain(kinds.iter().map(|_| rendered)).collect();
    let mut gauge = Gauge::new(work);

    let mut references = Vec::new();
    for (i, kind) in kinds.iter().enumerate() {
        gauge.say("reference");
        let of = stages.len() + i;
        let reference = if args.reference.is_empty() {
            let request = JobRequest { method: careful(*kind, &base.method), ..base.clone() };
            let stage = Stage::open(&mut bundle, &request, most, threads)?;
            let cache = args.bench.cache()?;
            let mut tick = |taken: u64| gauge.took(of, taken as f64);
            let scene = bundle.asset().0;
            Reference::render(&stage, scene, samples, &cache, &mut tick)?
        } else {
            let region = stages[0].region();
            Reference::read(&args.reference, [region.w as usize, region.h as usize])?
        };
        gauge.skip(of);
        references.push(reference);
    }

    let mut methods: Vec<(Tried, Lasting)> = Vec::new();
    for (named, stage) in named.iter().zip(&stages) {
        let reference = kinds.iter().position(|other| *other == kind(stage.method())).unwrap_or(0);
        let tried = Tried {
            name: named.name.clone(),
            method: stage.method().clone(),
            build_seconds: stage.build_seconds,
            reference,
            shots: Vec::new(),
            lasting: (0.0, 0.0),
        };
        methods.push((tried, Lasting::default()));
    }
    let count = methods.len();
    for seed in 0..u64::from(args.seeds) {
        for (level, &budget) in budgets.iter().enumerate() {
            for turn in 0..count {
                // Another one begins each time.
                let of = (turn + level + seed as usize) % count;
                let (stage, (tried, lasting)) = (&stages[of], &mut methods[of]);
                if budget < stage.least() {
                    continue;
                }
                gauge.say(&tried.name);
                // Pictures of different budgets are independent of each other, and of the reference.
                let number = (base.seed << 24).wrapping_add(1 + seed * budgets.len() as u64 + level as u64);
                let run = stage.run(budget, number)?;
                gauge.took(of, f64::from(budget) * pixels);
                let image: Pixels = run.pixels.iter().map(|pixel| pixel.mean.map(|value| value as f32)).collect();
                let reference = &references[tried.reference];
                tried.shots.push(Shot {
                    budget,
                    seed: number,
                    samples: run.samples as f64 / pixels,
                    cpu_seconds: run.cpu_seconds,
                    distance: reference.distance(&image),
                });
                if budget == largest {
                    lasting.add(reference, &image);
                }
            }
        }
    }
    gauge.clear();
    let finish =
        |(tried, lasting): (Tried, Lasting)| Tried { lasting: lasting.relmse(&references[tried.reference]), ..tried };
    let methods: Vec<Tried> = methods.into_iter().map(finish).collect();
    notes.extend(doubts(&methods, &references));
    let region = stages[0].region();
    Ok(Report {
        scene: args.scene.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        command: std::iter::once("tessera".into()).chain(std::env::args().skip(1)).collect::<Vec<_>>().join(" "),
        size: [region.w, region.h],
        seeds: args.seeds,
        threads,
        methods,
        references,
        notes,
    })
}

/// The method that a reference is rendered with: our own in all that is a matter of estimation, the scene's and the
/// user's in what light there is.
pub(super) fn careful((max_depth, only): (u32, Option<common::method::Only>), base: &MethodChoices) -> MethodChoices {
    MethodChoices {
        max_depth: Some(max_depth),
        only: Some(only),
        fresnel: base.fresnel,
        direct: Some(Direct::Auto),
        light_pick: Some(None),
        light_samples: Some(1),
        splits: Some(1),
        reuse: Some(Reuse::Off),
        light_sampling: Some(None),
        sampler: Some(Sampler::Sobol),
        triangle: Some(TriangleTest::Watertight),
        bvh: Some(Bvh::Sah),
        roulette: Some(Roulette::Throughput),
        adaptive: Some(None),
        ..MethodChoices::default()
    }
}

/// What a reader must know before believing a number.
fn doubts(methods: &[Tried], references: &[Reference]) -> Vec<String> {
    let mut notes = Vec::new();
    for method in methods {
        let reference = &references[method.reference];
        let least = method.levels().iter().map(|level| level.relmse.mean).fold(f64::INFINITY, f64::min);
        match reference.relmse {
            Some(own) if own > 0.5 * least => notes.push(format!(
                "The reference's own relMSE, {own:.1e}, is not small against the least of {}, {least:.1e}: give a larger \
                 --reference-samples.",
                method.name
            )),
            _ => {}
        }
    }
    if references.iter().any(|reference| !reference.is_clean()) {
        notes.push(
            "The reference is one picture: its own noise is part of every error. Give two that are independent.".into(),
        );
    }
    notes
}
