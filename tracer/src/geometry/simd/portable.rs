//! The lanes in plain Rust.

use super::{Boxes, Isa, Lanes, Row};

/// Needs nothing of the processor.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Portable;

/// `W` numbers.
#[derive(Clone, Copy)]
pub(in super::super) struct Array<const W: usize>([f32; W]);

impl<const W: usize> Isa<W> for Portable {
    type F = Array<W>;
    #[inline(always)]
    fn splat(self, x: f32) -> Array<W> {
        Array([x; W])
    }
    #[inline(always)]
    fn load(self, row: &Row<W>) -> Array<W> {
        Array(row.0)
    }
    #[inline(always)]
    fn prefetch(self, _: *const u8, _: usize) {}
}

impl Boxes<4> for Portable {
    type Boxes = Self;
    #[inline(always)]
    fn boxes(self) -> Self {
        self
    }
}

impl<const W: usize> Array<W> {
    #[inline(always)]
    fn each(self, b: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], b.0[i])))
    }
    #[inline(always)]
    fn mask(self, b: Self, f: impl Fn(f32, f32) -> bool) -> u32 {
        (0..W).fold(0, |m, i| m | u32::from(f(self.0[i], b.0[i])) << i)
    }
}

impl<const W: usize> Lanes<W> for Array<W> {
    #[inline(always)]
    fn store(self, row: &mut Row<W>) {
        row.0 = self.0;
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f32 {
        self.0[i % W]
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.each(b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.each(b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.each(b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        self.each(b, |a, b| a / b)
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.each(b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.each(b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn times_sign_of(self, b: Self) -> Self {
        self.each(b, |a, b| f32::from_bits(a.to_bits() ^ b.to_bits() & 1 << 31))
    }
    #[inline(always)]
    fn where_le(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| if a.0[i] <= b.0[i] { self.0[i] } else { 0.0 }))
    }
    #[inline(always)]
    fn le(self, b: Self) -> u32 {
        self.mask(b, |a, b| a <= b)
    }
    #[inline(always)]
    fn lt(self, b: Self) -> u32 {
        self.mask(b, |a, b| a < b)
    }
    #[inline(always)]
    fn lt_and_gt(self, middle: Self, upper: Self) -> u32 {
        self.lt(middle) & middle.lt(upper)
    }
}
