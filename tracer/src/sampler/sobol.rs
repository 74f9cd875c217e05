//! Owen-scrambled Sobol' points, padded: every dimension takes its own scramble of the first two Sobol'
//! dimensions, with the points of the batch in an order of its own.
//!
//! The first two dimensions form a (0, m, 2)-net at every power of two, which pairs of higher ones do
//! not; at the batch sizes used here (16 by default) little is to be had from joint stratification of more
//! than two (Burley 2020, "Practical Hash-based Owen Scrambling").

use super::hash::unit;
use crate::math::Vec2;

/// Nested uniform scramble in the base-2 digits of `x`, least significant first: each bit is flipped by a
/// hash of the bits below it (Laine and Karras 2011, with the constants of Vegdahl 2021).
#[inline(always)]
fn scramble(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^ x.wrapping_mul(0x53A2_2864)
}

/// The second Sobol' dimension of point `i` with its bits reversed: Pascal's triangle modulo 2, applied in
/// log steps (Ahmed 2024, "An Implementation Algorithm of 2D Sobol Sequence Fast, Elegant, and Compact").
#[inline(always)]
fn pascal(mut i: u32) -> u32 {
    i ^= i >> 16;
    i ^= (i & 0xFF00_FF00) >> 8;
    i ^= (i & 0xF0F0_F0F0) >> 4;
    i ^= (i & 0xCCCC_CCCC) >> 2;
    i ^ (i & 0xAAAA_AAAA) >> 1
}

/// One number: point `i` of a scrambled van der Corput sequence.
#[inline(always)]
pub(super) fn one(i: u32, seed: u64) -> f32 {
    unit(scramble(i, (seed >> 32) as u32).reverse_bits())
}

/// A pair: point `i` of the first two Sobol' dimensions, each scrambled.
#[inline(always)]
pub(super) fn two(i: u32, seed: u64) -> Vec2 {
    let second = (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) as u32;
    let x = scramble(i, (seed >> 32) as u32).reverse_bits();
    let y = scramble(pascal(i), second).reverse_bits();
    Vec2::new(unit(x), unit(y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_steps_are_the_second_sobol_dimension() {
        // Its direction numbers by the recurrence of the primitive polynomial x + 1: v_k = v_(k-1) ^ v_(k-1) >> 1.
        let by_recurrence = |mut i: u32| {
            let (mut v, mut x) = (1u32 << 31, 0);
            while i != 0 {
                if i & 1 == 1 {
                    x ^= v;
                }
                v ^= v >> 1;
                i >>= 1;
            }
            x
        };
        for i in (0..1 << 16).chain((0..4096).map(|i: u32| i.wrapping_mul(0x9E37_79B9))) {
            assert_eq!(pascal(i).reverse_bits(), by_recurrence(i), "{i}");
        }
    }

    #[test]
    fn a_scrambled_bit_depends_on_lower_bits_alone() {
        for seed in [0, 1, 0xDEAD_BEEF, u32::MAX] {
            for x in (0..2000u32).map(|i| i.wrapping_mul(0x0101_6B55)) {
                for bit in 0..32 {
                    let changed = scramble(x, seed) ^ scramble(x ^ 1 << bit, seed);
                    assert_eq!(changed.trailing_zeros(), bit, "only bit {bit} and above may change, and it must");
                }
            }
        }
    }
}
