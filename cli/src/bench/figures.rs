//! `tessera bench rays`: seconds of a build, bytes, and millions of rays a second.

use std::{hint::black_box, time::Instant};

use clap::value_parser;
use rayon::prelude::*;
use serde::Serialize;
use tracer::{
    geometry::{Accel, Counters, InstructionSet, Ray, spawn, spawn_to},
    light::Reference,
    math::Vec2,
    scene::Scene,
};

use super::{
    Measured,
    rays::{Maker, Place, RaySet},
};
use crate::{
    args::JobOptions, bundle::Bundle, error::Failure, print, request, services::threads, stability::random::Random,
};

/// Rays of each kind but the camera's: enough that the clock's ticks do not matter.
const COUNT: usize = 1 << 18;
/// Rays that one thread takes at a time.
const CHUNK: usize = 1 << 12;

/// Options of `bench rays`.
#[derive(Debug, clap::Args)]
pub struct BenchRaysArgs {
    /// The scene, and how it is told.
    #[command(flatten)]
    pub what: Measured,
    /// Times that everything is measured; medians are told
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = value_parser!(u32).range(1..=1000))]
    pub runs: u32,
    /// Threads beside which one is measured [default: all cores]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// Trace each 1000th camera ray by testing every primitive, too
    #[arg(long)]
    pub brute_force: bool,
    /// Whose rays: the picture's size and method.
    #[command(flatten)]
    pub job: JobOptions,
}

/// What was measured.
#[derive(Debug, Serialize)]
struct Report {
    instructions: String,
    threads: usize,
    /// Triangles, spheres and disks, each object's once.
    primitives: usize,
    instances: usize,
    nodes: usize,
    depth: usize,
    /// Bytes of all trees, and a primitive.
    bytes: usize,
    bytes_per_primitive: f64,
    /// Reading the scene and its files, and reducing them to what rendering needs, s.
    load_seconds: f64,
    /// Building the trees by one thread, and by `threads`, s.
    build_seconds: f64,
    build_seconds_all: f64,
    /// By one thread, s.
    build_seconds_per_million: f64,
    rays: Vec<Kind>,
    /// Testing every primitive, without a tree.
    #[serde(skip_serializing_if = "Option::is_none")]
    brute_force: Option<BruteForce>,
}

/// Rays of one kind.
#[derive(Debug, Serialize)]
struct Kind {
    name: &'static str,
    /// Rays of the set.
    count: usize,
    /// Share of the rays that hit.
    hits: f64,
    /// Millions a second by one thread, and by all.
    mrays: f64,
    mrays_all: f64,
    /// Nodes opened a ray; each tests eight boxes.
    nodes_per_ray: f64,
    /// Primitives tested a ray; a pack of eight triangles counts as eight.
    primitives_per_ray: f64,
}

/// The camera's rays without a tree.
#[derive(Debug, Serialize)]
struct BruteForce {
    /// Seconds a ray, and as many rays as the camera has.
    seconds_per_ray: f64,
    primitives_per_ray: f64,
    /// Times slower than the tree on one thread.
    times: f64,
}

/// Runs `tessera bench rays`.
///
/// # Errors
/// A scene that cannot be read or rendered, or threads that cannot be had.
pub fn command(args: BenchRaysArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let mut bundle = Bundle::read(&args.what.scene)?;
    let request = request::of(&args.job, &bundle)?;
    let resolution = bundle.resolution(&request);
    let loaded = bundle.load(&request)?;
    let load_seconds = started.elapsed().as_secs_f64();

    let many = threads(args.threads);
    let pools = [pool(1)?, pool(many)?];
    let mut builds = [Vec::new(), Vec::new()];
    for _ in 0..args.runs {
        for (pool, builds) in pools.iter().zip(&mut builds) {
            let (world, options) = loaded.world();
            let world = world.clone();
            let start = Instant::now();
            let built = pool.install(|| Accel::build_with(world, options));
            builds.push(start.elapsed().as_secs_f64());
            drop(built);
        }
    }
    let prepared = loaded.build();
    let scene = prepared.scene();
    let accel = scene.accel();
    let stats = accel.stats();
    let primitives = stats.triangles + stats.others;
    let per = |n: f64| n / primitives.max(1) as f64;
    let [build_seconds, build_seconds_all] = builds.map(median);

    let sets = sets(scene, resolution);
    let rays: Vec<Kind> = sets.iter().map(|set| kind(accel, set, &pools, args.runs)).collect();
    let brute_force = args.brute_force.then(|| brute_force(accel, &sets[0].rays, rays[0].mrays));
    let report = Report {
        instructions: format!("{:?}", InstructionSet::detect()),
        threads: many,
        primitives,
        instances: stats.instances,
        nodes: stats.nodes,
        depth: stats.depth,
        bytes: stats.bytes,
        bytes_per_primitive: per(stats.bytes as f64),
        load_seconds,
        build_seconds,
        build_seconds_all,
        build_seconds_per_million: 1e6 * per(build_seconds),
        rays,
        brute_force,
    };
    if args.what.json { print::json(&report) } else { print::lines(lines(&report)) }
}

