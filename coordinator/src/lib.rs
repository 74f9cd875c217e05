//! The coordinator: takes in jobs, gives out units, keeps what comes back, and puts pictures together.
//!
//! | Module | Is |
//! |---|---|
//! | [`farm`] | scheduling as a pure state machine: events in, effects out |
//! | [`plan`] | which samples a tile gets next; pure |
//! | [`store`] | what survives a restart, behind a trait |
//! | [`blobs`] | files by the hash of their bytes |
//! | [`assemble`] | films to pictures; pure |
//! | [`service`] | all of these put together; where time and async begin |
//! | [`http`] | the REST interface and the dashboard |
//!
//! It knows nothing of the tracer, of mesh formats, or of how a unit is rendered.

pub mod assemble;
pub mod blobs;
mod bridge;
mod config;
mod error;
pub mod farm;
pub mod http;
pub mod plan;
pub mod service;
pub mod store;
mod time;

use std::sync::Arc;

pub use config::{BadConfig, Config, STORE};
use tokio::net::TcpListener;

/// A coordinator without a socket.
#[derive(Clone)]
pub struct App {
    /// Its routes.
    pub router: axum::Router,
    /// What they call.
    pub service: Arc<service::Service>,
}

/// Open the data folder and build the routes.
///
/// # Errors
/// The data folder cannot be used.
pub async fn build_app(config: Config) -> anyhow::Result<App> {
    let service = service::Service::open(config).await?;
    Ok(App { router: http::router(Arc::clone(&service)), service })
}

/// Serve until `shutdown` is ready; then let go of long polls, write what was taken in, and return.
///
/// # Errors
/// The settings do not allow this address, the data folder cannot be used, or the socket failed.
pub async fn serve(
    config: Config,
    listener: TcpListener,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> anyhow::Result<()> {
    config.check(listener.local_addr()?)?;
    let App { router, service } = build_app(config).await?;
    let leaving = service.leaving.clone();
    let asked = {
        let leaving = leaving.clone();
        async move {
            tokio::select! {
                () = shutdown => {}
                () = leaving.cancelled() => {}
            }
            leaving.cancel();
        }
    };
    let served = axum::serve(listener, router).with_graceful_shutdown(asked).await;
    service.close().await;
    Ok(served?)
}
