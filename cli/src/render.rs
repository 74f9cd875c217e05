//! `tessera render`: a farm of one machine, in one process, through the same HTTP as any farm.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use common::{
    job::{Frames, JobId, JobState},
    protocol::JobView,
};
use tempfile::TempDir;
use tokio::{
    net::TcpListener,
    task::JoinHandle,
    time::{Instant, timeout},
};
use tokio_util::sync::CancellationToken;
use worker::{Worker, WorkerError};

use crate::{
    args::{JobOptions, RenderArgs},
    bundle::Bundle,
    error::Failure,
    farm::{Farm, endpoint},
    output::{self, Output},
    replay::replay,
    request,
    services::{machine, threads},
    watch::Watch,
};

/// Marks a folder that was kept only because a render was interrupted.
const TEMPORARY: &str = "temporary";
/// Time for the parts to stop when all is done.
const STOP: Duration = Duration::from_secs(5);

/// Run `tessera render`.
///
/// # Errors
/// Bad input, a coordinator or worker that does not start, a job that fails, or Ctrl-C.
pub async fn render(args: RenderArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let scene = match (&args.scene, &args.resume) {
        (Some(scene), _) => scene.clone(),
        (None, Some(kept)) => return resume(&args, kept, started).await,
        (None, None) => return Err(Failure::Input("give a scene".into())),
    };
    if let (Some(pixel), Some(sample)) = (args.pixel, args.sample) {
        return replay(&args, &scene, pixel, sample);
    }
    let mut bundle = Bundle::read(&scene)?;
    let request = request::of(&args.job, &bundle)?;
    let path = output_path(&args)?;
    let output = Output::prepare(path, &request::frames(&request, &bundle))?;
    bundle.verify(&request)?;
    for note in &bundle.notes {
        eprintln!("note: {note}");
    }
    let mut local = Local::start(args.data.clone(), threads(args.threads)).await?;
    let watch = Watch { farm: &local.farm, scene: &scene, output: Some(&output), json: args.json, started };
    let watched = async {
        let job = local.farm.submit(&request, &bundle.assets()).await?;
        drop(bundle);
        follow(&watch, job.id).await
    };
    let ended = tokio::select! {
        ended = watched => ended,
        failure = Local::broken(&mut local.coordinator, &mut local.worker) => Err(failure),
    };
    local.stop(ended, path).await
}

/// Go on with the render that an interrupted one left in `kept`.
async fn resume(args: &RenderArgs, kept: &Path, started: Instant) -> Result<(), Failure> {
    let path = output_path(args)?;
    if args.job != JobOptions::default() {
        let message = "--resume goes on with what was asked for before; give no options for the scene or the target";
        return Err(Failure::Input(message.into()));
    }
    if !kept.join(coordinator::STORE).is_file() {
        return Err(Failure::Input(format!("--resume {}: no render was kept there", kept.display())));
    }
    let mut local = Local::start(Some(kept.into()), threads(args.threads)).await?;
    let farm = &local.farm;
    let watched = async {
        let unfinished = |job: &&JobView| !job.state.is_final();
        let none = || Failure::Input(format!("--resume {}: all that was rendered there is finished", kept.display()));
        let list = farm.jobs(None, 500).await?;
        let job = list.jobs.iter().find(unfinished).ok_or_else(none)?;
        let frames: Vec<u32> = job.frames.iter().map(|frame| frame.frame).collect();
        let output = Output::prepare(path, &Frames::of(frames).unwrap_or_default())?;
        if job.state == JobState::Paused {
            farm.act(job.id, "resume").await?;
        }
        let scene = PathBuf::from(&job.name);
        let watch = Watch { farm, scene: &scene, output: Some(&output), json: args.json, started };
        follow(&watch, job.id).await
    };
    let ended = tokio::select! {
        ended = watched => ended,
        failure = Local::broken(&mut local.coordinator, &mut local.worker) => Err(failure),
    };
    let finished = ended.is_ok();
    let ended = local.stop(ended, path).await;
    if finished && kept.join(TEMPORARY).is_file() {
        // It was kept for this alone.
        let _ = std::fs::remove_dir_all(kept);
    }
    ended
}

/// Where images go.
fn output_path(args: &RenderArgs) -> Result<&Path, Failure> {
    args.output.as_deref().ok_or_else(|| Failure::Input("--output: give a folder, FILE.png or FILE.exr".into()))
}

