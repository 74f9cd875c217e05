//! Counted work: of a sample, of a whole picture, and how much of it a pilot may take.

use common::{
    adaptive,
    job::Quality,
    method::{Aim, LightPick, LightSampling, Method},
    plan::Trial,
};

use super::tried::Tried;
use crate::{geometry::Counters, integrator::Integrator, scene::Scene};

/// Counted work, about nanoseconds: each kind of step at what it was measured to take on one core of an AVX-512
/// machine, fitted over all combinations of choices and the shipped scenes (`tessera bench auto` shows both). What
/// matters is how methods compare within a scene: of those within twice the best, that is off by 3% (one standard
/// deviation).
pub(super) fn work(counters: &Counters, samples: u64, integrator: &Integrator, scene: &Scene, method: &Method) -> f64 {
    let small = scene.accel().is_small();
    let (sample, vertex, ray, node, primitive) = match (integrator.has_wave(), small) {
        (true, true) => (125.0, 70.0, 1.0, 0.0, 0.0),
        (true, false) => (125.0, 70.0, 3.0, 0.65, 6.7),
        (false, _) => (100.0, 180.0, 40.0, 48.0, 0.0),
    };
    // Paths that go on in several ways wait for lanes, and draw from larger sets of points.
    let ray = if method.splits > 1 { ray + 38.0 } else { ray };
    // What there is to aim at is looked up, and weighed for each direction; rough metals are asked one by one.
    let vertex = match (method.aim, scene.has_facets()) {
        (Aim::Off, _) => vertex,
        (Aim::Delta, false) => vertex + 20.0,
        (Aim::Delta, true) => vertex + 45.0,
    };
    samples as f64 * sample
        + counters.vertices as f64 * vertex
        + counters.light_samples as f64 * light_sample(scene, method, integrator.has_wave())
        + counters.rays as f64 * ray
        + counters.node_tests as f64 * node
        + counters.primitive_tests as f64 * primitive
}

/// Counted work of a sample of a light; that of its ray is partly in here.
fn light_sample(scene: &Scene, method: &Method, in_waves: bool) -> f64 {
    let facts = scene.facts();
    let by_area = matches!(method.light_sampling, Some(LightSampling::Area | LightSampling::Stratified));
    let point = match (in_waves, by_area) {
        (true, _) if scene.lights().lone_rectangle().is_some() => 88.0,
        // Points on spheres and on triangles are chosen many at once.
        (true, true) if scene.lights().has_shards() => 65.0,
        (true, false) if scene.lights().has_balls() => 105.0,
        (true, true) => 137.0,
        (true, false) => 162.0,
        (false, true) => 50.0,
        (false, false) => 70.0,
    };
    let choice = match (method.light_pick, in_waves) {
        _ if facts.one_emitter => 0.0,
        (Some(LightPick::Tree) | None, true) => 12.0 + 20.0 * libm::log2(f64::from(facts.emitters.max(2))),
        (Some(LightPick::Tree) | None, false) => 45.0 + 20.0 * libm::log2(f64::from(facts.emitters.max(2))),
        (Some(LightPick::Power | LightPick::One), _) => 8.0,
        (Some(LightPick::All), _) => 0.0,
    };
    point + choice
}

/// Counted work of the picture that `trial` is for, by the method of `tried`; `None` where it is not known what is asked.
pub(super) fn of_picture(trial: &Trial, tried: &Tried, batch: u32) -> Option<f64> {
    let of_samples = |samples: f64| samples * trial.region.area() as f64 * tried.cost();
    match *trial.quality.as_ref()? {
        Quality::Samples { samples } => Some(of_samples(f64::from(samples))),
        Quality::Time { cpu_seconds, max_samples } => Some((cpu_seconds * 1e9).min(of_samples(f64::from(max_samples)))),
        Quality::Noise { max_samples, .. } => {
            // Variances are of what a pixel gets in any case or more.
            let of_one = least_variance(trial, batch) / f64::from(adaptive::PILOT_BATCHES * batch);
            let needs = |variance: &f64| (variance / of_one).min(f64::from(max_samples));
            let sum: f64 = tried.variances.iter().map(needs).sum();
            Some(of_samples(sum / tried.variances.len().max(1) as f64))
        }
    }
}

/// The variance of a sample relative to the square of the luminance below which a pixel is done with the samples that it gets
/// in any case: less variance saves nothing there.
pub(super) fn least_variance(trial: &Trial, batch: u32) -> f64 {
    match trial.quality {
        Some(Quality::Noise { relative_error, confidence, .. }) => {
            let error = relative_error / adaptive::normal_quantile(0.5 + 0.5 * confidence);
            f64::from(adaptive::PILOT_BATCHES * batch) * error * error
        }
        _ => 0.0,
    }
}
