//! Pearson's chi-square test: do samples fall where the density says?

use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::{Directions, Rng};
use crate::math::Vec3;

/// Cells of the unit square along the angle and along the azimuth.
const CELLS: [usize; 2] = [16, 24];
/// Cells that expect fewer samples are pooled.
const LEAST_EXPECTED: f64 = 10.0;
/// Chance that any of a test's comparisons fails although nothing is wrong. Seeds are fixed, so a test
/// that passes once passes always.
const SIGNIFICANCE: f64 = 0.01;

/// One comparison of a sampler of directions with its density.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ChiSquare<'a> {
    /// Told when the comparison fails.
    pub name: &'a str,
    /// Where the density is: its main direction and its width.
    pub directions: Directions,
    /// Samples to draw.
    pub samples: u32,
    /// How many comparisons the calling test makes: the level of each is corrected for it (Sidak).
    pub comparisons: u32,
    /// How far the density told with a sample may be from that evaluated at it, relative.
    pub agreement: f32,
}

/// Compare `sample` with `pdf`, and panic where they differ.
///
/// `sample` draws one direction with its density over solid angle, or `None` where it draws none; a
/// direction of a delta lobe counts as none. `pdf` is the density evaluated for any direction. Besides
/// where the samples fall this checks that no sample has density 0 or one that is not finite, that both
/// densities agree, and that the density integrates to the share of draws that gave a direction.
///
/// ```ignore
/// chi_square(
///     ChiSquare { name: "cosine", directions: Directions::about(Vec3::Z, 1.0), samples: 100_000, comparisons: 1, agreement: 1e-3 },
///     |rng| { let wi = cosine_hemisphere(rng.next_2d()); Some((wi, wi.z * INV_PI)) },
///     |wi| wi.z.max(0.0) * INV_PI,
/// );
/// ```
pub(crate) fn chi_square(
    test: ChiSquare,
    mut sample: impl FnMut(&mut Rng) -> Option<(Vec3, f32)>,
    pdf: impl Fn(Vec3) -> f32,
) {
    let ChiSquare { name, directions, samples, comparisons, agreement } = test;
    let mut rng = Rng::new(name.bytes().fold(1, |hash, byte| hash * 31 % 1_000_003 + u64::from(byte)));
    let mut counts = vec![0u32; CELLS[0] * CELLS[1]];
    let mut none = 0u32;
    for _ in 0..samples {
        let Some((direction, told)) = sample(&mut rng) else {
            none += 1;
            continue;
        };
        let evaluated = pdf(direction);
        assert!(
            evaluated > 0.0 && evaluated.is_finite(),
            "{name}: the direction {direction:?} was drawn with density {told} and has density {evaluated}"
        );
        assert!(
            (told - evaluated).abs() <= agreement * evaluated,
            "{name}: {direction:?} has density {told} when drawn and {evaluated} when evaluated"
        );
        let (u, v) = directions.coordinates(direction);
        let row = ((u * CELLS[0] as f64) as usize).min(CELLS[0] - 1);
        let column = ((v * CELLS[1] as f64) as usize).min(CELLS[1] - 1);
        counts[row * CELLS[1] + column] += 1;
    }

    let mut cells: Vec<(f64, f64)> = Vec::with_capacity(counts.len() + 1);
    // The cell that contributes most to the statistic, told when the comparison fails.
    let mut worst = (0.0, String::new());
    let mut total = 0.0;
    for (i, &count) in counts.iter().enumerate() {
        let (row, column) = (i / CELLS[1], i % CELLS[1]);
        let corner = |r: usize, c: usize| [r as f64 / CELLS[0] as f64, c as f64 / CELLS[1] as f64];
        // A twentieth of a sample a cell is far below the noise.
        let tolerance = 0.05 / f64::from(samples);
        let share = directions
            .integrate_part(corner(row, column), corner(row + 1, column + 1), tolerance, &mut |d| pdf(d).into());
        assert!(share.is_finite(), "{name}: the density is not finite in cell {row}, {column}");
        total += share;
        let (expected, observed) = (share * f64::from(samples), f64::from(count));
        let term = (observed - expected) * (observed - expected) / expected.max(LEAST_EXPECTED);
        if term > worst.0 {
            let (middle, _) =
                directions.at((row as f64 + 0.5) / CELLS[0] as f64, (column as f64 + 0.5) / CELLS[1] as f64);
            worst = (term, format!("cell {row}, {column} about {middle:?} has {observed}, expects {expected:.1}"));
        }
        cells.push((expected, observed));
    }
    assert!(total < 1.0 + 1e-3, "{name}: the density integrates to {total}");
    cells.push(((1.0 - total).max(0.0) * f64::from(samples), f64::from(none)));

    // Pool the cells that expect little, smallest first.
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut statistic, mut degrees, mut pool) = (0.0, 0.0, (0.0, 0.0));
    for (expected, observed) in cells {
        if pool.0 < LEAST_EXPECTED || expected < LEAST_EXPECTED {
            pool = (pool.0 + expected, pool.1 + observed);
            if pool.0 < LEAST_EXPECTED {
                continue;
            }
            statistic += (pool.1 - pool.0) * (pool.1 - pool.0) / pool.0;
            degrees += 1.0;
            pool = (0.0, 0.0);
            continue;
        }
        statistic += (observed - expected) * (observed - expected) / expected;
        degrees += 1.0;
    }
    // What is left of the pool expects next to nothing; more than that many samples in it is an error.
    assert!(pool.1 <= pool.0 + 6.0 * pool.0.sqrt() + 3.0, "{name}: {} samples where {} are expected", pool.1, pool.0);
    if degrees < 2.0 {
        return;
    }
    let p = ChiSquared::new(degrees - 1.0).expect("at least one degree of freedom").sf(statistic);
    let level = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / f64::from(comparisons.max(1)));
    assert!(
        p > level,
        "{name}: chi-square {statistic:.1} with {degrees} cells, p = {p:.2e} below {level:.2e}; \
         density integrates to {total:.5}, {none} of {samples} draws gave no direction; {}",
        worst.1
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{INV_PI, cosine_hemisphere};

    /// Draw from the cosine density, and claim one that leans towards x by `error`.
    fn cosine(error: f32, samples: u32) {
        let claimed = |wi: Vec3| wi.z.max(0.0) * INV_PI * (1.0 + error * wi.x);
        chi_square(
            ChiSquare {
                name: "cosine",
                directions: Directions::about(Vec3::Z, 1.0),
                samples,
                comparisons: 1,
                agreement: 1e-3,
            },
            |rng| {
                let wi = cosine_hemisphere(rng.next_2d());
                Some((wi, claimed(wi)))
            },
            claimed,
        );
    }

    #[test]
    fn a_right_density_passes() {
        cosine(0.0, 200_000);
    }

    #[test]
    #[should_panic(expected = "chi-square")]
    fn a_density_that_is_off_by_two_percent_fails() {
        cosine(0.04, 1_000_000);
    }
}
