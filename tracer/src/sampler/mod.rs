//! Sample points: which numbers in 0..1 a sample of a pixel is made of. Knows nothing of scenes.
//!
//! A value is a pure function of (seed, frame, pixel, sample, dimension). Sample `s` of a pixel is point
//! `s % batch` of batch `s / batch`; every batch is randomised by its own key, so that batch means are
//! independent estimates, while the points inside a batch are spread evenly.
//!
//! Batches may also be [the parts of larger sets](Sampler::in_sets): each is spread evenly, and so are those of a set
//! together. Their mean then errs less than their spread tells.
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
    /// Points of a set: a multiple of `batch`.
    set: u32,
    strata: stratified::Strata,
}

/// All dimensions of one sample of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Stream {
    kind: method::Sampler,
    /// Hash of seed, frame, pixel and set.
    key: u64,
    /// Index of the point in its set.
    index: u32,
    batch: u32,
    strata: stratified::Strata,
}

impl Sampler {
    /// Points of `kind` in batches of `batch` (at least 1).
    #[must_use]
    pub fn new(kind: method::Sampler, seed: u64, frame: u32, batch: u32) -> Self {
        let batch = batch.max(1);
        Self { kind, seed, frame, batch, set: batch, strata: stratified::Strata::new(batch) }
    }

    /// The same with each `n` batches (a power of two) one set: batch `b` is part `b % n` of set `b / n`. A scrambled
    /// Sobol' sequence's parts of a power of two of points are nets, and so are `n` of them in a row, if both are powers
    /// of two; other points stay in batches that know nothing of each other.
    #[must_use]
    pub fn in_sets(self, n: u32) -> Self {
        let nested = self.is_plain() && n.is_power_of_two();
        Self { set: if nested { self.batch.saturating_mul(n) } else { self.batch }, ..self }
    }

    /// Points of a batch.
    #[must_use]
    pub fn batch(&self) -> u32 {
        self.batch
    }

    /// Points of a set: those that share a key.
    #[must_use]
    pub fn set(&self) -> u32 {
        self.set
    }

    /// Sample `sample` of the pixel at column `x`, row `y`.
    #[inline]
    #[must_use]
    pub fn stream(&self, x: u32, y: u32, sample: u32) -> Stream {
        let pixel = u64::from(x) | u64::from(y) << 32;
        let turn = u64::from(sample / self.set) | u64::from(self.frame) << 32;
        let key = hash::mix(hash::mix(hash::mix(self.seed) ^ pixel) ^ turn);
        self.resume(key, sample % self.set)
    }

    /// The stream with these [`Stream::parts`].
    #[inline(always)]
    #[must_use]
    pub fn resume(&self, key: u64, index: u32) -> Stream {
        Stream { kind: self.kind, key, index, batch: self.batch, strata: self.strata }
    }

    /// The sampler of streams that were [forked](Stream::fork) `n` ways.
    #[must_use]
    pub fn forked(&self, n: u32) -> Self {
        let set = self.set.saturating_mul(n);
        Self { set, ..Self::new(self.kind, self.seed, self.frame, self.batch.saturating_mul(n)) }
    }

    /// Whether its numbers are those of [`plain_one`] and [`plain_two`]: Sobol' points in batches of a power of two.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.kind == method::Sampler::Sobol && self.batch.is_power_of_two()
    }
}

/// How many points the sets have that decisions of a wave draw from: of whole paths, and of paths that were
/// [forked](Stream::fork).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batches {
    batch: u32,
    splits: u32,
}

impl Batches {
    /// Of a sampler that [`Sampler::is_plain`]; paths are forked `splits` ways, a power of two.
    #[must_use]
    pub fn new(sampler: &Sampler, splits: u32) -> Self {
        Self { batch: sampler.batch, splits }
    }

    /// The code for them: the first parameter of [`plain_one`] and [`plain_two`].
    #[must_use]
    pub fn code(self) -> u32 {
        match (self.batch == permute::TABLED, self.splits > 1) {
            (true, false) => TABLED,
            (false, false) => COMPUTED,
            (true, true) => TABLED_FORKED,
            (false, true) => COMPUTED_FORKED,
        }
    }

