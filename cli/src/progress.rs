//! How far a job is, on standard error: a bar on a terminal, now and then a line elsewhere.

use std::{
    io::IsTerminal,
    time::{Duration, Instant},
};

use common::protocol::JobView;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Where there is no terminal: time between two lines.
const LINE_EVERY: Duration = Duration::from_secs(5);
const STEPS: u64 = 1000;

/// Shows how far a job is.
#[derive(Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    last: Instant,
}

impl Progress {
    /// Nothing shown yet.
    #[must_use]
    pub fn new() -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr_with_hz(10));
            // The template is a constant: it is right or the test below fails.
            let style = ProgressStyle::with_template("{bar:32} {msg}").unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.with_style(style.progress_chars("=> "))
        });
        Self { bar, last: Instant::now() }
    }

    /// Show the state of a job.
    pub fn show(&mut self, job: &JobView) {
        if let Some(bar) = &self.bar {
            bar.set_position((job.progress * STEPS as f64) as u64);
            bar.set_message(line(job));
        } else if self.last.elapsed() >= LINE_EVERY && !job.state.is_final() {
            self.last = Instant::now();
            eprintln!("{}", line(job));
        }
    }

    /// Take the bar away.
    pub fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Percent, samples a second, time left.
fn line(job: &JobView) -> String {
    let mut line = format!("{:3.0}%  {}samples/s", 100.0 * job.progress, si(job.samples_per_second));
    if let Some(seconds) = job.eta_seconds {
        line += &format!("  {} left", duration(seconds));
    }
    if let Some(error) = job.error {
        line += &format!("  error {}", percent(error));
    }
    if !matches!(job.state, common::job::JobState::Active) {
        line += &format!("  ({})", job.state);
    }
    line
}

/// A number with three digits and an SI prefix, and the space before the unit: `1.23 M`.
#[must_use]
pub fn si(value: f64) -> String {
    let (scaled, prefix) = match value.abs() {
        v if v >= 1e9 => (value / 1e9, "G"),
        v if v >= 1e6 => (value / 1e6, "M"),
        v if v >= 1e3 => (value / 1e3, "k"),
        _ => return format!("{value:.0} "),
    };
    let digits = if scaled.abs() < 9.995 { 2 } else { usize::from(scaled.abs() < 99.95) };
    format!("{scaled:.digits$} {prefix}")
}

/// A share as percent with two digits.
#[must_use]
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    let digits = if percent < 9.95 { 1 } else { 0 };
    format!("{percent:.digits$}%")
}

/// Seconds as people say them: `12 s`, `3 min 20 s`, `5 h 02 min`.
#[must_use]
pub fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match whole {
        0..10 => format!("{seconds:.1} s"),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_round_well() {
        for (value, text) in [(0.0, "0 "), (999.0, "999 "), (1234.0, "1.23 k"), (99_960.0, "100 k"), (2.5e6, "2.50 M")]
        {
            assert_eq!(si(value), text);
        }
        for (seconds, text) in
            [(0.04, "0.0 s"), (9.4, "9.4 s"), (59.7, "1 min 00 s"), (200.0, "3 min 20 s"), (18120.0, "5 h 02 min")]
        {
            assert_eq!(duration(seconds), text);
        }
        assert_eq!((percent(0.051), percent(0.123)), ("5.1%".into(), "12%".into()));
        assert!(ProgressStyle::with_template("{bar:32} {msg}").is_ok());
    }
}
