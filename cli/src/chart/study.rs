//! What was measured of each method, and what follows from it: means, spreads, bias, efficiency.

use common::adaptive::student_quantile;
use serde::Serialize;

use super::reference::Distance;

/// One picture.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// Samples of a pixel that were to be spent.
    pub budget: u32,
    /// Number of the seed.
    pub seed: u64,
    /// Samples of a pixel that were spent, on average.
    pub samples: f64,
    /// Processor seconds.
    pub cpu_seconds: f64,
    /// How far it is from the reference.
    pub distance: Distance,
}

/// A method and what was measured of it.
#[derive(Debug, Clone)]
pub struct Tried {
    /// As it was named.
    pub name: String,
    /// The method, every choice made.
    pub method: common::method::Method,
    /// Reading the scene and building its trees, seconds.
    pub build_seconds: f64,
    /// Number of its reference.
    pub reference: usize,
    /// Pictures, seed by seed.
    pub shots: Vec<Shot>,
    /// relMSE that more samples would not take away, and its standard error, at the largest budget.
    pub lasting: (f64, f64),
}

/// A figure with a 95% interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// Low end.
    pub low: f64,
    /// High end.
    pub high: f64,
}

/// The pictures of one budget, over all seeds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Level {
    /// Samples of a pixel that were to be spent.
    pub budget: u32,
    /// Samples of a pixel that were spent.
    pub samples: f64,
    /// Mean processor seconds.
    pub cpu_seconds: f64,
    /// Mean relMSE, its least and its largest over the seeds.
    pub relmse: Spread,
    /// Mean RMSE.
    pub rmse: f64,
    /// Mean of the signed relative differences of the frame's mean.
    pub bias: f64,
    /// Its standard error from the spread over seeds.
    pub bias_error: f64,
    /// Mean FLIP.
    pub flip: f64,
    /// 1 / (relMSE x seconds), of the means.
    pub efficiency: f64,
    /// Standard error of the efficiency's logarithm.
    #[serde(skip)]
    pub efficiency_error: f64,
}

/// A mean, and what it is the mean of lies between.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Least.
    pub low: f64,
    /// Largest.
    pub high: f64,
}

impl Tried {
    /// By budget, ascending.
    #[must_use]
    pub fn levels(&self) -> Vec<Level> {
        let mut budgets: Vec<u32> = self.shots.iter().map(|shot| shot.budget).collect();
        budgets.sort_unstable();
        budgets.dedup();
        budgets.into_iter().map(|budget| self.level(budget)).collect()
    }

    fn level(&self, budget: u32) -> Level {
        let shots: Vec<&Shot> = self.shots.iter().filter(|shot| shot.budget == budget).collect();
        let n = shots.len() as f64;
        let values = |of: &dyn Fn(&Shot) -> f64| -> Vec<f64> { shots.iter().map(|shot| of(shot)).collect() };
        let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
        // Standard error of the mean.
        let error = |values: &[f64]| {
            let middle = mean(values);
            (values.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / (n - 1.0).max(1.0) / n).sqrt()
        };
        let (relmse, seconds) = (values(&|shot| shot.distance.relmse), values(&|shot| shot.cpu_seconds));
        let bias = values(&|shot| shot.distance.bias);
        let relative = |values: &[f64]| error(values) / mean(values).abs().max(f64::MIN_POSITIVE);
        Level {
            budget,
            samples: mean(&values(&|shot| shot.samples)),
            cpu_seconds: mean(&seconds),
            relmse: Spread {
                mean: mean(&relmse),
                low: relmse.iter().copied().fold(f64::INFINITY, f64::min),
                high: relmse.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            },
            rmse: mean(&values(&|shot| shot.distance.rmse)),
            bias: mean(&bias),
            bias_error: error(&bias),
            flip: mean(&values(&|shot| shot.distance.flip)),
            efficiency: 1.0 / (mean(&relmse) * mean(&seconds)),
            efficiency_error: relative(&relmse).hypot(relative(&seconds)),
        }
    }

    /// Signed relative difference of the frame's mean, all pictures together, weighted by their samples, with its 95%
    /// interval. `reference` is the standard error of the reference's own mean.
    ///
    /// The variance of a picture's mean falls as 1/n: so the pictures of all budgets tell it together.
    #[must_use]
    pub fn bias(&self, reference: f64) -> Estimate {
        let weight: f64 = self.shots.iter().map(|shot| shot.samples).sum();
        let value = self.shots.iter().map(|shot| shot.samples * shot.distance.bias).sum::<f64>() / weight;
        let levels = self.levels();
        let of =
            |shot: &Shot| levels.iter().find(|level| level.budget == shot.budget).map_or(value, |level| level.bias);
        let squares: f64 = self.shots.iter().map(|shot| shot.samples * (shot.distance.bias - of(shot)).powi(2)).sum();
        let freedom = self.shots.len() as f64 - levels.len() as f64;
        let error = (squares / freedom.max(1.0) / weight).sqrt().hypot(reference);
        let half = student_quantile(0.975, freedom.max(1.0)) * error;
        Estimate { value, low: value - half, high: value + half }
    }

