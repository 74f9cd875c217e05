//! Rays against Intel Embree: the same triangles, the same rays, one thread, the repetitions of both taken in turns,
//! so that what the machine does meanwhile touches both alike.
//!
//! `TESSERA_EMBREE=LIBRARY cargo bench -p tessera-tests --bench embree` measures; without the variable it says so and
//! does nothing.

mod library;
mod report;
mod scenes;

use std::{hint::black_box, path::PathBuf, time::Instant};

use clap::Parser;
use cli::bench::rays::{Maker, Place, RaySet};
use glam::DVec3;
use rustix::time::ClockId;
use tracer::geometry::{Accel, Counters, InstructionSet, Options as Build, Ray, Shape, TriangleTest, Width, World};

use library::{Embree, Found};
use report::{Cell, FourTree, Report, Tree};
use scenes::Scene;

/// The variable that names Embree's library.
const VARIABLE: &str = "TESSERA_EMBREE";
/// Edge of the picture whose rays these are.
const EDGE: usize = 1024;
/// Rays of each set but the camera's.
const COUNT: usize = 1 << 18;

/// Rays against Intel Embree.
#[derive(Parser)]
struct Options {
    /// Times that each set is traced by each side; medians are told. 0: builds alone.
    #[arg(long, default_value_t = 7)]
    repetitions: usize,
    /// Times that each tree is built; medians are told.
    #[arg(long, default_value_t = 5)]
    builds: usize,
    /// Only scenes whose names begin so.
    #[arg(long, default_value = "")]
    only: String,
    /// Measure trees of four children a node as well, in turns with those of eight.
    #[arg(long)]
    four: bool,
    /// A folder for the table as CSV and the charts.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// What cargo passes.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    let Some(path) = std::env::var_os(VARIABLE) else {
        println!("{VARIABLE} names no library: the comparison with Embree is skipped");
        return Ok(());
    };
    let embree = Embree::open(path.as_ref())?;
    let mut report = Report { embree: embree.version()?, instructions: InstructionSet::detect(), ..Report::default() };
    for make in scenes::all() {
        let scene = make();
        if scene.name.starts_with(&options.only) {
            measure(&scene, &embree, &options, &mut report)?;
        }
    }
    report.print();
    if let Some(folder) = &options.output {
        report.write(folder)?;
    }
    Ok(())
}

fn measure(scene: &Scene, embree: &Embree, options: &Options, report: &mut Report) -> anyhow::Result<()> {
    let triangles = scene.mesh.triangles.len();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        // Several threads are there to be sooner done; of one, what others take of the processor does not count.
        let start = || (Instant::now(), processor_seconds(ClockId::ProcessCPUTime));
        let since = |(wall, processor): (Instant, f64)| match threads {
            1 => processor_seconds(ClockId::ProcessCPUTime) - processor,
            _ => wall.elapsed().as_secs_f64(),
        };
        let (mut ours, mut fours, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
        let (mut our_bytes, mut four_bytes, mut their_bytes) = (0, 0, 0);
        let build = |width, times: &mut Vec<f64>| {
            let world = world(scene);
            let started = start();
            let accel = pool.install(|| Accel::build_with(world, Build { width, ..Build::default() }));
            times.push(since(started));
            accel.bytes()
        };
        for _ in 0..options.builds {
            our_bytes = build(Width::Eight, &mut ours);
            if options.four {
                four_bytes = build(Width::Four, &mut fours);
            }
            let prepared = embree.prepare(&scene.mesh, threads)?;
            let started = start();
            let built = prepared.build(true)?;
            theirs.push(since(started));
            their_bytes = built.bytes;
        }
        let per = |bytes: usize| bytes as f64 / triangles as f64;
        report.trees.push(Tree {
            scene: scene.name,
            triangles,
            threads,
            ours: median(&ours),
            theirs: median(&theirs),
            our_bytes: per(our_bytes),
            their_bytes: per(their_bytes),
            four: options.four.then(|| FourTree { seconds: median(&fours), bytes: per(four_bytes) }),
        });
    }

    if options.repetitions == 0 {
        return Ok(());
    }
    let accel = Accel::build(world(scene), TriangleTest::Watertight);
    let sse = Build { instructions: InstructionSet::Sse2, ..Build::default() };
    let sse = Accel::build_with(world(scene), sse);
    let four = || Accel::build_with(world(scene), Build { width: Width::Four, ..Build::default() });
    let four = options.four.then(four);
    let robust = embree.prepare(&scene.mesh, 1)?.build(true)?;
    let fast = embree.prepare(&scene.mesh, 1)?.build(false)?;
    for set in ray_sets(scene, &accel) {
        let mut times: [Vec<f64>; 5] = Default::default();
        for _ in 0..options.repetitions {
            times[0].push(time(&set, |ray| ours_closest(&accel, ray), |ray| ours_any(&accel, ray)));
            times[1].push(time(&set, |ray| robust.closest(ray), |ray| robust.occluded(ray)));
            times[2].push(time(&set, |ray| fast.closest(ray), |ray| fast.occluded(ray)));
            times[3].push(time(&set, |ray| ours_closest(&sse, ray), |ray| ours_any(&sse, ray)));
            if let Some(four) = &four {
                times[4].push(time(&set, |ray| ours_closest(four, ray), |ray| ours_any(four, ray)));
            }
        }
        let over = |other: &[f64]| median(&times[0].iter().zip(other).map(|(ours, t)| t / ours).collect::<Vec<_>>());
        let rate = |times: &[f64]| set.rays.len() as f64 / median(times) / 1e6;
        let differ = set.rays.iter().filter(|ray| {
            if set.any {
                ours_any(&accel, ray) != robust.occluded(ray)
            } else {
                ours_closest(&accel, ray).is_some() != robust.closest(ray).is_some()
            }
        });
        let cell = Cell {
            scene: scene.name,
            rays: set.name,
            ours: rate(&times[0]),
            robust: rate(&times[1]),
            fast: rate(&times[2]),
            sse: rate(&times[3]),
            ratio: over(&times[1]),
            four: four.is_some().then(|| (rate(&times[4]), over(&times[4]))),
            differ: differ.count(),
        };
        eprintln!("{}: {}: {:.3} times Embree robust", cell.scene, cell.rays, cell.ratio);
        report.cells.push(cell);
    }
    Ok(())
}

