//! The lanes on x86-64: eight in one 256-bit register or in two of 128 bits, and four in one.

use std::arch::x86_64::*;

use super::{Boxes, Isa, Lanes, Row};

/// The processor has AVX2 and the bit instructions that came with it. Made by [`Avx2::new`] only.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Avx2(());

impl Avx2 {
    /// None where the processor lacks it.
    #[inline]
    pub fn new() -> Option<Self> {
        (is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt"))
        .then_some(Self(()))
    }
}

/// The processor has the 256-bit forms of AVX-512 besides: twice the registers, and masks in registers of their own.
/// Made by [`Avx512::new`] only.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Avx512(Avx2);

impl Avx512 {
    /// None where the processor lacks it.
    #[inline]
    pub fn new() -> Option<Self> {
        (is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl"))
        .then_some(Self(Avx2::new()?))
    }
}

/// What every x86-64 processor has.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Sse2;

/// Eight numbers in one register. Made from an [`Avx2`] only.
#[derive(Clone, Copy)]
pub(in super::super) struct F8(__m256);

/// Four numbers in one register.
#[derive(Clone, Copy)]
pub(in super::super) struct F4(__m128);

/// Eight numbers in two registers.
#[derive(Clone, Copy)]
pub(in super::super) struct F4x2(F4, F4);

#[inline(always)]
pub(super) fn prefetch_lines(address: *const u8, lines: usize) {
    for line in 0..lines {
        // SAFETY: a prefetch of any address is allowed; it never faults.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64 * line).cast()) };
    }
}

impl Isa for Avx2 {
    type F = F8;
    #[inline(always)]
    fn splat(self, x: f32) -> F8 {
        // SAFETY: `self` proves AVX2.
        F8(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn load(self, row: &Row) -> F8 {
        // SAFETY: `self` proves AVX2; a row is eight numbers.
        F8(unsafe { _mm256_loadu_ps(row.0.as_ptr()) })
    }
    #[inline(always)]
    fn prefetch(self, address: *const u8, lines: usize) {
        prefetch_lines(address, lines);
    }
}

impl Isa for Avx512 {
    type F = F8;
    #[inline(always)]
    fn splat(self, x: f32) -> F8 {
        self.0.splat(x)
    }
    #[inline(always)]
    fn load(self, row: &Row) -> F8 {
        self.0.load(row)
    }
    #[inline(always)]
    fn prefetch(self, address: *const u8, lines: usize) {
        prefetch_lines(address, lines);
    }
}

/// A function of one AVX instruction on two values.
macro_rules! avx {
    ($($name:ident = $intrinsic:ident;)*) => {$(
        #[inline(always)]
        fn $name(self, b: Self) -> Self {
            // SAFETY: an `F8` exists only where the processor has AVX2.
            Self(unsafe { $intrinsic(self.0, b.0) })
        }
    )*};
}

impl Lanes for F8 {
    avx! {
        add = _mm256_add_ps;
        sub = _mm256_sub_ps;
        mul = _mm256_mul_ps;
        div = _mm256_div_ps;
        min = _mm256_min_ps;
        max = _mm256_max_ps;
    }
    #[inline(always)]
    fn store(self, row: &mut Row) {
        // SAFETY: an `F8` exists only where the processor has AVX2; a row is eight numbers.
        unsafe { _mm256_storeu_ps(row.0.as_mut_ptr(), self.0) };
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f32 {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        unsafe { _mm256_cvtss_f32(_mm256_permutevar8x32_ps(self.0, _mm256_set1_epi32(i as i32))) }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }
    #[inline(always)]
    fn times_sign_of(self, b: Self) -> Self {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_and_ps(_mm256_set1_ps(-0.0), b.0)) })
    }
    #[inline(always)]
    fn where_le(self, a: Self, b: Self) -> Self {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        Self(unsafe { _mm256_and_ps(self.0, _mm256_cmp_ps::<_CMP_LE_OQ>(a.0, b.0)) })
    }
    #[inline(always)]
    fn le(self, b: Self) -> u32 {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, b.0)) as u32 }
    }
    #[inline(always)]
    fn lt(self, b: Self) -> u32 {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0)) as u32 }
    }
    #[inline(always)]
    fn lt_and_gt(self, middle: Self, upper: Self) -> u32 {
        // SAFETY: an `F8` exists only where the processor has AVX2.
        unsafe {
            let below = _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, middle.0);
            let above = _mm256_cmp_ps::<_CMP_LT_OQ>(middle.0, upper.0);
            _mm256_movemask_ps(_mm256_and_ps(below, above)) as u32
        }
    }
}

impl Isa<4> for Sse2 {
    type F = F4;
    #[inline(always)]
    fn splat(self, x: f32) -> F4 {
        // SAFETY: SSE2 is part of x86-64, here and in the rest of this file.
        F4(unsafe { _mm_set1_ps(x) })
    }
    #[inline(always)]
    fn load(self, row: &Row<4>) -> F4 {
        // SAFETY: a row is four numbers, aligned to 16 bytes.
        F4(unsafe { _mm_load_ps(row.0.as_ptr()) })
    }
    #[inline(always)]
    fn prefetch(self, address: *const u8, lines: usize) {
        prefetch_lines(address, lines);
    }
}

