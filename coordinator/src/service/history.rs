//! The farm over time: how much waits, how fast it is rendered, who has something to do.

use std::collections::VecDeque;

use common::protocol::{FarmMoment, FarmView, WorkerView};
use plot::{Axis, Chart, Series, Style};

use super::{Service, lock};
use crate::{error::Failure, store::Write, time::unix};

/// Seconds between two moments.
const EVERY: f64 = 5.0;
/// How long moments are kept, seconds: an hour.
const KEPT: f64 = 3600.0;

/// What is kept of the past.
#[derive(Debug, Default)]
pub(super) struct History {
    moments: VecDeque<FarmMoment>,
    /// When the last was, by the clock that never runs backwards.
    last: Option<f64>,
    /// The last ones that are not stored yet.
    unsaved: Vec<FarmMoment>,
}

impl From<Vec<FarmMoment>> for History {
    /// What was stored, before a restart perhaps.
    fn from(stored: Vec<FarmMoment>) -> Self {
        let mut history = Self { moments: stored.into(), ..Self::default() };
        history.forget(unix());
        history
    }
}

impl History {
    fn push(&mut self, moment: FarmMoment) {
        self.moments.push_back(moment);
        self.unsaved.push(moment);
        self.forget(moment.at);
    }

    /// Forget what is too old; and what is yet to come, because the machine's clock was set back.
    fn forget(&mut self, now: f64) {
        self.moments.retain(|moment| moment.at >= now - KEPT && moment.at <= now);
    }
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
        history.push(FarmMoment {
            at: unix(),
            units_pending,
            units_leased,
            samples_per_second: workers.iter().map(|worker| worker.samples_per_second).sum(),
            busy: busy(&workers),
        });
    }

    /// Store the moments since the last time.
    pub(super) fn save_moments(&self) {
        let unsaved = std::mem::take(&mut lock(&self.history).unsaved);
        if let Some(last) = unsaved.last() {
            let oldest = last.at - KEPT;
            drop(self.store.write(Write::Moments(unsaved, oldest)));
        }
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
            // While there was no coordinator, nothing is known: the curve has a gap.
            let mut points = Vec::with_capacity(moments.len());
            let mut before = f64::INFINITY;
            for moment in &moments {
                if moment.at - before > 3.0 * EVERY {
                    points.push((minutes(moment), f64::NAN));
                }
                before = moment.at;
                points.push((minutes(moment), value(moment)));
            }
            Series::new(name, Style::Curve, points)
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
        Ok(plot::svg_by_theme(&Chart {
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
    fn the_past_comes_back_as_far_as_it_is_not_too_old() {
        let now = unix();
        let moment = |at: f64| FarmMoment { at, units_pending: 0, units_leased: 0, samples_per_second: 0.0, busy: 0.0 };
        let mut history = History::from(vec![moment(now - 3700.0), moment(now - 3000.0), moment(now + 100.0)]);
        history.push(moment(now + 1.0));
        let times: Vec<f64> = history.moments.iter().map(|moment| moment.at).collect();
        assert_eq!(times, [now - 3000.0, now + 1.0]);
        assert_eq!(history.unsaved.len(), 1, "what was stored is not stored again");
        history.push(moment(now + 700.0));
        assert_eq!(history.moments.len(), 2);
    }

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
