//! Following a job to its end: progress, images, report.

use std::path::Path;

use common::{
    job::{JobId, JobState},
    protocol::JobView,
};
use tokio::time::Instant;

use crate::{
    error::Failure,
    farm::Farm,
    output::{self, Output},
    progress::Progress,
    report::Report,
    signals,
};

/// What to do with a job that is followed.
#[derive(Debug, Clone, Copy)]
pub struct Watch<'a> {
    /// Where it is.
    pub farm: &'a Farm,
    /// Path of its scene, for the report.
    pub scene: &'a Path,
    /// Where its images go, if anywhere.
    pub output: Option<&'a Output>,
    /// Whether the report goes to standard output.
    pub json: bool,
    /// When the command began.
    pub started: Instant,
}

impl Watch<'_> {
    /// Follow `id` to its end and write what it made.
    ///
    /// # Errors
    /// The job failed or was cancelled, or a file cannot be written.
    pub async fn follow(&self, id: JobId) -> Result<(), Failure> {
        let submitted = Instant::now();
        let mut progress = Progress::new();
        let followed = self.farm.follow(id, |job| progress.show(job)).await;
        progress.clear();
        let job = followed?;
        match job.state {
            JobState::Completed => {
                let mut report = Report::of(self.scene, &job, submitted.elapsed().as_secs_f64());
                self.save(&job).await?;
                report.seconds.wall = self.started.elapsed().as_secs_f64();
                self.tell(&report)
            }
            JobState::Canceled => Err(Failure::Work(format!("job {id} was cancelled"))),
            _ => {
                let why = job.message.unwrap_or_else(|| "it does not say why".into());
                Err(Failure::Work(format!("job {id} failed: {why}")))
            }
        }
    }

    /// Write the images as they stand.
    ///
    /// # Errors
    /// The farm has no image, or a file cannot be written.
    pub async fn save(&self, job: &JobView) -> Result<(), Failure> {
        let Some(output) = self.output else { return Ok(()) };
        let frames: Vec<u32> = job.frames.iter().map(|frame| frame.frame).collect();
        for (frame, image, path) in output.files(&frames) {
            output::write(&path, &self.farm.image(job.id, frame, image).await?)?;
        }
        Ok(())
    }

    fn tell(&self, report: &Report) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(report).map_err(|error| Failure::Work(error.to_string()))?;
        if let Some(path) = self.output.and_then(Output::report) {
            output::write(&path, format!("{text}\n").as_bytes())?;
        }
        eprintln!("{}", report.line());
        if self.json { crate::print::lines([text]) } else { Ok(()) }
    }

    /// Wait for Ctrl-C, then write the images as they stand and pause the job.
    pub async fn interrupted(&self, id: JobId) -> Failure {
        signals::shutdown().await;
        let mut kept = "";
        if let Ok(job) = self.farm.job(id).await
            && job.samples > 0
            && self.output.is_some()
            && self.save(&job).await.is_ok()
        {
            kept = "; the images are what was rendered until then";
        }
        // It is paused or the farm is away, in which case nobody can help.
        let _ = self.farm.act(id, "pause").await;
        Failure::Interrupted(kept.into())
    }
}
