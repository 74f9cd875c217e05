//! Eight `f32` at once, or four, for each instruction set that the traversal is compiled for.
//!
//! All of them do the same operations in the same order and round each one, so their results have the
//! same bits. The value of an [`Isa`] is a proof that the processor has the instructions: that is what
//! makes the functions on its lanes safe to call.

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(super) use portable::Portable;
#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512, Sse2};

/// Ask for `place` to be in the nearest cache soon. Nothing else comes of it.
#[inline(always)]
pub(crate) fn prefetch<T>(place: &T) {
    #[cfg(target_arch = "x86_64")]
    x86::prefetch_lines(std::ptr::from_ref(place).cast(), size_of::<T>().div_ceil(64));
    #[cfg(not(target_arch = "x86_64"))]
    let _ = place;
}

/// `W` numbers, eight or four. What holds rows sees to it that none lies across cache lines.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub(super) struct Row<const W: usize = 8>(pub [f32; W]);

/// Which instructions the traversal uses. It changes the speed and nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// 256-bit vectors with the registers and masks of AVX-512.
    Avx512,
    /// 256-bit vectors.
    Avx2,
    /// 128-bit vectors, which every x86-64 processor has.
    Sse2,
    /// Plain Rust, for any processor.
    Portable,
}

impl InstructionSet {
    /// The fastest one that this processor has.
    #[must_use]
    pub fn detect() -> Self {
        [Self::Avx512, Self::Avx2, Self::Sse2].into_iter().find(|i| i.is_available()).unwrap_or(Self::Portable)
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        self.prove().is_some()
    }

    /// A proof that this processor has it.
    pub(super) fn prove(self) -> Option<Proof> {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => Avx512::new().map(Proof::Avx512),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => Avx2::new().map(Proof::Avx2),
            #[cfg(target_arch = "x86_64")]
            Self::Sse2 => Some(Proof::Sse2(Sse2)),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 | Self::Sse2 => None,
            Self::Portable => Some(Proof::Portable(Portable)),
        }
    }
}

/// An instruction set that is there, to be told apart once a ray.
#[derive(Clone, Copy, Debug)]
pub(super) enum Proof {
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    #[cfg(target_arch = "x86_64")]
    Sse2(Sse2),
    Portable(Portable),
}

/// Loads and constants of an instruction set, for `W` lanes.
pub(super) trait Isa<const W: usize = 8>: Copy {
    type F: Lanes<W>;
    /// `x` in every lane.
    fn splat(self, x: f32) -> Self::F;
    fn load(self, row: &Row<W>) -> Self::F;
    /// Ask for `lines` cache lines from an address, which need not be valid.
    fn prefetch(self, address: *const u8, lines: usize);
}

/// An instruction set's lanes for the boxes of a node with `W` children.
pub(super) trait Boxes<const W: usize>: Isa {
    type Boxes: Isa<W>;
    fn boxes(self) -> Self::Boxes;
}

impl<I: Isa> Boxes<8> for I {
    type Boxes = Self;
    #[inline(always)]
    fn boxes(self) -> Self {
        self
    }
}

/// `W` numbers in registers. Masks have bit `i` for lane `i`.
pub(super) trait Lanes<const W: usize = 8>: Copy {
    fn store(self, row: &mut Row<W>);
    /// Lane `i % W`.
    fn lane(self, i: usize) -> f32;
    fn add(self, b: Self) -> Self;
    fn sub(self, b: Self) -> Self;
    fn mul(self, b: Self) -> Self;
    fn div(self, b: Self) -> Self;
    /// `self < b ? self : b`, so `b` where either is NaN or both are equal.
    fn min(self, b: Self) -> Self;
    /// `self > b ? self : b`, so `b` where either is NaN or both are equal.
    fn max(self, b: Self) -> Self;
    /// Without its sign.
    fn abs(self) -> Self;
    /// The other sign where `b` has one.
    fn times_sign_of(self, b: Self) -> Self;
    /// Zero but where `a <= b`.
    fn where_le(self, a: Self, b: Self) -> Self;
    fn le(self, b: Self) -> u32;
    fn lt(self, b: Self) -> u32;
    /// Lanes where `self < middle` and `middle < upper`.
    fn lt_and_gt(self, middle: Self, upper: Self) -> u32;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_lane_is_found_where_it_was_stored() {
        fn check_width<const W: usize>(isa: impl Isa<W>, numbers: [f32; W]) {
            let row = isa.load(&Row(numbers));
            let mut stored = Row([0.0; W]);
            row.store(&mut stored);
            assert_eq!(std::array::from_fn(|i| row.lane(i).to_bits()), numbers.map(f32::to_bits));
            assert_eq!(stored.0.map(f32::to_bits), numbers.map(f32::to_bits));
        }
        fn check(isa: impl Boxes<4>) {
            check_width(isa, [1.0, -2.0, 3.5, f32::INFINITY, 0.0, 6.0, -0.0, 8.0]);
            check_width(isa.boxes(), [-1.0, f32::INFINITY, -0.0, 4.0]);
        }
        for set in [InstructionSet::Avx512, InstructionSet::Avx2, InstructionSet::Sse2, InstructionSet::Portable] {
            match set.prove() {
                #[cfg(target_arch = "x86_64")]
                Some(Proof::Avx512(isa)) => check(isa),
                #[cfg(target_arch = "x86_64")]
                Some(Proof::Avx2(isa)) => check(isa),
                #[cfg(target_arch = "x86_64")]
                Some(Proof::Sse2(isa)) => check(isa),
                Some(Proof::Portable(isa)) => check(isa),
                None => {}
            }
        }
    }
}
