//! Distributions of a sample's luminance, all with mean 1.

use crate::stability::random::Random;

/// What a pixel's samples are drawn from; the mean is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Truth {
    /// 1/p with probability p, else 0: a light that few paths find.
    Bernoulli(f64),
    /// exp of a normal of this standard deviation: a product of many factors.
    Lognormal(f64),
    /// Many small contributions with a tail.
    Exponential,
    /// No noise at all.
    Constant,
    /// Uniform noise, and with this probability a spike of this height: a firefly.
    Spikes(f64, f64),
    /// Uniform within 1% of 1: what surrounds a lone noisy pixel.
    Quiet,
}

impl Truth {
    /// The truths of the study, and whether the pooled pilot of 576 samples can see their events.
    pub const STUDY: [(Truth, bool); 11] = [
        (Truth::Bernoulli(0.5), true),
        (Truth::Bernoulli(0.1), true),
        (Truth::Bernoulli(0.03), true),
        (Truth::Bernoulli(0.01), true),
        (Truth::Lognormal(0.5), true),
        (Truth::Lognormal(1.0), true),
        (Truth::Lognormal(1.5), true),
        (Truth::Exponential, true),
        (Truth::Constant, true),
        (Truth::Spikes(0.02, 20.0), true),
        (Truth::Spikes(1e-4, 2000.0), false),
    ];

    /// Those where the textbook rule holds, so that costs can be compared.
    pub const TEXTBOOK: [Truth; 5] = [
        Truth::Bernoulli(0.5),
        Truth::Lognormal(0.5),
        Truth::Lognormal(1.0),
        Truth::Lognormal(1.5),
        Truth::Exponential,
    ];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Truth::Bernoulli(p) => format!("Bernoulli {p}"),
            Truth::Lognormal(sigma) => format!("lognormal {sigma}"),
            Truth::Exponential => "exponential".into(),
            Truth::Constant => "constant".into(),
            Truth::Spikes(p, height) => format!("spikes of {height} at {p}"),
            Truth::Quiet => "quiet".into(),
        }
    }

    /// One sample.
    pub(crate) fn draw(self, random: &mut Random) -> f64 {
        match self {
            Truth::Bernoulli(p) => {
                if random.uniform() < p {
                    1.0 / p
                } else {
                    0.0
                }
            }
            Truth::Lognormal(sigma) => (sigma * random.normal() - 0.5 * sigma * sigma).exp(),
            Truth::Exponential => -(1.0 - random.uniform()).ln(),
            Truth::Constant => 1.0,
            Truth::Spikes(p, height) => {
                let spike = if random.uniform() < p { height } else { 0.0 };
                (2.0 * random.uniform() + spike) / (1.0 + p * height)
            }
            Truth::Quiet => 1.0 + 0.01 * (2.0 * random.uniform() - 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_truth_has_mean_one() {
        let mut random = Random::new(5);
        for truth in Truth::STUDY.into_iter().map(|(truth, _)| truth).chain([Truth::Quiet]) {
            let (n, mut sum, mut squares) = (400_000, 0.0, 0.0);
            for _ in 0..n {
                let x = truth.draw(&mut random);
                sum += x;
                squares += x * x;
            }
            let n = f64::from(n);
            let mean = sum / n;
            let error = ((squares / n - mean * mean) / n).sqrt();
            assert!((mean - 1.0).abs() <= 4.0 * error + 1e-12, "{}: {mean} +- {error}", truth.name());
        }
    }
}