fn pool(threads: usize) -> Result<rayon::ThreadPool, Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| Failure::Work(format!("no threads to work with: {error}")))
}

/// Rays from the middle of each pixel, in tiles of 8 x 8 as near rays follow each other.
fn camera(scene: &Scene, [width, height]: [u32; 2]) -> Vec<Ray> {
    const TILE: u32 = 8;
    let mut rays = Vec::with_capacity(width as usize * height as usize);
    for y0 in (0..height).step_by(TILE as usize) {
        for x0 in (0..width).step_by(TILE as usize) {
            for y in y0..(y0 + TILE).min(height) {
                for x in x0..(x0 + TILE).min(width) {
                    let ray = scene.camera().ray(x, y, Vec2::splat(0.5), Vec2::splat(0.5));
                    rays.push(Ray { origin: ray.origin, direction: ray.direction, t_max: ray.t_max });
                }
            }
        }
    }
    rays
}

/// Rays of every kind. Shadow rays are those that rendering would trace: to a sample of a light.
fn sets(scene: &Scene, resolution: [u32; 2]) -> Vec<RaySet> {
    let maker = Maker { accel: scene.accel(), primary: camera(scene, resolution), count: COUNT, lift: 0.0 };
    maker.sets(&|place: &Place, [pick, u, v]| {
        let reference = Reference { p: place.p, n: place.n };
        let u = Vec2::new(u as f32, v as f32).min(Vec2::splat(1.0 - f32::EPSILON));
        let sample = scene.lights().sample(&reference, (pick as f32).min(1.0 - f32::EPSILON), u)?;
        let none = tracer::math::Vec3::ZERO;
        Some(if sample.distance.is_finite() {
            spawn_to(place.p, none, place.n, sample.point, sample.point_error, sample.ng)
        } else {
            spawn(place.p, none, place.n, sample.wi)
        })
    })
}

fn kind(accel: &Accel, set: &RaySet, pools: &[rayon::ThreadPool; 2], runs: u32) -> Kind {
    let trace = |rays: &[Ray]| {
        let mut counters = Counters::default();
        let hit = |ray: &&Ray| {
            let hit =
                if set.any { accel.occluded(ray, &mut counters) } else { accel.closest(ray, &mut counters).is_some() };
            black_box(hit)
        };
        let hits = rays.iter().filter(hit).count();
        (counters, hits)
    };
    let mut seconds = [Vec::new(), Vec::new()];
    let mut total = (Counters::default(), 0);
    for _ in 0..runs {
        for (pool, seconds) in pools.iter().zip(&mut seconds) {
            let start = Instant::now();
            let parts: Vec<_> = pool.install(|| set.rays.par_chunks(CHUNK).map(trace).collect());
            seconds.push(start.elapsed().as_secs_f64());
            total = parts.into_iter().fold((Counters::default(), 0), |(mut counters, hits), (more, hit)| {
                counters += more;
                (counters, hits + hit)
            });
        }
    }
    let count = set.rays.len();
    let per = |n: u64| n as f64 / count.max(1) as f64;
    let [one, all] = seconds.map(|seconds| count as f64 / median(seconds) / 1e6);
    Kind {
        name: set.name,
        count,
        hits: per(total.1 as u64),
        mrays: one,
        mrays_all: all,
        nodes_per_ray: per(total.0.node_tests),
        primitives_per_ray: per(total.0.primitive_tests),
    }
}

