//! When a path may end at random, and how likely it is to go on.

use common::method::{FIXED_ROULETTE_SURVIVAL, LATE_ROULETTE_WEIGHT, Roulette};

use crate::math::Rgb;

/// Scatterings before throughput is looked at: the first bounces carry most of the light.
pub(super) const FIRST: u32 = 3;

/// Probability of going on after `depth` scatterings with this throughput (times eta^2); `None`: for certain.
///
/// Never above 1, and never below what the throughput has left: dividing by it brings the throughput to 1 at
/// most, so no path grows brighter than it began. Work and variance are in balance where all survivors carry
/// about the same (a weight window, Booth and Hendricks 1984); which weight is best depends on the scene.
#[inline]
#[must_use]
pub fn survival(rule: Roulette, depth: u32, throughput: Rgb) -> Option<f32> {
    match rule {
        Roulette::Off => None,
        Roulette::Fixed => Some(FIXED_ROULETTE_SURVIVAL),
        Roulette::Throughput | Roulette::Late => below(weight_window(rule)?, depth, throughput),
    }
}

/// The throughput below which paths are at risk, under the rules that look at it.
#[inline]
#[must_use]
pub(super) fn weight_window(rule: Roulette) -> Option<f32> {
    match rule {
        Roulette::Off | Roulette::Fixed => None,
        Roulette::Throughput => Some(1.0),
        Roulette::Late => Some(LATE_ROULETTE_WEIGHT),
    }
}

/// Survival that brings throughput below `weight` up to it.
#[inline]
fn below(weight: f32, depth: u32, throughput: Rgb) -> Option<f32> {
    let share = throughput.max_element() / weight;
    (depth > FIRST && share < 1.0).then_some(share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_throughput_below_one_after_the_third_bounce_is_at_risk() {
        let dim = Rgb::new(0.1, 0.4, 0.2);
        assert_eq!(survival(Roulette::Throughput, 3, dim), None);
        assert_eq!(survival(Roulette::Throughput, 4, dim), Some(0.4));
        assert_eq!(survival(Roulette::Throughput, 9, Rgb::new(0.1, 1.0, 3.0)), None);
        assert_eq!(survival(Roulette::Late, 4, dim), None);
        assert_eq!(survival(Roulette::Late, 4, 0.5 * dim), Some(0.5));
        assert_eq!(survival(Roulette::Late, 3, 0.5 * dim), None);
        assert_eq!(survival(Roulette::Fixed, 1, Rgb::ONE), Some(0.7));
        assert_eq!(survival(Roulette::Off, 100, dim), None);
    }
}
