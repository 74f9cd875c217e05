//! Integer hashes that sample points are keyed with.

/// A bijection of 64 bits that avalanches: variant 13 of Stafford's finalisers (as in SplitMix64).
#[inline]
pub(super) const fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// The seed of one dimension of a batch.
#[inline(always)]
pub(super) fn dimension(key: u64, dimension: u32) -> u64 {
    let x = key ^ u64::from(dimension).wrapping_mul(0xD1B5_4A32_D192_ED03);
    let x = (x ^ (x >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
    let x = (x ^ (x >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
    x ^ (x >> 32)
}

/// 32 bits to 0 <= u < 1, by the upper 24: every value is exact, and a stratum stays a stratum.
#[inline(always)]
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}
