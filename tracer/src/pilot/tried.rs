//! What a method was found to be worth, and how two are compared.

use common::method::Method;

/// Pixels are compared in this many groups: the spread of a ratio is told from them.
pub(super) const GROUPS: usize = 16;
/// A pixel hangs on one sample that makes up more than this part of its variance ...
const ALONE: f64 = 0.25;
/// ... where batches vary by more than this part of what they would if samples knew nothing of each other.
const UNEVEN: f64 = 0.5;

/// What a method was found to be worth.
#[derive(Debug, Clone, Default)]
pub(super) struct Tried {
    pub(super) method: Method,
    /// Of each pixel, the variance of a sample over luminance^2 + 0.01.
    pub(super) variances: Vec<f64>,
    /// Of each pixel, where that comes from.
    pub(super) spreads: Vec<Spread>,
    pub(super) samples: u64,
    pub(super) work: f64,
}

/// Where a pixel's variance comes from; variances are over luminance^2 + 0.01.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spread {
    /// Variance of a sample as batch means tell it.
    pub(super) batches: f64,
    /// Variance of samples as if none knew of the others, as they do in a batch.
    pub(super) plain: f64,
    /// Variance that the ways of one path have among themselves; 0 where paths go on in one.
    pub(super) among_ways: f64,
    /// The part of `plain` that one sample makes up alone.
    pub(super) peak: f64,
}

impl Spread {
    fn hangs_on_one(&self) -> bool {
        self.peak > ALONE && self.batches > UNEVEN * self.plain
    }
}

/// Logarithm of a ratio of efficiencies, and its standard error.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gain {
    pub(super) log: f64,
    pub(super) error: f64,
}

impl Tried {
    pub(super) fn variance(&self) -> f64 {
        self.variances.iter().sum::<f64>() / self.variances.len().max(1) as f64
    }

    pub(super) fn cost(&self) -> f64 {
        self.work / self.samples.max(1) as f64
    }

    /// Variance x cost.
    pub(super) fn product(&self) -> f64 {
        self.variance() * self.cost()
    }

    /// Variance x cost in the first `few` pixels alone, up to a factor that is the same for all.
    pub(super) fn first_look(&self, few: usize) -> f64 {
        self.variances[..few].iter().sum::<f64>() * self.cost()
    }

    /// Take in what was found in other pixels.
    pub(super) fn add(&mut self, other: &Tried) {
        self.variances.extend(&other.variances);
        self.spreads.extend(&other.spreads);
        self.samples += other.samples;
        self.work += other.work;
    }

    /// Against `other`, looked at in the same pixels.
    pub(super) fn gain(&self, other: &Tried) -> Gain {
        gain(&self.variances, &other.variances, other.cost() / self.cost())
    }

    /// Against `one`, the same method with paths that go on in one way, looked at in the same pixels. No variance counts for less
    /// than `least`.
    ///
    /// Light that one path in many finds is found by one trial in these pixels and by another in those, by the one with more ways
    /// more often: variances that hang on single samples tell nothing when they are compared from trial to trial. But the
    /// samples with n ways alone tell what one way would do. By the law of total variance such a sample has the variance
    /// B + W / n, with B what the path before the ways varies by and W the ways of a given path (Arvo and Kirk 1990; Bolin and Meyer
    /// 1997; Rath et al. 2022, "EARS"), and W is what the ways of one path vary by among themselves. That holds of samples that
    /// know nothing of each other, and points spread evenly err less. So B + W serves as control variate: the
    /// variance measured with one way, plus B + W by the samples with n ways, less B + W by those with one. Light that is
    /// found once adds as much to a trial's variance as to its B + W, however evenly its points are spread, and falls out.
    ///
    /// This is done where one sample speaks for its pixel. Elsewhere what was measured needs no help, and B + W differs by the
    /// weights of multiple importance sampling, which know how many ways there are.
    pub(super) fn gain_of_ways(&self, one: &Tried, least: f64) -> Gain {
        let others = 1.0 - 1.0 / f64::from(self.method.splits.max(1));
        let floor = if least > 0.0 { least } else { f64::NEG_INFINITY };
        let of_one = |(ways, one): (&Spread, &Spread)| {
            let hangs = ways.hangs_on_one() || one.hangs_on_one();
            let expected = if hangs { ways.plain + ways.among_ways * others - one.plain } else { 0.0 };
            (one.batches + expected).max(floor)
        };
        let theirs: Vec<f64> = self.spreads.iter().zip(&one.spreads).map(of_one).collect();
        gain(&self.variances, &theirs, one.cost() / self.cost())
    }
}

