//! Being told to stop.

/// Wait for Ctrl-C or, where there is such a thing, SIGTERM. From then on a second one ends the process
/// at once.
pub async fn shutdown() {
    one().await;
    tokio::spawn(async {
        one().await;
        std::process::exit(130);
    });
}

async fn one() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        // A handler that cannot be set leaves the default in place: the process ends.
        let Ok(mut terminate) = signal(SignalKind::terminate()) else { return std::future::pending().await };
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        }
    }
    #[cfg(not(unix))]
    {
        let _ = tokio::signal::ctrl_c().await;
    }
}