/// Follow a job to its end, or until it is to be left.
async fn follow(watch: &Watch<'_>, id: JobId) -> Result<(), Failure> {
    eprintln!("dashboard {}/", watch.farm.url());
    tokio::select! {
        ended = watch.follow(id) => ended,
        interrupted = watch.interrupted(id) => Err(interrupted),
    }
}

/// A coordinator and a worker in this process.
struct Local {
    farm: Farm,
    coordinator: JoinHandle<anyhow::Result<()>>,
    worker: JoinHandle<Result<(), WorkerError>>,
    stop_coordinator: CancellationToken,
    stop_worker: CancellationToken,
    /// The coordinator's files.
    data: PathBuf,
    /// The same where they are removed at the end.
    temporary: Option<TempDir>,
}

impl Local {
    async fn start(data: Option<PathBuf>, threads: usize) -> Result<Self, Failure> {
        let cannot = |what: &str, error: &dyn std::fmt::Display| Failure::Work(format!("{what}: {error}"));
        let (data, temporary) = match data {
            Some(data) => {
                output::folder(&data)?;
                (data, None)
            }
            None => {
                let folder = tempfile::Builder::new().prefix("tessera-").tempdir();
                let folder = folder.map_err(|error| cannot("no temporary folder", &error))?;
                (folder.path().to_path_buf(), Some(folder))
            }
        };
        let listener = TcpListener::bind(("127.0.0.1", 0)).await;
        let listener = listener.map_err(|error| cannot("no port on 127.0.0.1", &error))?;
        let address = listener.local_addr().map_err(|error| cannot("no port on 127.0.0.1", &error))?;
        let farm = Farm::at(&format!("http://{address}"), None)?;
        let (stop_coordinator, stop_worker) = (CancellationToken::new(), CancellationToken::new());
        let config = coordinator::Config::new(data.clone());
        let coordinator =
            tokio::spawn(coordinator::serve(config, listener, stop_coordinator.clone().cancelled_owned()));
        let worker = Worker::new(worker::Config {
            endpoint: endpoint(farm.url(), None)?,
            machine: machine(),
            threads,
            cache: None,
            grace: Duration::ZERO,
        })?;
        let worker = tokio::spawn(worker.run(stop_worker.clone()));
        Ok(Self { farm, coordinator, worker, stop_coordinator, stop_worker, data, temporary })
    }

    /// Wait for a part to end, which it should not.
    async fn broken(
        coordinator: &mut JoinHandle<anyhow::Result<()>>,
        worker: &mut JoinHandle<Result<(), WorkerError>>,
    ) -> Failure {
        let (part, why) = tokio::select! {
            ended = coordinator => ("the coordinator", ended.map(|ended| ended.map_err(|error| format!("{error:#}")))),
            ended = worker => ("the worker", ended.map(|ended| ended.map_err(|error| error.to_string()))),
        };
        let why = match why {
            Ok(Ok(())) => "it came to an end".into(),
            Ok(Err(error)) => error,
            Err(error) => error.to_string(),
        };
        Failure::Work(format!("{part} stopped: {why}"))
    }

    /// Stop both parts, the worker first, and give back how it `ended`. What they would still have to say is of no
    /// interest. After an interruption the files are kept, and the failure says how to go on to `output`.
    async fn stop(self, ended: Result<(), Failure>, output: &Path) -> Result<(), Failure> {
        // A coordinator closes when its last connection does.
        drop(self.farm);
        for (token, part) in
            [(self.stop_worker, self.worker.abort_handle()), (self.stop_coordinator, self.coordinator.abort_handle())]
        {
            token.cancel();
            let _ = timeout(STOP, async {
                while !part.is_finished() {
                    tokio::time::sleep(Duration::from_millis(5)).await;
                }
            })
            .await;
            part.abort();
        }
        match ended {
            Err(Failure::Interrupted(what)) => {
                if let Some(temporary) = self.temporary {
                    // Without the mark the files stay where the user finds them.
                    let _ = std::fs::write(temporary.keep().join(TEMPORARY), []);
                }
                let (data, output) = (self.data.display(), output.display());
                Err(Failure::Interrupted(format!("{what}; go on with: tessera render --resume {data} -o {output}")))
            }
            ended => ended,
        }
    }
}