/// Gain in efficiency of variances over others in the same pixels that cost `costs` times as much, with the jackknife over groups of
/// pixels.
fn gain(mine: &[f64], theirs: &[f64], costs: f64) -> Gain {
    let sums = |all: &[f64]| {
        let mut sums = [0.0; GROUPS];
        let group = all.len().div_ceil(GROUPS).max(1);
        sums.iter_mut().zip(all.chunks(group)).for_each(|(sum, pixels)| *sum = pixels.iter().sum());
        sums
    };
    let (my_sums, their_sums) = (sums(mine), sums(theirs));
    let (mine, theirs): (f64, f64) = (my_sums.iter().sum(), their_sums.iter().sum());
    let log = |mine: f64, theirs: f64| libm::log((theirs * costs / mine).clamp(1e-9, 1e9));
    let without = |i: usize| log(mine - my_sums[i], theirs - their_sums[i]);
    let mean = (0..GROUPS).map(without).sum::<f64>() / GROUPS as f64;
    let spread: f64 = (0..GROUPS).map(|i| (without(i) - mean) * (without(i) - mean)).sum();
    Gain { log: log(mine, theirs), error: (spread * (GROUPS - 1) as f64 / GROUPS as f64).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tried(splits: u32, spreads: Vec<Spread>, cost: f64) -> Tried {
        let method = Method { splits, ..Method::default() };
        let variances = spreads.iter().map(|spread| spread.batches).collect();
        Tried { method, samples: 1, work: cost, variances, spreads }
    }

    /// Trials with one way and with four, in which some pixels met light once, not the same ones; four ways meet it four times as often.
    #[test]
    fn rare_light_that_one_trial_met_speaks_for_neither() {
        let quiet = |n: f64| Spread {
            batches: 1.0 / n,
            plain: 4.0 / n,
            among_ways: if n > 1.0 { 4.0 } else { 0.0 },
            peak: 0.1,
        };
        let (mut one, mut four) = (vec![quiet(1.0); 160], vec![quiet(4.0); 160]);
        one[40] = Spread { batches: 16_000.0, plain: 16_000.0, peak: 1.0, among_ways: 0.0 };
        for i in (7..160).step_by(5) {
            // One way of one sample found it: B + W / 4 = W / 4.
            four[i] = Spread { batches: 1000.0, plain: 1000.0, peak: 1.0, among_ways: 4000.0 };
        }
        let (one, rare) = (tried(1, one, 1.0), tried(4, four.clone(), 3.0));
        let gain = rare.gain_of_ways(&one, 0.0);
        assert!((gain.log - libm::log(4.0 / 3.0)).abs() < 1e-3 && gain.error < 0.01, "{gain:?}");
        assert!(rare.gain(&one).log < -1.0, "what is seen by chance alone");
        // What comes before the ways does not vary less for more of them.
        four.iter_mut().filter(|spread| spread.peak > 0.5).for_each(|spread| spread.among_ways = 0.0);
        let gain = tried(4, four, 3.0).gain_of_ways(&one, 0.0);
        assert!((gain.log + libm::log(3.0)).abs() < 1e-2, "{gain:?}");
    }

    #[test]
    fn pixels_that_are_done_in_any_case_count_alike() {
        let spread = |batches| Spread { batches, plain: batches, peak: 1.0, among_ways: 0.0 };
        let mut four = tried(4, vec![spread(0.01); 32], 3.0);
        four.variances.fill(0.5);
        let gain = four.gain_of_ways(&tried(1, vec![spread(0.04); 32], 1.0), 0.5);
        assert!((gain.log + libm::log(3.0)).abs() < 1e-9, "{gain:?}");
    }

    #[test]
    fn a_gain_has_the_spread_of_its_groups() {
        let even = gain(&[1.0; 64], &[3.0; 64], 0.5);
        assert!((even.log - libm::log(1.5)).abs() < 1e-12 && even.error < 1e-12, "{even:?}");
        let uneven: Vec<f64> = (0..64).map(|i| if i < 32 { 2.0 } else { 4.0 }).collect();
        // The standard error of the mean of eight twos and eight fours, over three.
        let error = (1.0 / 15.0f64).sqrt() / 3.0;
        assert!((gain(&[1.0; 64], &uneven, 0.5).error / error - 1.0).abs() < 0.01);
    }
}
