//! The farm over time: how much waits, how fast it is rendered, who has something to do.

use std::collections::VecDeque;

use common::protocol::{FarmMoment, FarmView, WorkerView};
use plot::{Axis, Chart, Series, Style};

use super::{Service, lock};
use crate::{error::Failure, time::unix};

/// Seconds between two moments.
const EVERY: f64 = 5.0;
/// Moments kept: an hour.
const KEPT: usize = 720;

/// What is kept of the past.
#[derive(Debug, Default)]
pub(super) struct History {
    moments: VecDeque<FarmMoment>,
    last: Option<f64>,
}

impl Service {
    /// Keep the present moment, if the last one is long enough ago.
    pub(super) fn note_moment(&self) {
        let now = self.now();
        let mut history = lock(&self.history);
        if history.last.is_some_and(|last| now - last < EVERY) {
            return;
        }
        history.last = Some(now);
        let (units_pending, units_leased) = self.farm().queue();
        let workers = self.worker_views();
        if history.moments.len() == KEPT {
            history.moments.pop_front();
        }
        history.moments.push_back(FarmMoment {
            at: unix(),
            units_pending,
            units_leased,
            samples_per_second: workers.iter().map(|worker| worker.samples_per_second).sum(),
            busy: busy(&workers),
        });
    }

    /// The farm now, and over the last hour.
    #[must_use]
    pub fn farm_view(&self) -> FarmView {
        let mut view = FarmView {
            version: env!("CARGO_PKG_VERSION").into(),
            units_pending: 0,
            units_leased: 0,
            jobs: Default::default(),
            workers: Default::default(),
            history: lock(&self.history).moments.iter().copied().collect(),
        };
        {
            let farm = self.farm();
            (view.units_pending, view.units_leased) = farm.queue();
            for state in farm.jobs().filter_map(|id| farm.job_state(id)) {
                *view.jobs.entry(state.name().into()).or_default() += 1;
            }
        }
        for worker in self.worker_views() {
            *view.workers.entry(worker.state).or_default() += 1;
        }
        view
    }

    /// A chart of the last hour: `queue`, `throughput` or `busy`.
    ///
    /// # Errors
    /// There is no such chart.
    pub fn farm_chart(&self, name: &str) -> Result<String, Failure> {
        let moments: Vec<FarmMoment> = lock(&self.history).moments.iter().copied().collect();
        let end = moments.last().map_or(0.0, |last| last.at);
        let minutes = |moment: &FarmMoment| (moment.at - end) / 60.0;
        let curve = |name: &str, value: fn(&FarmMoment) -> f64| {
            Series::new(name, Style::Curve, moments.iter().map(|moment| (minutes(moment), value(moment))))
        };
        let highest = |series: &[Series], least: f64| {
            let values = series.iter().flat_map(|series| &series.points).map(|point| point.y);
            1.05 * values.fold(least, f64::max)
        };
        let (title, y, series, high) = match name {
            "queue" => {
                let series = vec![
                    curve("waiting for a worker", |m| m.units_pending as f64),
                    curve("held by workers", |m| m.units_leased as f64),
                ];
                let high = highest(&series, 10.0);
                ("Units in the queue", Axis::linear("units", ""), series, high)
            }
            "throughput" => {
                let series = vec![curve("all workers", |m| 1e-6 * m.samples_per_second)];
                let high = highest(&series, 0.1);
                ("Samples a second", Axis::linear("samples", "million/s"), series, high)
            }
            "busy" => {
                let series = vec![curve("threads whose worker holds a lease", |m| 100.0 * m.busy)];
                ("Busy share of the workers", Axis::linear("busy", "%"), series, 105.0)
            }
            _ => return Err(Failure::NotFound(format!("chart \"{name}\" of the farm"))),
        };
        let since = moments.first().map_or(-1.0, |first| minutes(first).min(-1.0));
        Ok(plot::svg(&Chart {
            title: title.into(),
            x: Axis::linear("time, from now", "min").between(since, 0.0),
            y: y.between(0.0, high),
            series,
            ..Chart::default()
        }))
    }
}

/// Share of the present workers' threads whose worker holds a lease.
fn busy(workers: &[WorkerView]) -> f64 {
    let threads = |states: &[&str]| -> f64 {
        let of = workers.iter().filter(|worker| states.contains(&worker.state.as_str()));
        of.map(|worker| f64::from(worker.threads)).sum()
    };
    let all = threads(&["idle", "busy"]);
    if all > 0.0 { threads(&["busy"]) / all } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_busy_share_counts_threads_of_workers_that_may_work() {
        let worker = |state: &str, threads: u32| WorkerView {
            id: common::job::WorkerId(1),
            machine: String::new(),
            state: state.into(),
            threads,
            cpu_features: Vec::new(),
            tracer: String::new(),
            samples_per_second: 0.0,
            units: 0,
            failures: 0,
            last_seen_seconds: 0.0,
            leased: 0,
            samples_per_second_before: 0.0,
            lease: None,
            prepared: Vec::new(),
        };
        assert_eq!(busy(&[]), 0.0);
        assert_eq!(busy(&[worker("busy", 3), worker("idle", 1), worker("lost", 8)]), 0.75);
    }
}
