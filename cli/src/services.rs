//! `tessera coordinator` and `tessera worker`.

use std::time::Duration;

use coordinator::BadConfig;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;
use worker::Worker;

use crate::{
    args::{CoordinatorArgs, WorkerArgs},
    error::{Failure, reason},
    farm::{endpoint, token},
    output, signals,
};

/// How long a worker that leaves goes on with what it has begun.
const GRACE: Duration = Duration::from_secs(20);

/// Run `tessera coordinator` until it is told to stop.
///
/// # Errors
/// An address that needs a token, a port in use, or a data folder that cannot be used.
pub async fn coordinator(args: CoordinatorArgs) -> Result<(), Failure> {
    let config = coordinator::Config {
        token: token(args.token_file.as_deref())?,
        insecure: args.insecure,
        ..coordinator::Config::new(args.data)
    };
    config.check(args.listen).map_err(|error| {
        Failure::Input(match error {
            BadConfig::NoToken(address) => format!(
                "--listen {address} can be reached from other machines: give a token by --token-file or TESSERA_TOKEN, \
                 or let everybody in with --insecure"
            ),
            BadConfig::WeakToken => error.to_string(),
        })
    })?;
    output::folder(&config.data)?;
    let listen = args.listen;
    let cannot = |error: std::io::Error| Failure::Work(format!("--listen {listen}: {}", reason(&error)));
    let listener = TcpListener::bind(listen).await.map_err(cannot)?;
    let address = listener.local_addr().map_err(cannot)?;
    tracing::info!("listening on http://{address}/");
    let served = coordinator::serve(config, listener, signals::shutdown()).await;
    served.map_err(|error| Failure::Work(format!("{error:#}")))
}

/// Run `tessera worker` until it is told to stop.
///
/// # Errors
/// An address that cannot be used, or a coordinator that refuses the worker.
pub async fn worker(args: WorkerArgs) -> Result<(), Failure> {
    let token = token(args.connect.token_file.as_deref())?;
    let worker = Worker::new(worker::Config {
        endpoint: endpoint(&args.connect.coordinator, token.as_deref())?,
        machine: args.name.unwrap_or_else(machine),
        threads: threads(args.threads),
        cache: args.cache,
        grace: GRACE,
    })?;
    let shutdown = CancellationToken::new();
    let told = shutdown.clone();
    tokio::spawn(async move {
        signals::shutdown().await;
        tracing::info!("leaving: finishing what is begun");
        told.cancel();
    });
    Ok(worker.run(shutdown).await?)
}

/// Threads to render with: those asked for, or one a core.
#[must_use]
pub fn threads(asked: Option<u32>) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    asked.map_or_else(cores, |threads| threads as usize)
}

/// Name of this machine.
#[must_use]
pub fn machine() -> String {
    #[cfg(unix)]
    {
        rustix::system::uname().nodename().to_string_lossy().into_owned()
    }
    #[cfg(not(unix))]
    {
        std::env::var("COMPUTERNAME").unwrap_or_else(|_| "unknown".into())
    }
}