impl Isa for Sse2 {
    type F = F4x2;
    #[inline(always)]
    fn splat(self, x: f32) -> F4x2 {
        let four = Isa::<4>::splat(self, x);
        F4x2(four, four)
    }
    #[inline(always)]
    fn load(self, row: &Row) -> F4x2 {
        let p = row.0.as_ptr();
        // SAFETY: a row is eight numbers, aligned to 16 bytes.
        unsafe { F4x2(F4(_mm_load_ps(p)), F4(_mm_load_ps(p.add(4)))) }
    }
    #[inline(always)]
    fn prefetch(self, address: *const u8, lines: usize) {
        prefetch_lines(address, lines);
    }
}

/// Four boxes are tested by 128-bit vectors on any of these processors.
macro_rules! four_boxes {
    ($($isa:ty)*) => {$(
        impl Boxes<4> for $isa {
            type Boxes = Sse2;
            #[inline(always)]
            fn boxes(self) -> Sse2 {
                Sse2
            }
        }
    )*};
}
four_boxes!(Avx512 Avx2 Sse2);

/// A function of one SSE instruction on two values.
macro_rules! sse {
    ($($name:ident = $intrinsic:ident;)*) => {$(
        #[inline(always)]
        fn $name(self, b: Self) -> Self {
            // SAFETY: SSE2 is part of x86-64.
            Self(unsafe { $intrinsic(self.0, b.0) })
        }
    )*};
}

impl Lanes<4> for F4 {
    sse! {
        add = _mm_add_ps;
        sub = _mm_sub_ps;
        mul = _mm_mul_ps;
        div = _mm_div_ps;
        min = _mm_min_ps;
        max = _mm_max_ps;
    }
    #[inline(always)]
    fn store(self, row: &mut Row<4>) {
        // SAFETY: a row is four numbers, aligned to 16 bytes.
        unsafe { _mm_store_ps(row.0.as_mut_ptr(), self.0) };
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f32 {
        let mut row = Row([0.0; 4]);
        self.store(&mut row);
        row.0[i & 3]
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: SSE2 is part of x86-64.
        Self(unsafe { _mm_andnot_ps(_mm_set1_ps(-0.0), self.0) })
    }
    #[inline(always)]
    fn times_sign_of(self, b: Self) -> Self {
        // SAFETY: SSE2 is part of x86-64.
        Self(unsafe { _mm_xor_ps(self.0, _mm_and_ps(_mm_set1_ps(-0.0), b.0)) })
    }
    #[inline(always)]
    fn where_le(self, a: Self, b: Self) -> Self {
        // SAFETY: SSE2 is part of x86-64.
        Self(unsafe { _mm_and_ps(self.0, _mm_cmple_ps(a.0, b.0)) })
    }
    #[inline(always)]
    fn le(self, b: Self) -> u32 {
        // SAFETY: SSE2 is part of x86-64.
        unsafe { _mm_movemask_ps(_mm_cmple_ps(self.0, b.0)) as u32 }
    }
    #[inline(always)]
    fn lt(self, b: Self) -> u32 {
        // SAFETY: SSE2 is part of x86-64.
        unsafe { _mm_movemask_ps(_mm_cmplt_ps(self.0, b.0)) as u32 }
    }
    #[inline(always)]
    fn lt_and_gt(self, middle: Self, upper: Self) -> u32 {
        self.lt(middle) & middle.lt(upper)
    }
}

/// A function of both halves.
macro_rules! halves {
    ($($name:ident)*) => {$(
        #[inline(always)]
        fn $name(self, b: Self) -> Self {
            Self(self.0.$name(b.0), self.1.$name(b.1))
        }
    )*};
}

impl Lanes for F4x2 {
    halves!(add sub mul div min max times_sign_of);
    #[inline(always)]
    fn store(self, row: &mut Row) {
        let p = row.0.as_mut_ptr();
        // SAFETY: a row is eight numbers, aligned to 16 bytes.
        unsafe {
            _mm_store_ps(p, self.0.0);
            _mm_store_ps(p.add(4), self.1.0);
        }
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f32 {
        let mut row = Row([0.0; 8]);
        self.store(&mut row);
        row.0[i & 7]
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }
    #[inline(always)]
    fn where_le(self, a: Self, b: Self) -> Self {
        Self(self.0.where_le(a.0, b.0), self.1.where_le(a.1, b.1))
    }
    #[inline(always)]
    fn le(self, b: Self) -> u32 {
        self.0.le(b.0) | self.1.le(b.1) << 4
    }
    #[inline(always)]
    fn lt(self, b: Self) -> u32 {
        self.0.lt(b.0) | self.1.lt(b.1) << 4
    }
    #[inline(always)]
    fn lt_and_gt(self, middle: Self, upper: Self) -> u32 {
        self.lt(middle) & middle.lt(upper)
    }
}
