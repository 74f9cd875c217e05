//! `tessera bench render`: a scene by the tracer alone, at a fixed number of samples of every pixel.

use std::{
    path::PathBuf,
    sync::atomic::{AtomicU32, Ordering},
    time::Instant,
};

use clap::value_parser;
use common::{
    job::{JobId, Quality},
    pass::Work,
    protocol::{RenderSettings, Unit, UnitId},
    result::{UnitResult, UnitStatistics},
    tile::Rect,
};
use serde::Serialize;
use tracer::{
    Prepared, RowResult, UnitRender,
    special::{Special, Without},
};

use super::Measured;
use crate::{
    args::{JobOptions, choice},
    bundle::Bundle,
    error::Failure,
    output, print, request,
};

/// Samples of a pixel where nothing is asked for.
const SAMPLES: u32 = 16;

/// Options of `bench render`.
#[derive(Debug, clap::Args)]
pub struct BenchRenderArgs {
    /// The scene, and how it is told.
    #[command(flatten)]
    pub what: Measured,
    /// Pictures to render, each with the next seed
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = value_parser!(u32).range(1..=1000))]
    pub runs: u32,
    /// Threads to render with
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = value_parser!(u32).range(1..=4096))]
    pub threads: u32,
    /// Write the last picture here, linear Rec. 709, as a portable float map
    #[arg(short, long, value_name = "FILE.pfm")]
    pub output: Option<PathBuf>,
    /// Leave specialisations of the code unused, by their names: the picture stays the same, and what they save is seen.
    /// Some serve only where others are not used: opacity without waves, avx2 without avx512
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = choice(Special::ALL))]
    pub general: Vec<Special>,
    /// What to render. The target is a number of samples [default: 16].
    #[command(flatten)]
    pub job: JobOptions,
}

/// What was measured.
#[derive(Debug, Serialize)]
struct Report {
    width: u32,
    height: u32,
    /// Samples of every pixel.
    samples: u32,
    threads: u32,
    /// Reading the scene and its files, and reducing them to what rendering needs, s.
    load_seconds: f64,
    /// Building the acceleration structure, s.
    build_seconds: f64,
    runs: Vec<Run>,
    /// Medians over the runs.
    median: Run,
}

/// One picture.
#[derive(Debug, Clone, Copy, Serialize)]
struct Run {
    /// Processor seconds of the process.
    cpu_seconds: f64,
    wall_seconds: f64,
    /// Millions of samples per processor second.
    msamples_per_cpu_second: f64,
    /// Millions of rays per processor second.
    mrays_per_cpu_second: f64,
    rays: u64,
    /// Samples thrown away because they were not finite.
    rejected: u64,
}

/// Runs `tessera bench render`.
///
/// # Errors
/// A scene that cannot be read or rendered, a target that is no number of samples, or a file that cannot be written.
pub fn command(mut args: BenchRenderArgs) -> Result<(), Failure> {
    let target = &mut args.job.target;
    if target.noise.is_some() || target.time.is_some() || target.max_samples.is_some() {
        return Err(Failure::Input("bench render: the target is --samples alone".into()));
    }
    let samples = *target.samples.get_or_insert(SAMPLES);
    let started = Instant::now();
    let mut bundle = Bundle::read(&args.what.scene)?;
    let request = request::of(&args.job, &bundle)?;
    debug_assert_eq!(request.quality, Some(Quality::Samples { samples }));
    if args.job.crop.is_some() {
        return Err(Failure::Input("bench render: the whole picture is measured; --crop has no use".into()));
    }
    let settings = request::settings(&request, &bundle)?;
    let loaded = bundle.load(&request)?;
    let load_seconds = started.elapsed().as_secs_f64();
    let started = Instant::now();
    let prepared = loaded.build_without(Without::all(&args.general));
    let build_seconds = started.elapsed().as_secs_f64();

    let [width, height] = settings.resolution;
    let mut runs = Vec::new();
    let mut last = None;
    for run in 0..args.runs {
        let settings = RenderSettings { seed: settings.seed.wrapping_add(u64::from(run)), ..settings.clone() };
        let (cpu, wall) = (process_seconds(), Instant::now());
        let result = picture(&prepared, &settings, samples, args.threads);
        let (cpu_seconds, wall_seconds) = (process_seconds() - cpu, wall.elapsed().as_secs_f64());
        let UnitStatistics { samples, rays, rejected, .. } = result.statistics;
        runs.push(Run {
            cpu_seconds,
            wall_seconds,
            msamples_per_cpu_second: samples as f64 / cpu_seconds / 1e6,
            mrays_per_cpu_second: rays as f64 / cpu_seconds / 1e6,
            rays,
            rejected,
        });
        last = Some(result);
    }
    if let (Some(path), Some(result)) = (&args.output, &last) {
        output::write(path, &portable_float_map(width, height, result))?;
    }
    let median = median(&runs);
    let threads = args.threads;
    let report = Report { width, height, samples, threads, load_seconds, build_seconds, runs, median };
    if args.what.json { print::json(&report) } else { print::lines(lines(&report)) }
}

