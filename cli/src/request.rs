//! From options to what is asked of a farm.

use common::{
    job::{DEFAULT_CONFIDENCE, DEFAULT_MAX_SAMPLES, DEFAULT_TILE, Frames, JobRequest, Quality, SceneRef},
    method::{Method, MethodChoices},
    protocol::RenderSettings,
};

use crate::{
    args::{JobOptions, TargetOptions},
    bundle::Bundle,
    error::Failure,
};

/// The request that `options` make for a scene, checked.
///
/// # Errors
/// Options that contradict the scene or each other.
pub fn of(options: &JobOptions, bundle: &Bundle) -> Result<JobRequest, Failure> {
    let settings = &bundle.scene.settings;
    let request = JobRequest {
        frames: options.frames.clone(),
        resolution: options.resolution,
        quality: quality(&options.target, settings.quality.as_ref()),
        method: method(options),
        tile: options.tile.unwrap_or(DEFAULT_TILE),
        crop: options.crop,
        seed: options.seed.unwrap_or(0),
        ..JobRequest::new(SceneRef::Asset { asset: bundle.asset().0 })
    };
    request.validate()?;
    request.region(bundle.resolution(&request))?;
    Ok(request)
}

/// The frames that a request means.
#[must_use]
pub fn frames(request: &JobRequest, bundle: &Bundle) -> Frames {
    request.frames.clone().or_else(|| bundle.scene.settings.frames.clone()).unwrap_or_default()
}

/// The first of them.
#[must_use]
pub fn first_frame(request: &JobRequest, bundle: &Bundle) -> u32 {
    frames(request, bundle).numbers().first().copied().unwrap_or(1)
}

/// The method that a request means, every choice made.
#[must_use]
pub fn method_of(request: &JobRequest, bundle: &Bundle) -> Method {
    request.method.clone().or(&bundle.scene.settings.method).resolve()
}

/// The settings that the units of the first frame share, as the farm will have them.
///
/// # Errors
/// A target and a method that contradict each other.
pub fn settings(request: &JobRequest, bundle: &Bundle) -> Result<RenderSettings, Failure> {
    let method = method_of(request, bundle);
    let quality = quality_of(request, bundle);
    let rule = coordinator::plan::Rule::of(&quality, &method)?;
    let (batch, batches_per_set) = (rule.batch(), rule.batches_per_set());
    let (frame, resolution) = (first_frame(request, bundle), bundle.resolution(request));
    Ok(RenderSettings { frame, resolution, method, seed: request.seed, batch, batches_per_set })
}

/// The target of a request: its own, or else the scene's.
#[must_use]
pub fn quality_of(request: &JobRequest, bundle: &Bundle) -> Quality {
    request.quality.clone().or_else(|| bundle.scene.settings.quality.clone()).unwrap_or_default()
}

/// The target asked for; `None` leaves it to the scene, or to the job that is continued.
#[must_use]
pub fn quality(options: &TargetOptions, scene: Option<&Quality>) -> Option<Quality> {
    let most = options.max_samples.or(options.samples);
    let noise = |relative_error| Quality::Noise {
        relative_error,
        confidence: DEFAULT_CONFIDENCE,
        max_samples: DEFAULT_MAX_SAMPLES,
    };
    let time = |cpu_seconds| Quality::Time { cpu_seconds, max_samples: DEFAULT_MAX_SAMPLES };
    match (options.noise, options.time, options.samples) {
        (Some(error), _, _) => Some(limited(noise(error), most)),
        (None, Some(seconds), _) => Some(limited(time(seconds), most)),
        (None, None, Some(samples)) => Some(Quality::Samples { samples }),
        (None, None, None) => most.map(|_| limited(scene.cloned().unwrap_or_default(), most)),
    }
}

fn limited(quality: Quality, most: Option<u32>) -> Quality {
    let Some(most) = most else { return quality };
    match quality {
        Quality::Noise { relative_error, confidence, .. } => {
            Quality::Noise { relative_error, confidence, max_samples: most }
        }
        Quality::Time { cpu_seconds, .. } => Quality::Time { cpu_seconds, max_samples: most },
        Quality::Samples { samples } => Quality::Samples { samples: samples.min(most) },
    }
}

fn method(options: &JobOptions) -> MethodChoices {
    MethodChoices {
        max_depth: options.max_depth,
        direct: options.direct,
        light_pick: options.light_pick.map(Some),
        light_samples: options.light_samples,
        splits: options.splits,
        reuse: options.reuse,
        light_sampling: options.light_sampling.map(Some),
        aim: options.aim,
        only: options.only.map(Some),
        fresnel: options.fresnel,
        sampler: options.sampler,
        triangle: options.triangle,
        bvh: options.bvh,
        roulette: options.roulette,
        adaptive: options.adaptive.map(Some),
        adaptive_batch: options.adaptive_batch,
        adaptive_tolerance: options.adaptive_tolerance,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_follows_the_options_then_the_scene() {
        let none = TargetOptions::default;
        let noise = |relative_error, max_samples| Quality::Noise { relative_error, confidence: 0.95, max_samples };
        let scene = noise(0.02, 100);
        for (options, expected) in [
            (none(), None),
            (TargetOptions { samples: Some(8), ..none() }, Some(Quality::Samples { samples: 8 })),
            (TargetOptions { noise: Some(0.5), ..none() }, Some(noise(0.5, 4096))),
            (TargetOptions { noise: Some(0.5), max_samples: Some(9), ..none() }, Some(noise(0.5, 9))),
            (TargetOptions { noise: Some(0.5), samples: Some(9), ..none() }, Some(noise(0.5, 9))),
            (TargetOptions { max_samples: Some(9), ..none() }, Some(noise(0.02, 9))),
            (TargetOptions { time: Some(2.0), ..none() }, Some(Quality::Time { cpu_seconds: 2.0, max_samples: 4096 })),
        ] {
            assert_eq!(quality(&options, Some(&scene)), expected, "{options:?}");
        }
    }
}
