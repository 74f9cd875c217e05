//! Random orders of a batch's points.
//!
//! The order must be a permutation without structure. A nested shuffle, which keeps every prefix of the
//! batch even, pairs neighbours in all dimensions alike: products over two dimensions then spread up to
//! twice as far as chance (`tests.rs` measures it).

use super::hash::mix;

/// The place of point `i` of `n` in an order chosen by `seed`.
#[inline]
pub(super) fn permute(i: u32, n: u32, seed: u32) -> u32 {
    if n == TABLED { permute16(i, seed) } else { kensler(i, n, seed) }
}

/// Number of points whose orders are tabled.
pub(super) const TABLED: u32 = 16;

/// Orders of sixteen points, four bits a place. 512 of them, 4 KiB, times 16 exclusive-ors.
static ORDERS: [u64; 512] = orders();

const fn orders() -> [u64; 512] {
    let mut table = [0; 512];
    let mut state = 0u64;
    let mut t = 0;
    while t < table.len() {
        // Fisher and Yates's shuffle.
        let mut order = [0u64; 16];
        let mut i = 0;
        while i < 16 {
            state = state.wrapping_add(1);
            let j = (mix(state) >> 32) as usize % (i + 1);
            order[i] = order[j];
            order[j] = i as u64;
            i += 1;
        }
        let mut packed = 0;
        i = 0;
        while i < 16 {
            packed |= order[i] << (4 * i);
            i += 1;
        }
        table[t] = packed;
        t += 1;
    }
    table
}

/// The same for [`TABLED`] points.
#[inline(always)]
pub(super) fn permute16(i: u32, seed: u32) -> u32 {
    let order = ORDERS[(seed >> 4) as usize % ORDERS.len()];
    ((order >> (4 * (i & 15))) as u32 ^ seed) & 15
}

/// Kensler 2013, "Correlated Multi-Jittered Sampling", listing 2.
#[inline]
fn kensler(mut i: u32, n: u32, seed: u32) -> u32 {
    let w = n.next_power_of_two() - 1;
    loop {
        i = stir(i, w, seed);
        if i < n {
            return (u64::from(i) + u64::from(seed)).rem_euclid(u64::from(n)) as u32;
        }
    }
}

/// The same where `n` is a power of two. Without branches, so that loops over it become vector code.
#[inline(always)]
pub(super) fn permute_power_of_two(i: u32, n: u32, seed: u32) -> u32 {
    stir(i, n - 1, seed).wrapping_add(seed) & (n - 1)
}

/// A permutation of 0 to `w`, which is a power of two less one.
#[inline(always)]
fn stir(mut i: u32, w: u32, seed: u32) -> u32 {
    i ^= seed;
    i = i.wrapping_mul(0xE170_893D);
    i ^= seed >> 16;
    i ^= (i & w) >> 4;
    i ^= seed >> 8;
    i = i.wrapping_mul(0x0929_EB3F);
    i ^= seed >> 23;
    i ^= (i & w) >> 1;
    i = i.wrapping_mul(1 | (seed >> 27));
    i = i.wrapping_mul(0x6935_FA69);
    i ^= (i & w) >> 11;
    i = i.wrapping_mul(0x74DC_B303);
    i ^= (i & w) >> 2;
    i = i.wrapping_mul(0x9E50_1CC3);
    i ^= (i & w) >> 2;
    i = i.wrapping_mul(0xC860_A3DF);
    i &= w;
    i ^= i >> 5;
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_permutation_meets_every_index_once() {
        for n in [1, 2, 3, 7, 8, 16, 33, 1000] {
            for seed in (0..600).map(|i: u32| i.wrapping_mul(0x9E37_79B9)) {
                let mut seen = vec![false; n as usize];
                (0..n).for_each(|i| seen[permute(i, n, seed) as usize] = true);
                assert!(seen.iter().all(|&s| s), "{n} {seed}");
            }
        }
    }

    #[test]
    fn powers_of_two_need_no_second_try() {
        for n in [1, 2, 4, 8, 16, 64, 4096] {
            for seed in (0..300).map(|i: u32| i.wrapping_mul(0x9E37_79B9)) {
                assert!((0..n).all(|i| permute_power_of_two(i, n, seed) == kensler(i, n, seed)), "{n} {seed}");
            }
        }
    }

    #[test]
    fn pairs_of_points_go_everywhere_alike() {
        // (place of a, place of b) over seeds: 240 pairs of different places, equally likely.
        const SEEDS: u64 = 1 << 16;
        for (a, b) in [(0, 1), (3, 12), (7, 8), (14, 15)] {
            let mut counts = [0.0f64; 256];
            for seed in 0..SEEDS {
                let seed = mix(seed) as u32;
                counts[(permute(a, 16, seed) * 16 + permute(b, 16, seed)) as usize] += 1.0;
            }
            let expected = SEEDS as f64 / 240.0;
            for (pair, n) in counts.iter().enumerate() {
                let ratio = n / expected;
                // The table holds 512 of 16! orders, so an offset between two places is met 34 times, give or take.
                assert!(if pair % 17 == 0 { ratio == 0.0 } else { (0.4..1.8).contains(&ratio) }, "{pair} {ratio}");
            }
        }
    }
}
