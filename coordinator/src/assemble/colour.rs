//! Colour maps: a perceptually even one for amounts, and one for signed amounts.

/// viridis (van der Walt and Smith 2015) as the polynomial of degree 6 that Zucker fitted to its table:
/// coefficients of rising powers, for red, green and blue in sRGB.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.277_727_327_223_417_7, 0.005_407_344_544_966_578, 0.334_099_805_335_306_1],
    [0.105_093_043_108_577_4, 1.404_613_529_898_575, 1.384_590_162_594_685],
    [-0.330_861_828_725_556_3, 0.214_847_559_468_213, 0.095_095_163_028_236_59],
    [-4.634_230_498_983_486, -5.799_100_973_351_585, -19.332_440_956_279_87],
    [6.228_269_936_347_081, 14.179_933_366_805_09, 56.690_552_600_681_05],
    [4.776_384_997_670_288, -13.745_145_377_746_01, -65.353_032_633_372_34],
    [-5.435_455_855_934_631, 4.645_852_612_178_535, 26.312_435_249_583_2],
];

/// The colour at `t`, 0 to 1, as sRGB bytes: dark violet to yellow.
pub(super) fn viridis(t: f64) -> [u8; 3] {
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
    std::array::from_fn(|channel| {
        let value = VIRIDIS.iter().rev().fold(0.0, |sum, power| sum * t + power[channel]);
        (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
    })
}

/// The ends of [`balance`], in sRGB: sky blue and orange of the palette of Okabe and Ito, which colour-blind
/// readers tell apart.
const BELOW: [f64; 3] = [86.0, 180.0, 233.0];
const ABOVE: [f64; 3] = [230.0, 159.0, 0.0];

/// The colour at `t` as sRGB bytes: black in the middle, at 0.5, blue towards 0 and orange towards 1.
pub(super) fn balance(t: f64) -> [u8; 3] {
    let t = if t.is_nan() { 0.5 } else { t.clamp(0.0, 1.0) };
    let (end, share) = if t < 0.5 { (BELOW, 1.0 - 2.0 * t) } else { (ABOVE, 2.0 * t - 1.0) };
    end.map(|value| (value * share + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_have_a_colour_each_and_zero_is_black() {
        assert_eq!([0.0, 0.5, 1.0].map(balance), [[86, 180, 233], [0; 3], [230, 159, 0]]);
        assert_eq!((balance(-3.0), balance(f64::INFINITY), balance(f64::NAN)), (balance(0.0), balance(1.0), [0; 3]));
    }

    #[test]
    fn the_map_is_near_the_published_table_and_grows_lighter_evenly() {
        // Entries 0, 64, 128, 191 and 255 of matplotlib's table.
        for (t, [r, g, b]) in [
            (0.0, [68, 1, 84]),
            (0.251, [59, 82, 139]),
            (0.502, [33, 145, 140]),
            (0.749, [94, 201, 98]),
            (1.0, [253, 231, 37]),
        ] {
            let found = viridis(t);
            for (a, b) in found.into_iter().zip([r, g, b]) {
                assert!(i32::from(a).abs_diff(b) <= 8, "{t}: {found:?}");
            }
        }
        let light = |i: u32| {
            let [r, g, b] = viridis(f64::from(i) / 100.0).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        assert!((1..=100).all(|i| light(i) > light(i - 1) - 0.6));
    }
}
