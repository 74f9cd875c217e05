//! `tessera continue`: a finished job goes on to a finer target.

use std::path::Path;

use common::{job::Frames, protocol::JobPatch};
use tokio::time::Instant;

use crate::{args::ContinueArgs, error::Failure, farm::Farm, output::Output, print, request, watch::Watch};

/// Run `tessera continue`.
///
/// # Errors
/// No target, one that is not finer, a farm that is away, or with `--watch` a job that fails.
pub async fn go_on(args: ContinueArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let farm = Farm::connect(&args.farm.connect)?;
    let job = farm.job(args.job).await?;
    let Some(quality) = request::quality(&args.target, Some(&job.quality)) else {
        return Err(Failure::Input("give a finer target: --samples, --noise or --time".into()));
    };
    let frames = Frames::of(job.frames.iter().map(|frame| frame.frame)).unwrap_or_default();
    let output = args.output.as_deref().map(|path| Output::prepare(path, &frames)).transpose()?;
    let patch = JobPatch { quality: Some(quality), ..JobPatch::default() };
    let job = farm.patch(job.id, &patch).await?;
    let json = args.farm.json;
    if !args.watch {
        return if json { print::json(&job) } else { print::lines([job.id.to_string()]) };
    }
    let scene = Path::new(&job.name);
    Watch { farm: &farm, scene, output: output.as_ref(), json, started }.follow(job.id).await
}