/// Each 1000th of the rays, without the tree.
fn brute_force(accel: &Accel, rays: &[Ray], mrays: f64) -> BruteForce {
    let mut random = Random::new(1);
    // One of each thousand, by chance: a fixed step would follow a column of the picture.
    let some =
        rays.chunks(1000).map(|rays| &rays[((random.uniform() * rays.len() as f64) as usize).min(rays.len() - 1)]);
    let some: Vec<&Ray> = some.collect();
    let mut counters = Counters::default();
    let start = Instant::now();
    for ray in &some {
        black_box(accel.closest_by_brute_force(ray, &mut counters));
    }
    let count = some.len().max(1) as f64;
    let seconds_per_ray = start.elapsed().as_secs_f64() / count;
    BruteForce {
        seconds_per_ray,
        primitives_per_ray: counters.primitive_tests as f64 / count,
        times: seconds_per_ray * mrays * 1e6,
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn lines(r: &Report) -> Vec<String> {
    let mut lines = vec![
        format!("{} primitives, {} instances; {} instructions", r.primitives, r.instances, r.instructions),
        format!(
            "load {:.3} s; build {:.3} s by one thread ({:.3} s a million), {:.3} s by {}",
            r.load_seconds, r.build_seconds, r.build_seconds_per_million, r.build_seconds_all, r.threads
        ),
        format!(
            "{} nodes, {} deep; {:.1} MB, {:.1} bytes a primitive",
            r.nodes,
            r.depth,
            r.bytes as f64 / 1e6,
            r.bytes_per_primitive
        ),
        String::new(),
        format!(
            "{:20} {:>10} {:>12} {:>7} {:>8} {:>10}",
            "Mrays/s",
            "1 thread",
            format!("{} threads", r.threads),
            "hits",
            "nodes",
            "primitives"
        ),
    ];
    lines.extend(r.rays.iter().map(|kind| {
        format!(
            "{:20} {:>10.2} {:>12.2} {:>6.1}% {:>8.2} {:>10.2}",
            kind.name,
            kind.mrays,
            kind.mrays_all,
            100.0 * kind.hits,
            kind.nodes_per_ray,
            kind.primitives_per_ray
        )
    }));
    if let Some(brute) = &r.brute_force {
        lines.push(String::new());
        lines.push(format!(
            "without the tree: {:.0} primitives and {:.1} us a camera ray, {:.0} times as long",
            brute.primitives_per_ray,
            1e6 * brute.seconds_per_ray,
            brute.times
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_ray_is_traced_and_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.json");
        let scene = r#"{"tessera":1,"camera":{"position":[0,0,3],"target":[0,0,0]},"film":{"width":20,"height":12},
            "environment":{"type":"constant","radiance":[1,1,1]},"shapes":[{"type":"sphere"}]}"#;
        std::fs::write(&path, scene).unwrap();
        let mut bundle = Bundle::read(&path).unwrap();
        let request = request::of(&JobOptions::default(), &bundle).unwrap();
        let prepared = bundle.load(&request).unwrap().build();
        let sets = sets(prepared.scene(), [20, 12]);
        assert_eq!(sets.iter().map(|set| set.any).collect::<Vec<_>>(), [false, false, false, true, true]);
        assert_eq!(sets[0].rays.len(), 240);
        // Nothing meets a ball twice from outside; the second hits are none.
        assert_eq!(sets.iter().map(|set| set.rays.len()).collect::<Vec<_>>(), [240, COUNT, COUNT, COUNT, 0]);
        let pools = [pool(1).unwrap(), pool(2).unwrap()];
        let accel = prepared.scene().accel();
        let primary = kind(accel, &sets[0], &pools, 1);
        assert!(primary.hits > 0.1 && primary.hits < 0.9 && primary.mrays > 0.0 && primary.mrays_all > 0.0);
        assert_eq!((primary.nodes_per_ray, primary.count), (1.0, 240));
        let brute = brute_force(accel, &sets[0].rays, primary.mrays);
        assert_eq!(brute.primitives_per_ray, 1.0);
        assert_eq!(kind(accel, &sets[1], &pools, 1).hits, 0.0);
    }
}