fn lines(report: &Report) -> Vec<String> {
    let Report { width, height, samples, threads, load_seconds, build_seconds, runs, median } = report;
    let mut lines = vec![
        format!("{width} x {height} pixels, {samples} samples each, {threads} thread(s)"),
        format!("load {load_seconds:.3} s, build {build_seconds:.3} s"),
    ];
    let line = |name: String, run: &Run| {
        format!(
            "{name:8} {:8.3} processor s  {:8.3} s  {:7.3} Msamples and {:7.2} Mrays a processor second",
            run.cpu_seconds, run.wall_seconds, run.msamples_per_cpu_second, run.mrays_per_cpu_second
        )
    };
    lines.extend(runs.iter().enumerate().map(|(i, run)| line(format!("run {i}"), run)));
    lines.push(line("median".into(), median));
    lines
}

/// Of each figure the median over all runs.
fn median(runs: &[Run]) -> Run {
    let of = |value: fn(&Run) -> f64| {
        let mut values: Vec<f64> = runs.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    Run {
        cpu_seconds: of(|run| run.cpu_seconds),
        wall_seconds: of(|run| run.wall_seconds),
        msamples_per_cpu_second: of(|run| run.msamples_per_cpu_second),
        mrays_per_cpu_second: of(|run| run.mrays_per_cpu_second),
        rays: of(|run| run.rays as f64) as u64,
        rejected: of(|run| run.rejected as f64) as u64,
    }
}

/// The whole frame, rows shared out to `threads` threads as they come free.
fn picture(prepared: &Prepared, settings: &RenderSettings, samples: u32, threads: u32) -> UnitResult {
    let [w, h] = settings.resolution;
    let rect = Rect { x: 0, y: 0, w, h };
    let id = UnitId { job: JobId(1), frame: settings.frame, tile: 0, pass: 0, rect };
    let unit = Unit { id, work: Work::Uniform { first: 0, samples }, features: false };
    let render = UnitRender::new(prepared, settings, &unit);
    let next = AtomicU32::new(0);
    let work = || {
        let take = || Some(next.fetch_add(1, Ordering::Relaxed)).filter(|row| *row < render.rows());
        std::iter::from_fn(take).map(|row| (row, render.row(row))).collect::<Vec<(u32, RowResult)>>()
    };
    let mut rows: Vec<(u32, RowResult)> = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let mut rows = work();
        for other in others {
            match other.join() {
                Ok(more) => rows.extend(more),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        rows
    });
    rows.sort_by_key(|(row, _)| *row);
    render.assemble(rows.into_iter().map(|(_, row)| row).collect())
}

/// Processor seconds of this process so far.
pub(crate) fn process_seconds() -> f64 {
    #[cfg(unix)]
    {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    {
        // The wall clock instead: right where nothing else runs and there is one thread.
        static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
        START.get_or_init(Instant::now).elapsed().as_secs_f64()
    }
}

/// The means as a portable float map: three f32 a pixel, little endian, rows from the bottom.
fn portable_float_map(width: u32, height: u32, result: &UnitResult) -> Vec<u8> {
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    for row in result.film.moments.chunks_exact(width as usize).rev() {
        for value in row.iter().flat_map(|pixel| pixel.mean) {
            bytes.extend((value as f32).to_le_bytes());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use common::film::Moments;

    use super::*;

    #[test]
    fn medians_are_of_each_figure_by_itself() {
        let run = |cpu_seconds, wall_seconds| Run {
            cpu_seconds,
            wall_seconds,
            msamples_per_cpu_second: 1.0,
            mrays_per_cpu_second: 1.0,
            rays: 7,
            rejected: 0,
        };
        let found = median(&[run(3.0, 1.0), run(1.0, 3.0), run(2.0, 2.0)]);
        assert_eq!((found.cpu_seconds, found.wall_seconds, found.rays), (2.0, 2.0, 7));
    }

    #[test]
    fn a_float_map_begins_with_the_bottom_row() {
        let mut result = UnitResult {
            rect: Rect { x: 0, y: 0, w: 1, h: 2 },
            film: Default::default(),
            statistics: UnitStatistics::default(),
        };
        result.film.moments = vec![Moments::batch(1, [1.0, 2.0, 3.0]), Moments::batch(1, [4.0, 5.0, 6.0])];
        let bytes = portable_float_map(1, 2, &result);
        let (head, values) = bytes.split_at(bytes.len() - 24);
        assert_eq!(head, b"PF\n1 2\n-1.0\n");
        let values: Vec<f32> = values.chunks_exact(4).map(|v| f32::from_le_bytes(v.try_into().unwrap())).collect();
        assert_eq!(values, [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
    }
}
