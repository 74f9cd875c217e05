//! Jittered strata: a batch is cut into as many cells as it has points, anew for every dimension.

use super::{
    hash::{mix, unit},
    permute::permute,
};
use crate::math::Vec2;

/// How a batch is cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Strata {
    batch: u32,
    columns: u32,
    rows: u32,
}

impl Strata {
    /// The grid nearest to a square with at least `batch` cells. Where cells are left over, which ones is
    /// chosen at random, so that every point is still uniform.
    pub(super) fn new(batch: u32) -> Self {
        // An even cut of a power of two that is no square: 8 is 4 x 2, not 3 x 3 with a hole.
        let rows = if batch.is_power_of_two() { 1 << (batch.trailing_zeros() / 2) } else { batch.isqrt().max(1) };
        Self { batch, columns: batch.div_ceil(rows), rows }
    }

    #[inline]
    pub(super) fn one(&self, index: u32, seed: u64) -> f32 {
        let jitter = mix(seed.wrapping_add(u64::from(index))) as u32;
        place(permute(index, self.batch, seed as u32), unit(jitter), self.batch)
    }

    #[inline]
    pub(super) fn two(&self, index: u32, seed: u64) -> Vec2 {
        let jitter = mix(seed.wrapping_add(u64::from(index)));
        let cell = permute(index, self.columns * self.rows, seed as u32);
        Vec2::new(
            place(cell % self.columns, unit(jitter as u32), self.columns),
            place(cell / self.columns, unit((jitter >> 32) as u32), self.rows),
        )
    }
}

/// Jittered place in stratum `i` of `n`; rounding never reaches 1.
#[inline]
fn place(i: u32, jitter: f32, n: u32) -> f32 {
    ((i as f32 + jitter) / n as f32).min(crate::math::ONE_MINUS_EPSILON)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_have_room_for_the_batch() {
        for batch in 1..200 {
            let strata = Strata::new(batch);
            assert!(strata.columns * strata.rows >= batch && strata.columns * strata.rows < batch + strata.columns);
        }
        assert_eq!((Strata::new(8).columns, Strata::new(8).rows), (4, 2));
    }
}
