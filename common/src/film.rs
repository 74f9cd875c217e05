//! What is known of a pixel: sample count, mean and spread, and how parts of it merge.

use crate::luminance;

/// Running moments of one pixel, in f64.
///
/// Samples arrive in batches whose means are independent of each other, so the spread between batch
/// means gives an honest variance of the mean while each batch keeps what quasi-Monte Carlo gains
/// inside it. Batches may differ in size (the last one of a fixed count); `m2` weights each by its
/// samples, which keeps the estimate unbiased for independent samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    /// Samples taken.
    pub samples: u32,
    /// Batches they came in.
    pub batches: u32,
    /// Mean radiance, linear RGB.
    pub mean: [f64; 3],
    /// Sum over batches of (samples in the batch) x (luminance of its mean - luminance of the mean)^2.
    pub m2: f64,
    /// Sum over samples of (luminance - luminance of its batch's mean)^2: what the same samples would vary by if
    /// they were independent, which tells luck from evenness where all batches came out alike.
    pub within: f64,
    /// Whether every sample so far missed the scene or ended on a light it saw directly, with nothing
    /// estimated on the way: then a spread of zero is knowledge, not luck.
    pub known: bool,
    /// Whether a pass gave it nothing: a pixel that stopped stays so, whatever its neighbours do later. Set
    /// by [`Moments::after_pass`], never by [`Moments::merge`].
    pub stopped: bool,
}

impl Moments {
    /// One batch: its number of samples and its mean.
    #[must_use]
    pub fn batch(samples: u32, mean: [f64; 3]) -> Self {
        Self { samples, batches: 1, mean, m2: 0.0, within: 0.0, known: false, stopped: false }
    }

    /// Add `other` after `self` (Chan, Golub and LeVeque 1983). The order is part of the bits.
    #[must_use]
    pub fn merge(self, other: Moments) -> Moments {
        if self.samples == 0 {
            return other;
        }
        if other.samples == 0 {
            return self;
        }
        let (na, nb) = (f64::from(self.samples), f64::from(other.samples));
        let n = na + nb;
        let mut mean = self.mean;
        for (m, o) in mean.iter_mut().zip(other.mean) {
            *m += (o - *m) * (nb / n);
        }
        let delta = luminance(other.mean) - luminance(self.mean);
        Moments {
            samples: self.samples + other.samples,
            batches: self.batches + other.batches,
            mean,
            m2: self.m2 + other.m2 + delta * delta * (na * nb / n),
            within: self.within + other.within,
            known: self.known && other.known,
            stopped: self.stopped || other.stopped,
        }
    }

    /// Add what a later pass gave this pixel; if that is nothing, it has stopped.
    #[must_use]
    pub fn after_pass(self, later: Moments) -> Moments {
        Moments { stopped: self.stopped || later.samples == 0, ..self.merge(later) }
    }

    /// Variance of a single sample's luminance about the mean of its batch; 0 where no batch has two.
    #[must_use]
    pub fn variance_within(&self) -> f64 {
        if self.samples > self.batches { self.within / f64::from(self.samples - self.batches) } else { 0.0 }
    }

    /// Luminance of the mean.
    #[must_use]
    pub fn luminance(&self) -> f64 {
        luminance(self.mean)
    }

    /// Estimated variance of the mean luminance; `None` with fewer than two batches, where nothing is
    /// known of it.
    #[must_use]
    pub fn variance_of_mean(&self) -> Option<f64> {
        (self.batches >= 2).then(|| self.m2 / (f64::from(self.batches - 1) * f64::from(self.samples)))
    }

    /// Standard error of the mean luminance; `None` with fewer than two batches.
    #[must_use]
    pub fn standard_error(&self) -> Option<f64> {
        self.variance_of_mean().map(f64::sqrt)
    }
}

/// First-hit features of a pixel, averaged over the samples of its first pass.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Features {
    /// Diffuse-like reflectance of the first hit, 0 to 1.
    pub albedo: [f32; 3],
    /// World-space shading normal of the first hit, shorter than 1 where it varies.
    pub normal: [f32; 3],
    /// Distance to the first hit along the camera's axis, scene units; mean over samples that hit.
    pub depth: f32,
}

/// Everything known of a rectangle's pixels, in row order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Film {
    /// Moments, one a pixel.
    pub moments: Vec<Moments>,
    /// Features, one a pixel, or empty before the first pass.
    pub features: Vec<Features>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(values: &[f64]) -> Moments {
        values.iter().fold(Moments::default(), |sum, &v| sum.merge(Moments::batch(1, [v; 3])))
    }

    #[test]
    fn agrees_with_the_two_pass_formula_where_the_textbook_sum_of_squares_fails() {
        // Spread / mean = 1e-4 over 1,024 values: s2 - s1^2/n in f32 is off by several times here.
        let values: Vec<f64> = (0..1024).map(|i| 1.0 + 1e-4 * f64::from(i % 7 - 3)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
        let moments = of(&values);
        assert!((moments.mean[0] - mean).abs() < 1e-14);
        assert!((moments.variance_of_mean().unwrap() / (variance / n) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn one_batch_says_nothing_of_its_error() {
        assert_eq!(Moments::batch(16, [1.0; 3]).standard_error(), None);
        assert_eq!(Moments::default().standard_error(), None);
    }

    #[test]
    fn unequal_batches_weigh_by_their_samples() {
        let merged = Moments::batch(3, [1.0; 3]).merge(Moments::batch(1, [5.0; 3]));
        assert_eq!(merged.mean, [2.0; 3]);
        // 3 (1-2)^2 + 1 (5-2)^2 = 12, over (2-1) x 4.
        assert!((merged.variance_of_mean().unwrap() - 3.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn merging_parts_agrees_with_one_by_one(values in prop::collection::vec(0.0f64..10.0, 2..60), cut in 0usize..60) {
            let cut = cut.min(values.len());
            let (whole, parts) = (of(&values), of(&values[..cut]).merge(of(&values[cut..])));
            prop_assert_eq!(whole.samples, parts.samples);
            prop_assert!((whole.mean[1] - parts.mean[1]).abs() < 1e-12);
            prop_assert!((whole.m2 - parts.m2).abs() < 1e-9);
        }
    }
}
