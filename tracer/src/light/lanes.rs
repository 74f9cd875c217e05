//! Four f32 side by side. Plain arithmetic, a lane like any other f32; written so that compilers make one
//! instruction of four equal ones.

use std::ops::{Add, Mul, Neg, Sub};

/// Four numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(16))]
pub(super) struct Lanes(pub(super) [f32; 4]);

macro_rules! lanewise {
    ($i:ident => $value:expr) => {{
        let at = |$i: usize| $value;
        Lanes([at(0), at(1), at(2), at(3)])
    }};
}

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; 4]);

    #[inline(always)]
    pub(super) fn all(x: f32) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        lanewise!(i => self.0[i].sqrt())
    }

    #[inline(always)]
    pub(super) fn reciprocal(self) -> Self {
        lanewise!(i => 1.0 / self.0[i])
    }

    /// The greater; `other` where this is not a number.
    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        lanewise!(i => if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] })
    }

    /// The magnitude in lanes whose mask lacks the sign bit.
    #[inline(always)]
    pub(super) fn keep_bits(self, mask: [u32; 4]) -> Self {
        lanewise!(i => f32::from_bits(self.0[i].to_bits() & mask[i]))
    }

    /// `yes` where this is at least `other`, else `no`.
    #[inline(always)]
    pub(super) fn at_least(self, other: Self, yes: Self, no: Self) -> Self {
        lanewise!(i => if self.0[i] >= other.0[i] { yes.0[i] } else { no.0[i] })
    }

    #[inline(always)]
    pub(super) fn sum(self) -> f32 {
        (self.0[0] + self.0[1]) + (self.0[2] + self.0[3])
    }
}

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        lanewise!(i => self.0[i] + other.0[i])
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        lanewise!(i => self.0[i] - other.0[i])
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        lanewise!(i => self.0[i] * other.0[i])
    }
}

impl Neg for Lanes {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        lanewise!(i => -self.0[i])
    }
}
