//! `tessera render`: a farm of one machine, in one process, through the same HTTP as any farm.

use std::{path::PathBuf, time::Duration};

use tempfile::TempDir;
use tokio::{
    net::TcpListener,
    task::JoinHandle,
    time::{Instant, timeout},
};
use tokio_util::sync::CancellationToken;
use worker::{Worker, WorkerError};

use crate::{
    args::RenderArgs,
    bundle::Bundle,
    error::Failure,
    farm::{Farm, endpoint},
    output::{self, Output},
    replay::replay,
    request,
    services::{machine, threads},
    watch::Watch,
};

/// Time for the parts to stop when all is done.
const STOP: Duration = Duration::from_secs(5);

/// Run `tessera render`.
///
/// # Errors
/// Bad input, a coordinator or worker that does not start, a job that fails, or Ctrl-C.
pub async fn render(args: RenderArgs) -> Result<(), Failure> {
    if let (Some(pixel), Some(sample)) = (args.pixel, args.sample) {
        return replay(&args, pixel, sample);
    }
    let started = Instant::now();
    let mut bundle = Bundle::read(&args.scene)?;
    let request = request::of(&args.job, &bundle)?;
    let path = args.output.ok_or_else(|| Failure::Input("--output: give a folder, FILE.png or FILE.exr".into()))?;
    let output = Output::prepare(&path, &request::frames(&request, &bundle))?;
    bundle.verify(&request)?;
    for note in &bundle.notes {
        eprintln!("note: {note}");
    }
    let mut local = Local::start(args.data, threads(args.threads)).await?;
    let watch = Watch { farm: &local.farm, scene: &args.scene, output: Some(&output), json: args.json, started };
    let watched = async {
        let job = local.farm.submit(&request, &bundle.assets()).await?;
        drop(bundle);
        eprintln!("dashboard {}/", local.farm.url());
        tokio::select! {
            ended = watch.follow(job.id) => ended,
            interrupted = watch.interrupted(job.id) => Err(interrupted),
        }
    };
    let ended = tokio::select! {
        ended = watched => ended,
        failure = Local::broken(&mut local.coordinator, &mut local.worker) => Err(failure),
    };
    local.stop().await;
    ended
}

/// A coordinator and a worker in this process.
struct Local {
    farm: Farm,
    coordinator: JoinHandle<anyhow::Result<()>>,
    worker: JoinHandle<Result<(), WorkerError>>,
    stop_coordinator: CancellationToken,
    stop_worker: CancellationToken,
    /// Removed at the end.
    _temporary: Option<TempDir>,
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
        let config = coordinator::Config::new(data);
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
        Ok(Self { farm, coordinator, worker, stop_coordinator, stop_worker, _temporary: temporary })
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

    /// Stop both parts, the worker first. What they would still have to say is of no interest.
    async fn stop(self) {
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
    }
}
