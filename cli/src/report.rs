//! What a job did and cost: `report.json`, and the closing line.

use std::path::Path;

use common::{
    adaptive::FRAME_SHARE,
    job::{JobId, JobState, Quality},
    plan::MethodPlan,
    protocol::JobView,
};
use serde::Serialize;

use crate::progress::{duration, percent, si};

/// The report of a job.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Path of the scene as it was given.
    pub scene: String,
    /// The job.
    pub job: JobId,
    /// How it ended.
    pub status: JobState,
    /// Width and height of a frame, pixels.
    pub resolution: [u32; 2],
    /// Number of frames.
    pub frames: usize,
    /// How exact the picture had to be.
    pub quality: Quality,
    /// What the scene needs and how the method was chosen; absent where the method was named, or the frame too
    /// small for a trial.
    pub plan: Option<MethodPlan>,
    /// Camera samples.
    pub samples: Samples,
    /// Rays traced, of all kinds.
    pub rays: u64,
    /// Intersection tests a ray.
    pub tests_per_ray: Tests,
    /// Times.
    pub seconds: Seconds,
    /// Processor seconds of all workers.
    pub cpu_seconds: f64,
    /// Relative error that `error_share` of the pixels keep to: half-width of the stopping rule's interval over
    /// the luminance, or over 0.01 where that is larger. Absent where it cannot be told.
    pub error: Option<f64>,
    /// Share of the pixels that keep to `error`, and must keep a noise target for it to be met.
    pub error_share: f64,
    /// Pixels whose interval is wider than the noise target; absent without one.
    pub pixels_missed: Option<u64>,
    /// Whether the target was met; a noise target may be missed at the most samples allowed.
    pub target_met: bool,
    /// What was forecast, beside what came true.
    pub forecast: Vec<Foretold>,
    /// Workers that handed in a result.
    pub workers: u32,
    /// Units that were given out again because a worker was lost, left or failed.
    pub attempts: u64,
    /// Samples that were not finite and were left out.
    pub rejected: u64,
}

/// A forecast beside what came true.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Foretold {
    /// Share of the forecast processor seconds that were spent when it was made.
    pub made_at_progress: f64,
    /// Seconds after the first lease when it was made.
    pub made_at_seconds: f64,
    /// Camera samples of the whole job.
    pub samples: Compared,
    /// Processor seconds of the whole job.
    pub cpu_seconds: Compared,
    /// Seconds from the first lease to the end.
    pub wall_seconds: Compared,
}

/// A number that was foreseen, and what it became.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Compared {
    /// As it was foreseen.
    pub predicted: f64,
    /// As it came.
    pub actual: f64,
    /// `predicted / actual`.
    pub ratio: f64,
}

impl Compared {
    fn of(predicted: f64, actual: f64) -> Self {
        Self { predicted, actual, ratio: if actual > 0.0 { predicted / actual } else { 1.0 } }
    }
}

/// Camera samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Samples {
    /// Of all frames.
    pub total: u64,
    /// Of a pixel, on average.
    pub mean: f64,
    /// Of the pixel that got most.
    pub max: u32,
}

/// Intersection tests a ray.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tests {
    /// Bounding boxes.
    pub nodes: f64,
    /// Triangles and other primitives.
    pub triangles: f64,
}

/// Times, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Seconds {
    /// Fetching and decoding the scene, summed over workers and frames.
    pub load: f64,
    /// Building acceleration structures, summed likewise.
    pub build: f64,
    /// From submission to the last result; with a single worker without loading and building.
    pub render: f64,
    /// From the start of the command to the last file written.
    pub wall: f64,
}

impl Report {
    /// The report of `job`, which took `job_seconds` from submission to its end.
    #[must_use]
    pub fn of(scene: &Path, job: &JobView, job_seconds: f64) -> Self {
        let s = &job.statistics;
        let pixels = job.region.area() as f64 * job.frames.len() as f64;
        let a_ray = |tests: u64| if s.rays == 0 { 0.0 } else { tests as f64 / s.rays as f64 };
        let setup = if s.workers <= 1 { s.load_seconds + s.build_seconds } else { 0.0 };
        Self {
            scene: scene.display().to_string(),
            job: job.id,
            status: job.state,
            resolution: job.resolution,
            frames: job.frames.len(),
            quality: job.quality.clone(),
            plan: job.plan.clone(),
            samples: Samples {
                total: job.samples,
                mean: job.samples as f64 / pixels.max(1.0),
                max: job.frames.iter().map(|frame| frame.max_samples).max().unwrap_or(0),
            },
            rays: s.rays,
            tests_per_ray: Tests { nodes: a_ray(s.node_tests), triangles: a_ray(s.primitive_tests) },
            seconds: Seconds {
                load: s.load_seconds,
                build: s.build_seconds,
                render: (job_seconds - setup).max(0.0),
                wall: job_seconds,
            },
            cpu_seconds: s.cpu_seconds,
            error: job.error,
            error_share: FRAME_SHARE,
            pixels_missed: job.frames.iter().map(|frame| frame.pixels_missed).sum(),
            target_met: target_met(job),
            forecast: job
                .forecasts
                .iter()
                .map(|f| Foretold {
                    made_at_progress: f.progress,
                    made_at_seconds: f.made_at_seconds,
                    samples: Compared::of(f.samples, job.samples as f64),
                    cpu_seconds: Compared::of(f.cpu_seconds, s.cpu_seconds),
                    wall_seconds: Compared::of(f.wall_seconds, job.wall_seconds.unwrap_or(job_seconds)),
                })
                .collect(),
            workers: s.workers,
            attempts: s.retries,
            rejected: s.rejected,
        }
    }

