//! The half-width of a pixel's interval: Student's quantile times the standard error.
//!
//! For what is shown, from a pixel's own batches alone; what stops a pixel is [`common::adaptive`].

use common::{
    adaptive::{FLOOR, student_quantile},
    film::Moments,
};

/// Two-sided quantiles of Student's t at one confidence, by degrees of freedom; worked out when first asked.
#[derive(Debug)]
pub struct Quantiles {
    confidence: f64,
    tabled: Vec<f64>,
}

/// From here on quantiles are taken at the next lower power of two: less than 0.1% too wide.
const EXACT: u32 = 1024;

impl Quantiles {
    /// Quantiles t with P(|T| <= t) = `confidence`, between 0 and 1.
    #[must_use]
    pub fn new(confidence: f64) -> Self {
        Self { confidence, tabled: Vec::new() }
    }

    /// The quantile with `freedom` degrees of freedom, at least 1.
    pub fn at(&mut self, freedom: u32) -> f64 {
        let freedom = match freedom.max(1) {
            n if n <= EXACT => n,
            n => 1 << (31 - n.leading_zeros()),
        };
        let index = match freedom {
            n if n <= EXACT => n as usize,
            n => EXACT as usize + (31 - n.leading_zeros()) as usize,
        };
        if self.tabled.len() <= index {
            self.tabled.resize(index + 1, 0.0);
        }
        if self.tabled[index] == 0.0 {
            self.tabled[index] = student_quantile(0.5 + 0.5 * self.confidence, f64::from(freedom));
        }
        self.tabled[index]
    }

    /// Half-width of the interval of a pixel's luminance: 0 where it is known, `None` with fewer than two
    /// batches.
    pub fn half_width(&mut self, moments: &Moments) -> Option<f64> {
        if moments.known {
            return Some(0.0);
        }
        moments.standard_error().map(|error| error * self.at(moments.batches - 1))
    }
}

/// Half-width relative to the luminance, or to the rule's floor where that is larger.
#[must_use]
pub fn relative(half_width: f64, luminance: f64) -> f64 {
    half_width / luminance.abs().max(FLOOR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_the_tabled_ones() {
        // Abramowitz and Stegun, table 26.10.
        let mut q95 = Quantiles::new(0.95);
        for (freedom, expected) in [(1, 12.706), (3, 3.182), (10, 2.228), (30, 2.042), (120, 1.980)] {
            assert!((q95.at(freedom) - expected).abs() < 1e-3, "{freedom}: {}", q95.at(freedom));
        }
        assert!((q95.at(1 << 20) - 1.95996).abs() < 1e-4);
        assert!((Quantiles::new(0.99).at(10) - 3.169).abs() < 1e-3);
    }

    #[test]
    fn quantiles_shrink_with_more_degrees_of_freedom() {
        let mut quantiles = Quantiles::new(0.95);
        let values: Vec<f64> = (1..3000).map(|n| quantiles.at(n)).collect();
        assert!(values.windows(2).all(|w| w[1] <= w[0]));
    }

    #[test]
    fn one_batch_has_no_interval_and_dark_pixels_are_held_against_the_floor() {
        let mut quantiles = Quantiles::new(0.95);
        assert_eq!(quantiles.half_width(&Moments::batch(16, [1.0; 3])), None);
        assert_eq!(relative(0.001, 0.0), 0.001 / FLOOR);
        assert_eq!(relative(0.5, 2.0), 0.25);
    }
}
