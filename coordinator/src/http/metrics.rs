//! Liveness, readiness, and figures in the text format of Prometheus.

use std::{collections::BTreeMap, fmt::Write, sync::atomic::Ordering};

use axum::{extract::State, http::header, response::IntoResponse};

use super::Shared;
use crate::error::Failure;

/// Whether it lives
#[utoipa::path(get, path = "/healthz", tag = "service",
    responses((status = 200, description = "It does.", content_type = "text/plain")))]
pub(super) async fn health() -> &'static str {
    "ok\n"
}

/// Whether it takes requests
#[utoipa::path(get, path = "/readyz", tag = "service",
    responses((status = 200, description = "It does.", content_type = "text/plain")))]
pub(super) async fn ready(State(service): Shared) -> Result<&'static str, Failure> {
    if service.leaving.is_cancelled() { Err(Failure::Leaving) } else { Ok("ready\n") }
}

/// Figures in the text format of Prometheus
#[utoipa::path(get, path = "/metrics", tag = "service",
    responses((status = 200, description = "The figures.", content_type = "text/plain")))]
pub(super) async fn metrics(State(service): Shared) -> impl IntoResponse {
    let (counters, (pending, leased), jobs) = {
        let farm = service.farm();
        let mut jobs: BTreeMap<&'static str, u64> = BTreeMap::new();
        for state in farm.jobs().filter_map(|id| farm.job_state(id)) {
            *jobs.entry(state.name()).or_default() += 1;
        }
        (farm.counters(), farm.queue(), jobs)
    };
    let mut workers: BTreeMap<String, (u64, u64)> = BTreeMap::new();
    for worker in service.worker_views() {
        let (count, threads) = workers.entry(worker.state).or_default();
        *count += 1;
        *threads += u64::from(worker.threads);
    }
    let tallies = service.tallies();
    let mut out = String::new();
    let mut figure = |name: &str, kind: &str, help: &str, values: &[(String, f64)]| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "# HELP tessera_{name} {help}\n# TYPE tessera_{name} {kind}");
        for (labels, value) in values {
            let _ = writeln!(out, "tessera_{name}{labels} {value}");
        }
    };
    let one = |value: u64| vec![(String::new(), value as f64)];
    let state = |state: &str, value: u64| (format!("{{state=\"{state}\"}}"), value as f64);
    let build = format!("{{version=\"{}\"}}", env!("CARGO_PKG_VERSION"));
    figure("build_info", "gauge", "Version of this coordinator.", &[(build, 1.0)]);
    figure("jobs", "gauge", "Jobs by state.", &jobs.iter().map(|(s, &n)| state(s, n)).collect::<Vec<_>>());
    let counts: Vec<_> = workers.iter().map(|(s, &(n, _))| state(s, n)).collect();
    figure("workers", "gauge", "Workers by state.", &counts);
    let threads: Vec<_> = workers.iter().map(|(s, &(_, n))| state(s, n)).collect();
    figure("worker_threads", "gauge", "Threads of workers by the workers' state.", &threads);
    figure("units_pending", "gauge", "Units waiting for a worker.", &one(pending));
    figure("units_leased", "gauge", "Units that workers hold.", &one(leased));
    for (name, help, value) in [
        ("leases_total", "Leases given.", counters.leases),
        ("units_leased_total", "Units given to workers, duplicates among them.", counters.units_leased),
        ("units_duplicated_total", "Units given to a second worker.", counters.duplicated),
        ("results_accepted_total", "Results that counted.", counters.accepted),
        ("results_closed_total", "Results that came late or twice.", counters.closed),
        ("results_refused_total", "Results that were malformed.", tallies.refused_results.load(Ordering::Relaxed)),
        ("result_bytes_total", "Bytes of results taken in.", tallies.result_bytes.load(Ordering::Relaxed)),
        ("samples_total", "Camera samples that counted.", tallies.samples.load(Ordering::Relaxed)),
        ("units_failed_total", "Units that failed on a worker.", counters.failed),
        ("units_lost_total", "Units lost with a worker or an expired lease.", counters.lost),
        ("units_returned_total", "Units handed back.", counters.returned),
        ("workers_lost_total", "Workers that fell silent.", counters.workers_lost),
    ] {
        figure(name, "counter", help, &one(value));
    }
    let spent = tallies.cpu_microseconds.load(Ordering::Relaxed) as f64 * 1e-6;
    figure(
        "render_cpu_seconds_total",
        "counter",
        "Processor seconds of the results that counted.",
        &[(String::new(), spent)],
    );
    figure("starts", "gauge", "Starts of this coordinator's record.", &one(service.epoch()));
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], out)
}
