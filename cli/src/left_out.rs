//! What a plan leaves out because the scene does not need it, and what it would have cost: code that is specialised
//! against the same code without that, on some rows of the picture.
//!
//! Processor time is read here, and nowhere near what chooses the picture: the choice is made before.

use common::{
    job::{JobId, JobRequest},
    method::{Method, MethodChoices},
    pass::Work,
    protocol::{RenderSettings, Unit, UnitId},
    tile::Rect,
};
use serde::Serialize;
use tracer::{
    Prepared, UnitRender,
    integrator::Integrator,
    special::{Special, Without},
    unit,
};
use worker::clock::thread_seconds;

use crate::{bundle::Bundle, error::Failure};

/// Samples of a pixel.
const SAMPLES: u32 = 16;
/// Longer side of the picture.
const SIDE: u32 = 96;
/// Seconds that a picture takes, about.
const SECONDS: f64 = 0.025;
/// Pictures of each, in turn.
const ROUNDS: usize = 5;

/// What is left out of the code.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOut {
    /// Name of the specialisation, as `tessera bench render --general` takes it.
    pub name: &'static str,
    /// What is not done thanks to it.
    pub what: &'static str,
    /// Specialisations that neither side used, since this one serves only beside them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<&'static str>,
    /// Processor time of the general code over that of the special one.
    pub times: f64,
    /// Standard error of that.
    pub times_error: f64,
}

/// The choices that make `method`, for a request.
#[must_use]
pub fn named(method: &Method, request: &JobRequest) -> JobRequest {
    let method = MethodChoices {
        direct: Some(method.direct),
        light_pick: Some(method.light_pick),
        light_samples: Some(method.light_samples),
        light_sampling: Some(method.light_sampling),
        splits: Some(method.splits),
        reuse: Some(method.reuse),
        aim: Some(method.aim),
        roulette: Some(method.roulette),
        ..request.method.clone()
    };
    JobRequest { method, ..request.clone() }
}

/// Measure what is left out of the picture that `request` asks for; `settings` name its method, every choice made.
///
/// # Errors
/// A scene that cannot be rendered.
pub fn measure(bundle: &mut Bundle, request: &JobRequest, settings: &RenderSettings) -> Result<Vec<LeftOut>, Failure> {
    let [w, h] = settings.resolution;
    let scale = f64::from(SIDE) / f64::from(w.max(h));
    let resolution = [w, h].map(|side| ((f64::from(side) * scale) as u32).clamp(1, SIDE));
    let request = JobRequest { resolution: Some(resolution), ..named(&settings.method, request) };
    let settings = RenderSettings { resolution, ..settings.clone() };
    let noted = bundle.notes.len();
    let special = bundle.load(&request)?.build();
    let used = Integrator::new(special.scene(), &settings.method).specialised(&unit::sampler(&settings));

    // As many rows as take about so long.
    let all = seconds(&special, &settings, 1).max(1e-6);
    let stride = ((all / SECONDS).round() as u32).clamp(1, resolution[1]);
    let mut sides: Vec<(Vec<Special>, Prepared)> = vec![(Vec::new(), special)];
    let mut pairs = Vec::new();
    for (special, beside) in used {
        let with = |more: Option<Special>| beside.iter().copied().chain(more).collect::<Vec<_>>();
        let mut side = |left_out: Vec<Special>| -> Result<usize, Failure> {
            if let Some(at) = sides.iter().position(|(other, _)| *other == left_out) {
                return Ok(at);
            }
            let without = Without::all(&left_out);
            let prepared = match sides[0].1.without(without) {
                Some(prepared) => prepared,
                None => bundle.load(&request)?.build_without(without),
            };
            sides.push((left_out, prepared));
            Ok(sides.len() - 1)
        };
        pairs.push((special, side(with(None))?, side(with(Some(special)))?, beside));
    }
    // Loading again says nothing new.
    bundle.notes.truncate(noted);
    let mut taken = vec![Vec::with_capacity(ROUNDS); sides.len()];
    for round in 0..ROUNDS {
        for turn in 0..sides.len() {
            let at = (turn + round) % sides.len();
            taken[at].push(seconds(&sides[at].1, &settings, stride));
        }
    }
    let left_out = pairs.into_iter().map(|(special, own, general, beside)| {
        let ratios: Vec<f64> = taken[general].iter().zip(&taken[own]).map(|(general, own)| general / own).collect();
        let (times, times_error) = mean(&ratios);
        let beside = beside.into_iter().map(Special::name).collect();
        LeftOut { name: special.name(), what: special.spares(), beside, times, times_error }
    });
    Ok(left_out.collect())
}

/// The mean, and its standard error.
fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (mean, (squares / (n * (n - 1.0))).sqrt())
}

/// Processor seconds of one row of every `stride`.
fn seconds(prepared: &Prepared, settings: &RenderSettings, stride: u32) -> f64 {
    let [w, h] = settings.resolution;
    let rect = Rect { x: 0, y: 0, w, h };
    let id = UnitId { job: JobId(1), frame: settings.frame, tile: 0, pass: 0, rect };
    let unit = Unit { id, work: Work::Uniform { first: 0, samples: SAMPLES }, features: false };
    let render = UnitRender::new(prepared, settings, &unit);
    let before = thread_seconds();
    // A row may stand for several of the picture.
    let stride = (stride * render.rows()).div_ceil(h).max(1);
    for row in (0..render.rows()).skip((stride / 2) as usize).step_by(stride as usize) {
        std::hint::black_box(render.row(row));
    }
    thread_seconds() - before
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_mean_has_its_standard_error() {
        let (mean, error) = super::mean(&[1.0, 2.0, 3.0]);
        assert!((mean - 2.0).abs() < 1e-12 && (error - (1.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }
}
