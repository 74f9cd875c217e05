//! How far a chart is and how long it will take; silent where standard error is no terminal.

use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use crate::progress::duration;

/// A bar over work whose pieces cost what was learned of them.
pub struct Gauge {
    bar: ProgressBar,
    /// Wall seconds a sample of each kind of work; `None` until it was seen.
    rates: Vec<Option<(f64, f64)>>,
    /// Samples of each kind that are still to be taken.
    left: Vec<f64>,
    spent: f64,
    since: Instant,
}

const STEPS: u64 = 1000;

impl Gauge {
    /// Nothing done yet; `left` holds the samples that each kind of work will take.
    #[must_use]
    pub fn new(left: Vec<f64>) -> Self {
        let bar = ProgressBar::new(STEPS);
        // The template is a constant: it is right or the test below fails.
        let style = ProgressStyle::with_template(TEMPLATE).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.progress_chars("=> "));
        let rates = vec![None; left.len()];
        Self { bar, rates, left, spent: 0.0, since: Instant::now() }
    }

    /// What is being done.
    pub fn say(&mut self, what: &str) {
        self.bar.set_prefix(what.to_owned());
        self.since = Instant::now();
        self.show();
    }

    /// So many samples of one kind were taken since the last call.
    pub fn took(&mut self, kind: usize, samples: f64) {
        let seconds = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
        self.spent += seconds;
        let (sum, count) = self.rates[kind].unwrap_or_default();
        self.rates[kind] = Some((sum + seconds, count + samples));
        self.left[kind] = (self.left[kind] - samples).max(0.0);
        self.show();
    }

    /// So many samples of one kind need not be taken.
    pub fn skip(&mut self, kind: usize) {
        self.left[kind] = 0.0;
        self.show();
    }

    /// Seconds that are left, from what each kind of work has cost, and where it has not begun, from all others.
    fn seconds_left(&self) -> Option<f64> {
        let all = self.rates.iter().flatten().fold((0.0, 0.0), |(s, n), (seconds, count)| (s + seconds, n + count));
        let rate = |(seconds, samples): (f64, f64)| (samples > 0.0).then(|| seconds / samples);
        let usual = rate(all)?;
        let of = |(left, seen): (&f64, &Option<(f64, f64)>)| left * seen.and_then(rate).unwrap_or(usual);
        Some(self.left.iter().zip(&self.rates).map(of).sum())
    }

    fn show(&self) {
        let Some(left) = self.seconds_left() else { return };
        let share = self.spent / (self.spent + left).max(f64::MIN_POSITIVE);
        self.bar.set_position((share * STEPS as f64) as u64);
        self.bar.set_message(format!("{} left", duration(left)));
    }

    /// Take the bar away.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

const TEMPLATE: &str = "{bar:32} {percent:>3}%  {msg}  {prefix}";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_told_from_what_was_seen() {
        assert!(ProgressStyle::with_template(TEMPLATE).is_ok());
        let mut gauge = Gauge::new(vec![100.0, 50.0]);
        assert_eq!(gauge.seconds_left(), None);
        gauge.rates[0] = Some((2.0, 20.0));
        gauge.left[0] = 80.0;
        // 0.1 s a sample, taken for the other kind too until it is seen.
        assert!((gauge.seconds_left().unwrap() - 13.0).abs() < 1e-12);
        gauge.rates[1] = Some((10.0, 10.0));
        gauge.left[1] = 40.0;
        assert!((gauge.seconds_left().unwrap() - 48.0).abs() < 1e-12);
        gauge.skip(1);
        assert!((gauge.seconds_left().unwrap() - 8.0).abs() < 1e-12);
    }
}
