//! How the error of a job falls with the work spent on it: kept as it goes, and drawn.

use common::{
    job::{JobId, JobState, Quality},
    protocol::{Convergence, ConvergencePoint},
};
use plot::{Axis, Chart, Guide, Series, Style};

use super::{Service, lock, measure, view::foreseen};
use crate::{error::Failure, store::Write};

/// A point is kept when this much more work was done than at the last one: some 50 a decade.
const STEP: f64 = 1.05;

impl Service {
    /// Keep where a job stands, if it has gone on since the last time.
    pub(super) fn note_point(&self, id: JobId) {
        let Some(entry) = self.entry(id) else { return };
        let mut record = lock(&entry.record);
        let point = {
            let measure = lock(&entry.measure);
            let Some(error) = measure.error(measure::target(&record.quality)).filter(|&error| error > 0.0) else {
                return;
            };
            let work = measure.work;
            ConvergencePoint { cpu_seconds: work.cpu_seconds, samples: work.samples as f64, error }
        };
        let over = record.state.is_final();
        let news = |last: &ConvergencePoint| match over {
            true => last.cpu_seconds != point.cpu_seconds || last.error != point.error,
            false => point.cpu_seconds >= last.cpu_seconds * STEP,
        };
        if point.cpu_seconds > 0.0 && record.curve.last().is_none_or(news) {
            record.curve.push(point);
            drop(self.store.write(Write::Job(Box::new(record.clone()))));
        }
    }

    /// How the error of a job fell so far, and what is foreseen.
    ///
    /// # Errors
    /// There is no such job.
    pub fn convergence(&self, id: JobId) -> Result<Convergence, Failure> {
        let entry = self.entry(id).ok_or_else(|| Failure::NotFound(format!("job {id}")))?;
        let record = lock(&entry.record).clone();
        let target = measure::target(&record.quality);
        let going_on = matches!(record.state, JobState::Active | JobState::Paused);
        let end = if going_on { foreseen(&record, &lock(&entry.measure)) } else { None };
        let forecast = end.zip(record.curve.last()).map(|(end, last)| ConvergencePoint {
            cpu_seconds: end.cpu_seconds,
            samples: end.samples,
            // Without a target for it, the error falls as that of a mean does.
            error: match record.quality {
                Quality::Noise { relative_error, .. } => relative_error.min(last.error),
                _ => last.error * libm::sqrt((last.samples / end.samples).min(1.0)),
            },
        });
        let forecast = forecast.filter(|end| record.curve.last().is_none_or(|last| end.cpu_seconds > last.cpu_seconds));
        Ok(Convergence { points: record.curve, target, forecast })
    }

    /// The same as a chart.
    ///
    /// # Errors
    /// There is no such job.
    pub fn convergence_chart(&self, id: JobId) -> Result<String, Failure> {
        Ok(plot::svg_by_theme(&chart(&self.convergence(id)?)))
    }
}

fn chart(convergence: &Convergence) -> Chart {
    let Convergence { points, target, forecast } = convergence;
    let place = |point: &ConvergencePoint| (point.cpu_seconds, 100.0 * point.error);
    let mut series = vec![Series::new("measured", Style::Line, points.iter().map(place))];
    if let (Some(end), Some(last)) = (forecast, points.last()) {
        series.push(Series::new("forecast", Style::Line, [place(last), place(end)]));
    }
    let level = |&target: &f64| Guide::Level { y: 100.0 * target, label: format!("target {}%", 100.0 * target) };
    let mut notes = Vec::new();
    if points.is_empty() {
        notes.push("nothing is measured yet".into());
    }
    Chart {
        title: "Error that 99% of the pixels keep to, by the work spent".into(),
        x: Axis::log("processor time of all workers", "s"),
        y: Axis::log("half-width of the interval relative to the luminance", "%"),
        series,
        guides: target.iter().map(level).collect(),
        notes,
    }
}
