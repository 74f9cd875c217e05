//! Sample points: which numbers in 0..1 a sample of a pixel is made of. Knows nothing of scenes.
//!
//! A value is a pure function of (seed, frame, pixel, sample, dimension). Sample `s` of a pixel is point
//! `s % batch` of batch `s / batch`; every batch is randomised by its own key, so that batch means are
//! independent estimates, while the points inside a batch are spread evenly.
//!
//! A *dimension* is the number of a decision in the path (the point in the pixel, the light of the third
//! hit, ...), fixed by the integrator whatever branches a path takes. A dimension yields one number or a
//! pair.

mod hash;
mod permute;
mod sobol;
mod stratified;

use common::method;

use crate::math::Vec2;
use permute::permute;

/// A source of sample points for one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampler {
    kind: method::Sampler,
    seed: u64,
    frame: u32,
    batch: u32,
    strata: stratified::Strata,
}

/// All dimensions of one sample of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Stream {
    kind: method::Sampler,
    /// Hash of seed, frame, pixel and batch.
    key: u64,
    /// Index of the point in its batch.
    index: u32,
    batch: u32,
    strata: stratified::Strata,
}

impl Sampler {
    /// Points of `kind` in batches of `batch` (at least 1).
    #[must_use]
    pub fn new(kind: method::Sampler, seed: u64, frame: u32, batch: u32) -> Self {
        let batch = batch.max(1);
        Self { kind, seed, frame, batch, strata: stratified::Strata::new(batch) }
    }

    /// Points of a batch.
    #[must_use]
    pub fn batch(&self) -> u32 {
        self.batch
    }

    /// Sample `sample` of the pixel at column `x`, row `y`.
    #[inline]
    #[must_use]
    pub fn stream(&self, x: u32, y: u32, sample: u32) -> Stream {
        let pixel = u64::from(x) | u64::from(y) << 32;
        let turn = u64::from(sample / self.batch) | u64::from(self.frame) << 32;
        let key = hash::mix(hash::mix(hash::mix(self.seed) ^ pixel) ^ turn);
        self.resume(key, sample % self.batch)
    }

    /// The stream with these [`Stream::parts`].
    #[inline(always)]
    #[must_use]
    pub fn resume(&self, key: u64, index: u32) -> Stream {
        Stream { kind: self.kind, key, index, batch: self.batch, strata: self.strata }
    }

    /// Whether its numbers are those of [`plain_one`] and [`plain_two`]: Sobol' points in batches of a power of two.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.kind == method::Sampler::Sobol && self.batch.is_power_of_two()
    }
}

/// The place of a point in its batch. `TABLED`: batches are of [`permute::TABLED`].
#[inline(always)]
fn place<const TABLED: bool>(index: u32, batch: u32, seed: u64) -> u32 {
    if TABLED {
        permute::permute16(index, seed as u32)
    } else {
        permute::permute_power_of_two(index, batch, seed as u32)
    }
}

/// Whether batches have the size whose orders are tabled.
#[inline(always)]
#[must_use]
pub fn is_tabled(batch: u32) -> bool {
    batch == permute::TABLED
}

/// [`Stream::two`] of a stream with these parts, for a sampler that [`Sampler::is_plain`]. Without branches, so
/// that loops over it become vector code.
#[inline(always)]
#[must_use]
pub fn plain_two<const TABLED: bool>(key: u64, index: u32, batch: u32, dimension: u32) -> Vec2 {
    let seed = hash::dimension(key, dimension);
    sobol::two(place::<TABLED>(index, batch, seed), seed)
}

/// [`Stream::one`] of the same stream.
#[inline(always)]
#[must_use]
pub fn plain_one<const TABLED: bool>(key: u64, index: u32, batch: u32, dimension: u32) -> f32 {
    let seed = hash::dimension(key, dimension);
    sobol::one(place::<TABLED>(index, batch, seed), seed)
}

impl Stream {
    /// What sets it apart from others of its sampler: the key of its batch, and its place in that.
    #[inline]
    #[must_use]
    pub fn parts(&self) -> (u64, u32) {
        (self.key, self.index)
    }

    /// The number of dimension `dimension`, 0 <= u < 1.
    #[inline]
    #[must_use]
    pub fn one(&self, dimension: u32) -> f32 {
        let seed = hash::dimension(self.key, dimension);
        match self.kind {
            method::Sampler::Sobol => sobol::one(permute(self.index, self.batch, seed as u32), seed),
            method::Sampler::Stratified => self.strata.one(self.index, seed),
            method::Sampler::Independent => hash::unit(hash::mix(seed ^ u64::from(self.index)) as u32),
        }
    }

    /// The pair of dimension `dimension`, each 0 <= u < 1.
    #[inline]
    #[must_use]
    pub fn two(&self, dimension: u32) -> Vec2 {
        let seed = hash::dimension(self.key, dimension);
        match self.kind {
            method::Sampler::Sobol => sobol::two(permute(self.index, self.batch, seed as u32), seed),
            method::Sampler::Stratified => self.strata.two(self.index, seed),
            method::Sampler::Independent => {
                let bits = hash::mix(seed ^ u64::from(self.index));
                Vec2::new(hash::unit(bits as u32), hash::unit((bits >> 32) as u32))
            }
        }
    }

    /// The same point of another set: sample `k` of several that one decision takes (`light_samples`). Sets
    /// are independent of each other.
    #[inline]
    #[must_use]
    pub fn split(&self, k: u32) -> Stream {
        Stream { key: hash::mix(self.key ^ u64::from(k).wrapping_mul(0x9E37_79B9_7F4A_7C15)), ..*self }
    }
}

#[cfg(test)]
mod tests;
