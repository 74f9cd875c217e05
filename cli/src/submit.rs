//! `tessera submit`.

use common::{job::JobRequest, protocol::JobView};
use tokio::time::Instant;

use crate::{
    args::SubmitArgs, bundle::Bundle, error::Failure, farm::Farm, output::Output, print, request, watch::Watch,
};

/// Run `tessera submit`.
///
/// # Errors
/// Bad input, a farm that is away or refuses the job, or with `--watch` a job that fails.
pub async fn submit(args: SubmitArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let farm = Farm::connect(&args.farm.connect)?;
    let mut bundle = Bundle::read(&args.scene)?;
    let request = request::of(&args.job, &bundle)?;
    let request = JobRequest { name: args.name, priority: args.priority, tags: args.tags, ..request };
    let frames = request::frames(&request, &bundle);
    let output = args.output.as_deref().map(|path| Output::prepare(path, &frames)).transpose()?;
    bundle.verify(&request)?;
    for note in &bundle.notes {
        eprintln!("note: {note}");
    }
    let job: JobView = farm.submit(&request, &bundle.assets()).await?;
    drop(bundle);
    if !args.watch {
        return if args.farm.json { print::json(&job) } else { print::lines([job.id.to_string()]) };
    }
    eprintln!("job {} at {}/", job.id, farm.url());
    let json = args.farm.json;
    Watch { farm: &farm, scene: &args.scene, output: output.as_ref(), json, started }.follow(job.id).await
}
