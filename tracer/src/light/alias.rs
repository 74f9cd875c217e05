//! Choosing one of many in constant time: Vose's alias table (1991), and numbers fine enough to feed it.

use crate::math::Vec2;

/// A discrete distribution that is sampled in constant time.
#[derive(Debug, Clone, Default)]
pub struct AliasTable {
    bins: Vec<Bin>,
}

#[derive(Debug, Clone, Copy)]
struct Bin {
    /// The part of the bin that is its own; the rest belongs to `alias`.
    own: f64,
    alias: u32,
    probability: f32,
}

impl AliasTable {
    /// A table that picks `i` in proportion to `weights[i]`. A weight that is not a positive finite number
    /// is never picked; where none is, the table is empty.
    ///
    /// At most 2^32 weights.
    #[must_use]
    pub fn new(weights: &[f64]) -> Self {
        let weights: Vec<f64> = weights.iter().map(|w| if w.is_finite() && *w > 0.0 { *w } else { 0.0 }).collect();
        // Divided by the largest first: a sum of huge weights must not overflow.
        let largest = weights.iter().copied().fold(0.0, f64::max);
        if largest == 0.0 {
            return Self::default();
        }
        let total: f64 = weights.iter().map(|w| w / largest).sum();
        let count = weights.len() as f64;
        let mut share: Vec<f64> = weights.iter().map(|w| w / largest / total * count).collect();
        let mut bins: Vec<Bin> = share
            .iter()
            .enumerate()
            .map(|(i, s)| Bin { own: 1.0, alias: i as u32, probability: (s / count) as f32 })
            .collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..bins.len()).partition(|&i| share[i] < 1.0);
        while let (Some(&little), Some(&big)) = (small.last(), large.last()) {
            small.pop();
            bins[little].own = share[little];
            bins[little].alias = big as u32;
            share[big] -= 1.0 - share[little];
            if share[big] < 1.0 {
                large.pop();
                small.push(big);
            }
        }
        // Rounding may leave some without a partner. Their share is 1 but for rounding, unless they weigh
        // nothing: those must never be picked.
        if let Some(heaviest) = (0..bins.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])) {
            for left in small.into_iter().chain(large).filter(|&i| weights[i] == 0.0) {
                bins[left].own = 0.0;
                bins[left].alias = heaviest as u32;
            }
        }
        Self { bins }
    }

    /// How many choices there are, those that are never picked included; 0 where nothing can be picked.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bins.len()
    }

    /// Whether nothing can be picked.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bins.is_empty()
    }

    /// The choice that `u`, 0 <= u < 1, makes; its probability; and what is left of `u`, uniform once more.
    #[inline]
    #[must_use]
    pub fn pick(&self, u: f64) -> Option<(u32, f32, f64)> {
        if self.bins.len() <= 1 {
            return self.bins.first().map(|bin| (0, bin.probability, u));
        }
        let scaled = u * self.bins.len() as f64;
        let index = (scaled as u32 as usize).min(self.bins.len() - 1);
        let within = (scaled - index as f64).min(1.0 - f64::EPSILON);
        let bin = self.bins[index];
        let (choice, rest) = if within < bin.own {
            (index as u32, within / bin.own)
        } else {
            (bin.alias, (within - bin.own) / (1.0 - bin.own))
        };
        Some((choice, self.probability(choice), rest.min(1.0 - f64::EPSILON)))
    }

    /// Probability of the choice `index`; 0 where there is none.
    #[inline]
    #[must_use]
    pub fn probability(&self, index: u32) -> f32 {
        self.bins.get(index as usize).map_or(0.0, |bin| bin.probability)
    }
}

/// `pick` with 29 more bits, taken from a hash of it and of `u`.
///
/// A sampler's number has 24 bits; a mesh of a million triangles, or a walk of twenty steps, would use them
/// up and then choose by what rounding left. Whatever `u` is, the result is uniform if `pick` is.
#[inline]
#[must_use]
pub fn lengthen(pick: f32, u: Vec2) -> f64 {
    let step = ((pick * 16_777_216.0) as i32).clamp(0, 0x00ff_ffff) as i64;
    // The finisher of SplitMix64 (Steele, Lea and Flood 2014).
    let mut hash =
        (u64::from(u.x.to_bits()) << 32 | u64::from(u.y.to_bits())) ^ u64::from(pick.to_bits()).rotate_left(17);
    hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    hash ^= hash >> 31;
    (step << 29 | (hash >> 35) as i64) as f64 * (1.0 / 9_007_199_254_740_992.0)
}