fn world(scene: &Scene) -> World {
    World { shapes: vec![Shape::Mesh(scene.mesh.clone())], ..World::default() }
}

#[inline(always)]
fn ours_closest(accel: &Accel, ray: &Ray) -> Option<Found> {
    accel.closest(ray, &mut Counters::default()).map(|hit| Found { t: hit.t, primitive: hit.primitive })
}

#[inline(always)]
fn ours_any(accel: &Accel, ray: &Ray) -> bool {
    accel.occluded(ray, &mut Counters::default())
}

/// Processor seconds by one of the system's clocks: others that share the processor do not count.
fn processor_seconds(clock: ClockId) -> f64 {
    let time = rustix::time::clock_gettime(clock);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Processor seconds for all rays of a set.
#[inline(always)]
fn time(set: &RaySet, closest: impl Fn(&Ray) -> Option<Found>, any: impl Fn(&Ray) -> bool) -> f64 {
    let start = processor_seconds(ClockId::ThreadCPUTime);
    for ray in &set.rays {
        if set.any {
            black_box(any(ray));
        } else {
            black_box(closest(ray));
        }
    }
    processor_seconds(ClockId::ThreadCPUTime) - start
}

/// The rays of a picture, in tiles of 8 x 8 pixels.
fn ray_sets(scene: &Scene, accel: &Accel) -> Vec<RaySet> {
    let back = (scene.eye - scene.target).normalize();
    let right = DVec3::Y.cross(back).normalize();
    let up = back.cross(right);
    let half = (0.5 * scene.fov.to_radians()).tan();
    let mut primary = Vec::with_capacity(EDGE * EDGE);
    for tile in 0..EDGE * EDGE / 64 {
        for k in 0..64 {
            let (x, y) = (tile % (EDGE / 8) * 8 + k % 8, tile / (EDGE / 8) * 8 + k / 8);
            let across = |i: usize| (2.0 * (i as f64 + 0.5) / EDGE as f64 - 1.0) * half;
            let direction = (right * across(x) - up * across(y) - back).normalize();
            primary.push(Ray::new(scene.eye.as_vec3(), direction.as_vec3()));
        }
    }
    // So far off the surface that neither side meets it again.
    let lift = 1e-4 * accel.bounds().diagonal().max_element();
    let maker = Maker { accel, primary, count: COUNT, lift };
    maker.sets(&|place: &Place, [_, u, v]| {
        let [corner, a, b] = scene.light;
        let to = corner + a * u + b * v - place.p.as_dvec3();
        let distance = to.length();
        Some(Ray { origin: place.p, direction: (to / distance).as_vec3(), t_max: (0.999 * distance) as f32 })
    })
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
