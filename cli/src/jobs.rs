//! The commands that show and steer what a farm does.

use common::protocol::{JobView, WorkerView};

use crate::{
    args::{FarmArgs, JobArgs, JobsArgs},
    error::Failure,
    farm::Farm,
    print,
    progress::{duration, percent, si},
};

/// Run `tessera jobs`.
///
/// # Errors
/// The farm is away.
pub async fn list(args: JobsArgs) -> Result<(), Failure> {
    let farm = Farm::connect(&args.farm.connect)?;
    let list = farm.jobs(args.status.map(|state| state.name()), args.limit).await?;
    if args.farm.json {
        return print::json(&list);
    }
    print::table(&["job", "status", "done", "samples", "left", "name"], list.jobs.iter().map(row))
}

fn row(job: &JobView) -> Vec<String> {
    let left = job.eta_seconds.map_or("-".into(), duration);
    let samples = si(job.samples as f64).trim_end().to_string();
    vec![job.id.to_string(), job.state.to_string(), percent(job.progress), samples, left, job.name.clone()]
}

/// Run `tessera job`.
///
/// # Errors
/// The farm is away or has no such job.
pub async fn show(args: JobArgs) -> Result<(), Failure> {
    let farm = Farm::connect(&args.farm.connect)?;
    let job = farm.job(args.job).await?;
    tell(&args.farm, &job)
}

/// Run `tessera cancel`, `pause` or `resume`.
///
/// # Errors
/// The farm is away, has no such job, or cannot do this to it now.
pub async fn act(args: JobArgs, action: &str) -> Result<(), Failure> {
    let farm = Farm::connect(&args.farm.connect)?;
    let job = farm.act(args.job, action).await?;
    tell(&args.farm, &job)
}

fn tell(args: &FarmArgs, job: &JobView) -> Result<(), Failure> {
    if args.json {
        return print::json(job);
    }
    let [w, h] = job.resolution;
    let s = &job.statistics;
    let mut lines = vec![
        format!("{}  {}", job.id, job.name),
        format!("status     {}", job.state),
        format!("done       {}", percent(job.progress)),
        format!("frames     {} of {w}x{h}", job.frames.len()),
        match job.samples_per_second {
            rate if rate >= 1.0 => format!("samples    {} at {}samples/s", si(job.samples as f64).trim_end(), si(rate)),
            _ => format!("samples    {}", si(job.samples as f64).trim_end()),
        },
        format!("processor  {} by {} workers", duration(s.cpu_seconds), s.workers),
    ];
    lines.extend(job.message.as_ref().map(|message| format!("message    {message}")));
    lines.extend(job.error.map(|error| format!("error      {}", percent(error))));
    lines.extend(job.eta_seconds.map(|seconds| format!("left       {}", duration(seconds))));
    print::lines(lines)
}

/// Run `tessera workers`.
///
/// # Errors
/// The farm is away.
pub async fn workers(args: FarmArgs) -> Result<(), Failure> {
    let farm = Farm::connect(&args.connect)?;
    let list = farm.workers().await?;
    if args.json {
        return print::json(&list);
    }
    let row = |worker: &WorkerView| {
        vec![
            worker.id.to_string(),
            worker.state.clone(),
            worker.threads.to_string(),
            si(worker.samples_per_second).trim_end().to_string(),
            worker.units.to_string(),
            worker.failures.to_string(),
            worker.machine.clone(),
        ]
    };
    let head = ["worker", "state", "threads", "samples/s", "units", "failures", "machine"];
    print::table(&head, list.workers.iter().map(row))
}
