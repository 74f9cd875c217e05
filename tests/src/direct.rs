//! The tracer without the farm: a scene of scenes/ rendered in this process, uniformly sampled.

use std::path::Path;

use common::{
    film::Moments,
    job::JobId,
    method::{Direct, Method, MethodChoices},
    pass::{BATCHES_PER_SET, Work, batch_for},
    plan::{MethodPlan, Trial},
    protocol::{RenderSettings, Unit, UnitId},
    scene::SceneFile,
    tile::Rect,
};
use tracer::{Assets, Loaded, Prepared, UnitRender, special::Without};

/// A picture of moments, rows from the top.
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// One a pixel.
    pub moments: Vec<Moments>,
    /// Samples that were thrown away because they were not finite.
    pub rejected: u64,
    /// Rays traced.
    pub rays: u64,
}

/// Read a scene file; its path is relative to scenes/.
///
/// # Panics
/// Where the file is missing or wrong: this is for tests.
#[must_use]
pub fn scene(name: &str) -> SceneFile {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes").join(name);
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
    SceneFile::parse(&text).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Render a scene with the method it asks for, changed by `choices`, on every core.
///
/// # Panics
/// Where the scene cannot be rendered.
#[must_use]
pub fn render(name: &str, scene: &SceneFile, samples: u32, choices: MethodChoices) -> Picture {
    render_without(name, scene, samples, choices, Without::NOTHING)
}

/// The same with specialisations of the code left unused.
///
/// # Panics
/// Where the scene cannot be rendered.
#[must_use]
pub fn render_without(
    name: &str,
    scene: &SceneFile,
    samples: u32,
    choices: MethodChoices,
    without: Without,
) -> Picture {
    let method = choices.or(&scene.settings.method).resolve();
    let settings = settings(scene, method, samples);
    picture(&load(name, scene, &settings.method).build_without(without), &settings, samples)
}

/// Render a scene with what `auto` chooses, and tell that.
///
/// # Panics
/// Where the scene cannot be rendered.
#[must_use]
pub fn render_by_auto(name: &str, scene: &SceneFile, samples: u32) -> (Picture, MethodPlan) {
    let named = MethodChoices { direct: Some(Direct::Auto), ..scene.settings.method.clone() };
    let settings = settings(scene, named.clone().resolve(), samples);
    let prepared = load(name, scene, &settings.method).build();
    let region = Rect::frame(scene.film.width, scene.film.height);
    let plan = tracer::pilot::choose(&prepared, &settings, &Trial { region, named, quality: None });
    let chosen = prepared.with_method(&settings.method, &plan.method).expect("a pilot changes no geometry");
    (picture(&chosen, &RenderSettings { method: plan.method.clone(), ..settings }, samples), plan)
}

fn settings(scene: &SceneFile, method: Method, samples: u32) -> RenderSettings {
    let resolution = [scene.film.width, scene.film.height];
    RenderSettings {
        frame: 1,
        resolution,
        method,
        seed: 1,
        batch: batch_for(samples),
        batches_per_set: BATCHES_PER_SET,
    }
}

fn load(name: &str, scene: &SceneFile, method: &Method) -> Loaded {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes").join(name);
    let folder = folder.parent().expect("a file has a folder");
    let mut assets = Assets::default();
    for (field, file) in scene.files() {
        let bytes = std::fs::read(folder.join(&file)).unwrap_or_else(|error| panic!("{name}: {field}: {error}"));
        let mesh = import::mesh(&file, &bytes, &mut |other| std::fs::read(folder.join(other)).ok());
        assets.meshes.insert(file, mesh.unwrap_or_else(|error| panic!("{name}: {error}")).parts);
    }
    let resolution = [scene.film.width, scene.film.height];
    Loaded::new(scene, &assets, method, resolution).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn picture(prepared: &Prepared, settings: &RenderSettings, samples: u32) -> Picture {
    let [width, height] = settings.resolution;
    let rect = Rect { x: 0, y: 0, w: width, h: height };
    let id = UnitId { job: JobId(1), frame: 1, tile: 0, pass: 0, rect };
    let unit = Unit { id, work: Work::Uniform { first: 0, samples }, features: false };
    let render = UnitRender::new(prepared, settings, &unit);

    let next = std::sync::atomic::AtomicU32::new(0);
    let mut rows: Vec<(u32, tracer::RowResult)> = std::thread::scope(|scope| {
        let work = || {
            let take =
                || Some(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed)).filter(|row| *row < render.rows());
            std::iter::from_fn(take).map(|row| (row, render.row(row))).collect::<Vec<_>>()
        };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("a row panicked")).collect()
    });
    rows.sort_by_key(|(row, _)| *row);
    let result = render.assemble(rows.into_iter().map(|(_, row)| row).collect());
    let (rejected, rays) = (result.statistics.rejected, result.statistics.rays);
    Picture { width, height, moments: result.film.moments, rejected, rays }
}
