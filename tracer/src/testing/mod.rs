//! What the tests of several modules share: random numbers, integrals over directions, and the
//! chi-square test of a sampler against its density.

mod chi_square;
mod directions;
mod image;

pub use image::{Image, prepare, render, render_rect, settings};

pub(crate) use chi_square::{ChiSquare, chi_square};
pub(crate) use directions::Directions;

use crate::math::Vec2;

/// Independent uniform numbers (PCG-XSH-RR 64/32, O'Neill 2014): the same in every run.
#[derive(Debug, Clone)]
pub(crate) struct Rng(u64);

impl Rng {
    pub(crate) fn new(seed: u64) -> Self {
        let mut rng = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x853c_49e6_748f_ea9b);
        rng.next_u32();
        rng
    }

    pub(crate) fn next_u32(&mut self) -> u32 {
        let old = self.0;
        self.0 = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
    }

    /// In [0, 1).
    pub(crate) fn next(&mut self) -> f32 {
        (self.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// In the half-open unit square.
    pub(crate) fn next_2d(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }
}