    /// Number of seeds.
    #[must_use]
    pub fn seeds(&self) -> usize {
        let last = self.shots.last().map_or(0, |shot| shot.budget);
        self.shots.iter().filter(|shot| shot.budget == last).count()
    }

    /// How many times as efficient it is as `other`, at the largest budget that both were given, with its 95%
    /// interval over seeds.
    #[must_use]
    pub fn against(&self, other: &Tried) -> Option<Estimate> {
        let (ours, theirs) = (self.levels(), other.levels());
        let (a, b) = ours.iter().rev().find_map(|a| theirs.iter().find(|b| b.budget == a.budget).map(|b| (a, b)))?;
        let value = a.efficiency / b.efficiency;
        if std::ptr::eq(self, other) {
            return Some(Estimate { value, low: value, high: value });
        }
        let freedom = (self.seeds() + other.seeds()).saturating_sub(2).max(1) as f64;
        let factor = (student_quantile(0.975, freedom) * a.efficiency_error.hypot(b.efficiency_error)).exp();
        Some(Estimate { value, low: value / factor, high: value * factor })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use common::method::Method;

    use super::*;

    /// A method whose pictures have these (budget, seconds, relMSE, bias).
    pub fn tried(name: &str, shots: &[(u32, f64, f64, f64)]) -> Tried {
        let shot = |(seed, &(budget, cpu_seconds, relmse, bias)): (usize, &(u32, f64, f64, f64))| Shot {
            budget,
            seed: seed as u64,
            samples: f64::from(budget),
            cpu_seconds,
            distance: Distance { relmse, relmse_plain: relmse, rmse: relmse.sqrt(), bias, flip: 0.1 },
        };
        Tried {
            name: name.into(),
            method: Method::default(),
            build_seconds: 0.5,
            reference: 0,
            shots: shots.iter().enumerate().map(shot).collect(),
            lasting: (0.0, 1e-6),
        }
    }

    #[test]
    fn a_method_ten_times_as_quick_is_ten_times_as_efficient() {
        let slow = tried("slow", &[(4, 1.0, 0.4, 0.0), (16, 4.0, 0.1, 0.0), (16, 4.0, 0.1, 0.0), (64, 9.0, 1.0, 0.0)]);
        let quick = tried("quick", &[(4, 0.1, 0.4, 0.0), (16, 0.4, 0.1, 0.0), (16, 0.4, 0.1, 0.0)]);
        let found = quick.against(&slow).unwrap();
        assert!((found.value - 10.0).abs() < 1e-9, "at 16, which both have: {found:?}");
        assert!((found.low - 10.0).abs() < 1e-6 && (found.high - 10.0).abs() < 1e-6, "no spread: {found:?}");
        let levels = quick.levels();
        assert_eq!(levels.iter().map(|level| level.budget).collect::<Vec<_>>(), [4, 16]);
        assert!((levels[1].efficiency - 25.0).abs() < 1e-9);
    }

    #[test]
    fn efficiency_is_of_the_means_and_its_interval_of_their_spread() {
        let steady = tried("steady", &[(4, 1.0, 0.1, 0.0), (4, 1.0, 0.1, 0.0)]);
        let spread = tried("spread", &[(4, 1.0, 0.05, 0.0), (4, 1.0, 0.15, 0.0)]);
        let found = spread.against(&steady).unwrap();
        assert!((found.value - 1.0).abs() < 1e-12);
        // Standard error .05 of .1, and Student's quantile of 2 degrees of freedom: 4.303.
        assert!((found.high - (4.3027f64 * 0.5).exp()).abs() < 1e-3, "{found:?}");
        assert!((found.low * found.high - 1.0).abs() < 1e-9);
        assert_eq!(spread.levels()[0].relmse, Spread { mean: 0.1, low: 0.05, high: 0.15 });
    }

    #[test]
    fn bias_is_weighed_by_samples_and_knows_the_references_error() {
        let method = tried("m", &[(1, 1.0, 0.1, 0.3), (1, 1.0, 0.1, 0.1), (3, 1.0, 0.1, 0.1), (3, 1.0, 0.1, 0.1)]);
        let found = method.bias(0.0);
        // (.3 + .1 + 3 x .1 + 3 x .1) / 8.
        assert!((found.value - 0.125).abs() < 1e-12);
        // Squares .01 + .01 over 2 degrees of freedom and 8 samples: .0353553, times 4.303.
        assert!((found.high - found.value - 4.3027 * 0.035_355_3).abs() < 1e-4, "{found:?}");
        assert!(method.bias(0.1).high > found.high + 0.2);
    }
}