    /// One line for people.
    #[must_use]
    pub fn line(&self) -> String {
        let mut line = format!(
            "{}samples ({:.1} a pixel, {} at most) in {}",
            si(self.samples.total as f64),
            self.samples.mean,
            self.samples.max,
            duration(self.seconds.wall)
        );
        if let Some(error) = self.error {
            line += &format!(", error {} in {:.0}% of pixels", percent(error), 100.0 * self.error_share);
        }
        if let Quality::Noise { relative_error, .. } = self.quality {
            let verb = if self.target_met { "met" } else { "missed" };
            line += &format!(": target {} {verb}", percent(relative_error));
        }
        match self.pixels_missed {
            Some(1) => line += ", 1 pixel misses it",
            Some(missed) if missed > 0 => line += &format!(", {missed} pixels miss it"),
            _ => {}
        }
        line
    }
}

fn target_met(job: &JobView) -> bool {
    job.state == JobState::Completed
        && match job.quality {
            Quality::Noise { .. } => {
                job.frames.iter().all(|f| f.within_target.is_some_and(|share| share >= FRAME_SHARE))
            }
            Quality::Samples { .. } | Quality::Time { .. } => true,
        }
}

#[cfg(test)]
pub(crate) mod tests {
    use common::{
        hash::AssetHash,
        method::Method,
        protocol::{Forecast, FrameView, JobStatistics},
        tile::Rect,
    };

    use super::*;

    pub(crate) fn job() -> JobView {
        let frame = FrameView {
            frame: 1,
            progress: 1.0,
            done: true,
            mean_samples: 20.0,
            max_samples: 64,
            within_target: Some(0.995),
            pixels_missed: Some(1),
        };
        JobView {
            id: JobId(3),
            name: "box".into(),
            state: JobState::Completed,
            message: None,
            progress: 1.0,
            samples: 4000,
            samples_per_second: 0.0,
            error: Some(0.04),
            eta_seconds: None,
            frames: vec![frame.clone(), FrameView { frame: 2, max_samples: 128, ..frame }],
            scene: AssetHash::of(b""),
            resolution: [100, 50],
            region: Rect { x: 0, y: 0, w: 10, h: 10 },
            tile: 64,
            quality: Quality::default(),
            method: Method::default(),
            priority: 50,
            tags: Vec::new(),
            seed: 0,
            tracer: None,
            plan: None,
            created_at: String::new(),
            finished_at: None,
            wall_seconds: Some(2.0),
            forecasts: vec![Forecast {
                progress: 0.2,
                made_at_seconds: 0.5,
                samples: 5000.0,
                cpu_seconds: 1.5,
                wall_seconds: 1.5,
            }],
            statistics: JobStatistics {
                rays: 8000,
                node_tests: 80_000,
                primitive_tests: 16_000,
                cpu_seconds: 3.0,
                load_seconds: 0.5,
                build_seconds: 0.25,
                workers: 1,
                ..Default::default()
            },
            workers_now: 0,
            request: None,
        }
    }

    #[test]
    fn numbers_are_of_a_pixel_and_of_a_ray() {
        let report = Report::of(Path::new("box.json"), &job(), 2.0);
        assert_eq!(report.samples, Samples { total: 4000, mean: 20.0, max: 128 });
        assert_eq!(report.tests_per_ray, Tests { nodes: 10.0, triangles: 2.0 });
        assert_eq!(report.seconds.render, 1.25);
        assert_eq!(report.pixels_missed, Some(2));
        let forecast = report.forecast[0];
        assert_eq!(forecast.samples, Compared { predicted: 5000.0, actual: 4000.0, ratio: 1.25 });
        assert_eq!((forecast.cpu_seconds.ratio, forecast.wall_seconds.ratio), (0.5, 0.75));
        assert_eq!(
            report.line(),
            "4.00 ksamples (20.0 a pixel, 128 at most) in 2.0 s, error 4.0% in 99% of pixels: target 10% met, \
             2 pixels miss it"
        );
    }

    #[test]
    fn a_noise_target_is_met_where_99_of_100_pixels_of_every_frame_meet_it() {
        let mut job = job();
        assert!(target_met(&job));
        job.frames[1].within_target = Some(0.98);
        assert!(!target_met(&job));
        job.quality = Quality::Samples { samples: 1 };
        assert!(target_met(&job));
        job.state = JobState::Canceled;
        assert!(!target_met(&job));
    }
}