    /// The place of a point in its set: that of [`Stream::place`], for batches of a power of two.
    #[inline(always)]
    fn place<const CODE: u32>(self, index: u32, forked: bool, seed: u32) -> u32 {
        let computed = |batch: u32| {
            let part = index >> batch.trailing_zeros();
            index & !(batch - 1) | permute::permute_power_of_two(index & (batch - 1), batch, part_seed(seed, part))
        };
        let tabled = || {
            let part = index / permute::TABLED;
            index & !(permute::TABLED - 1) | permute::permute16(index, part_seed(seed, part))
        };
        match CODE {
            TABLED => tabled(),
            COMPUTED => computed(self.batch),
            TABLED_FORKED => {
                let mask = u32::from(forked).wrapping_neg();
                computed(self.batch * self.splits) & mask | tabled() & !mask
            }
            _ if self.batch * self.splits == permute::TABLED => {
                let mask = u32::from(forked).wrapping_neg();
                tabled() & mask | computed(self.batch) & !mask
            }
            _ => computed(self.batch << (u32::from(forked) * self.splits.trailing_zeros())),
        }
    }
}

/// What orders part `part` of a set; each part has an order of its own.
#[inline(always)]
fn part_seed(seed: u32, part: u32) -> u32 {
    seed.wrapping_add(part.wrapping_mul(0x9E37_79B9))
}

/// Batches of the size whose orders are tabled; no path is forked.
pub const TABLED: u32 = 0;
/// Batches of another power of two.
pub const COMPUTED: u32 = 1;
/// As [`TABLED`], some paths forked.
pub const TABLED_FORKED: u32 = 2;
/// As [`COMPUTED`], some paths forked.
pub const COMPUTED_FORKED: u32 = 3;

/// [`Stream::two`] of a stream with these parts, for a sampler that [`Sampler::is_plain`]. Without branches, so
/// that loops over it become vector code.
#[inline(always)]
#[must_use]
pub fn plain_two<const CODE: u32>(key: u64, index: u32, forked: bool, batches: Batches, dimension: u32) -> Vec2 {
    let seed = hash::dimension(key, dimension);
    sobol::two(batches.place::<CODE>(index, forked, seed as u32), seed)
}

/// [`Stream::one`] of the same stream.
#[inline(always)]
#[must_use]
pub fn plain_one<const CODE: u32>(key: u64, index: u32, forked: bool, batches: Batches, dimension: u32) -> f32 {
    let seed = hash::dimension(key, dimension);
    sobol::one(batches.place::<CODE>(index, forked, seed as u32), seed)
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
            method::Sampler::Sobol => sobol::one(self.place(seed as u32), seed),
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
            method::Sampler::Sobol => sobol::two(self.place(seed as u32), seed),
            method::Sampler::Stratified => self.strata.two(self.index, seed),
            method::Sampler::Independent => {
                let bits = hash::mix(seed ^ u64::from(self.index));
                Vec2::new(hash::unit(bits as u32), hash::unit((bits >> 32) as u32))
            }
        }
    }

    /// The point of the sequence that this one is: the batch's part of the set, in an order of its own.
    #[inline]
    fn place(&self, seed: u32) -> u32 {
        let part = self.index / self.batch;
        part * self.batch + permute(self.index % self.batch, self.batch, part_seed(seed, part))
    }

    /// The same point of another set: sample `k` of several that one decision takes (`light_samples`). Sets
    /// are independent of each other.
    #[inline]
    #[must_use]
    pub fn split(&self, k: u32) -> Stream {
        Stream { key: split_key(self.key, k), ..*self }
    }
}

/// The key of [`Stream::split`].
#[inline(always)]
#[must_use]
pub fn split_key(key: u64, k: u32) -> u64 {
    hash::mix(key ^ u64::from(k).wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

impl Stream {
    /// Way `k` of `n` in which a path goes on: point `index x n + k` of a batch `n` times as large, so that the ways of
    /// all points of a batch together are spread evenly.
    #[inline]
    #[must_use]
    pub fn fork(&self, k: u32, n: u32) -> Stream {
        let batch = self.batch.saturating_mul(n);
        Stream { index: self.index * n + k, batch, strata: stratified::Strata::new(batch), ..*self }
    }
}

#[cfg(test)]
mod tests;
