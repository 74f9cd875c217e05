//! Sixty-four paths side by side: arrays by quantity, and functions compiled for each instruction set.
//!
//! There is no vector type here. A stage is a loop over arrays, its body the same inlined functions that
//! render one path at a time; compilers make vector code of it, and every lane gets the bits that the scalar
//! code would have given it, because each operation rounds as before.

use crate::math::Vec3;

/// Paths side by side.
pub const WIDTH: usize = 64;
/// Stages run over whole groups of this many lanes; those beyond the last path hold stale numbers, which
/// nobody reads.
const GROUP: usize = 16;

/// A number for each path.
pub(crate) type Lane<T> = [T; WIDTH];

/// Yes or no. As wide as a number: compilers cannot tell that arrays of different strides do not overlap, and
/// then make no vector code.
pub(crate) type Flag = u32;
pub(crate) const NO: Flag = 0;
pub(crate) const YES: Flag = 1;

/// A bit for each lane whose flag is [`YES`].
#[inline(always)]
pub(crate) fn mask_of(flags: &Lane<Flag>) -> u64 {
    let (groups, _) = flags.as_chunks::<GROUP>();
    let mut mask = 0;
    for (k, group) in groups.iter().enumerate() {
        let mut bits = 0;
        for (l, flag) in group.iter().enumerate() {
            bits |= flag << l;
        }
        mask |= u64::from(bits) << (k * GROUP);
    }
    mask
}

/// The lanes whose bits are set, in order.
#[inline(always)]
pub(crate) fn lanes_of(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (lane < WIDTH).then_some(lane)
    })
}

/// How many lanes a stage runs over to cover `n` paths.
#[inline(always)]
pub(crate) fn covering(n: usize) -> usize {
    n.next_multiple_of(GROUP).min(WIDTH)
}

/// Lanes `N` k to `N` (k + 1); `N` divides [`WIDTH`].
#[inline(always)]
pub(crate) fn block<T: Copy, const N: usize>(lane: &Lane<T>, k: usize) -> [T; N] {
    let (blocks, _) = lane.as_chunks::<N>();
    blocks[k % (WIDTH / N)]
}

/// The same to be written.
#[inline(always)]
pub(crate) fn block_mut<T, const N: usize>(lane: &mut Lane<T>, k: usize) -> &mut [T; N] {
    let (blocks, _) = lane.as_chunks_mut::<N>();
    &mut blocks[k % (WIDTH / N)]
}

/// A vector for each path.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Lane3 {
    x: Lane<f32>,
    y: Lane<f32>,
    z: Lane<f32>,
}

impl Lane3 {
    pub const ZERO: Self = Self { x: [0.0; WIDTH], y: [0.0; WIDTH], z: [0.0; WIDTH] };

    #[inline(always)]
    pub fn at(&self, i: usize) -> Vec3 {
        Vec3::new(self.x[i], self.y[i], self.z[i])
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, v: Vec3) {
        (self.x[i], self.y[i], self.z[i]) = (v.x, v.y, v.z);
    }

    /// Lanes `N` k to `N` (k + 1), coordinate by coordinate; `N` divides [`WIDTH`].
    #[inline(always)]
    pub fn block<const N: usize>(&self, k: usize) -> [[f32; N]; 3] {
        [block(&self.x, k), block(&self.y, k), block(&self.z, k)]
    }
}

/// The instructions that stages are compiled for. It changes the speed and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compiled {
    /// 512-bit vectors.
    Avx512,
    /// 256-bit vectors.
    Avx2,
    /// What every processor of the kind has.
    Baseline,
}

impl Compiled {
    /// All of them, the fastest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Baseline];

    /// The fastest one that this processor has.
    #[must_use]
    pub fn detect() -> Self {
        Self::ALL.into_iter().find(|compiled| compiled.is_available()).unwrap_or(Self::Baseline)
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Baseline => true,
        }
    }
}

/// An instruction set that this processor was seen to have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Proven(Compiled);

impl Proven {
    /// `None` where the processor lacks it.
    pub fn new(compiled: Compiled) -> Option<Self> {
        compiled.is_available().then_some(Self(compiled))
    }

    /// The fastest one that this processor has.
    pub fn detect() -> Self {
        Self(Compiled::detect())
    }

    pub fn compiled(self) -> Compiled {
        self.0
    }
}

/// A function with a copy for each instruction set; the first argument says which one runs.
macro_rules! stage {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments, clippy::needless_range_loop)]
        $vis fn $name(proven: $crate::lanes::Proven, $($argument: $type),*) {
            #[inline(always)]
            fn baseline($($argument: $type),*) $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn avx2($($argument: $type),*) {
                baseline($($argument),*);
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
            fn avx512($($argument: $type),*) {
                baseline($($argument),*);
            }
            match proven.compiled() {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: `proven` exists only where the processor has these instructions.
                $crate::lanes::Compiled::Avx512 => unsafe { avx512($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: as above.
                $crate::lanes::Compiled::Avx2 => unsafe { avx2($($argument),*) },
                _ => baseline($($argument),*),
            }
        }
    };
}
pub(crate) use stage;
