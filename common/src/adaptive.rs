//! The stopping rule: from what is known of a pixel and its neighbours to how many batches it needs.
//!
//! Pure statistics. The coordinator plans passes with it, and the coverage study simulates it: both call
//! this module, so what is studied is what renders.
//!
//! The constants were chosen by the coverage study (docs/accuracy.md).
//!
//! The textbook rule looks at one pixel again and again and stops the first time its interval is short
//! enough. It thereby picks out the moments when light has been missed: where a bright event has
//! probability 0.01, most pixels stop at the first look. Five things keep this rule honest:
//! the samples still needed are predicted, so that there are few looks; the variance is the pixel's own
//! shrunk towards that of its neighbours, so that a pixel which has missed an event learns of it from those
//! that saw it, while neighbours that are significantly quieter have no say; batches that came out alike while
//! their samples did not are held for luck as long as they are few; the quantile is Student's; and zero
//! variance is never convergence.

use crate::film::Moments;

/// Batches of the pilot: every pixel of an adaptive frame gets these first.
pub const PILOT_BATCHES: u32 = 4;
/// A pass at most multiplies a pixel's batches by this.
pub const GROWTH: u32 = 2;
/// Predictions are multiplied by this, so that most pixels need one further pass, not two.
pub const SLACK: f64 = 1.02;
/// The normal quantile is widened by this, against the few looks that remain.
pub const WIDENING: f64 = 1.01;
/// A neighbour has no say in a pixel's variance where the pixel's own exceeds it by this many standard
/// deviations of the two estimates' ratio, sqrt(2 / f + 2 / g) with f and g degrees of freedom: noise is not
/// talked away by what is quiet, at the edge of a shadow or of an object.
pub const SIGNIFICANCE: f64 = 4.0;
/// Degrees of freedom that the neighbours count for at most: the more batches a pixel has of its own, the
/// less it needs them. More would cost samples where variances scatter (heavy tails), fewer would let a
/// pixel forget what only its neighbours saw.
pub const STRENGTH: u32 = 128;
/// Intervals are widened by this over their degrees of freedom: Student's quantile takes batch means for
/// normal, and the fewer they are the less they are so.
pub const FEW: f64 = 1.0;
/// A pixel's own variance is never taken for less than with one more batch that varied as this share of
/// independent samples would. Sixteen well-spread points hold the edge of a lamp as often as not in the same
/// number each time: four batches can then come out alike by luck, and nothing else would tell.
pub const LUCK: f64 = 0.5;
/// Share of pixels that must keep the target for the frame to count as having met it.
pub const FRAME_SHARE: f64 = 0.99;
/// Luminance below which the error is relative to this value instead of the pixel's own: one hundredth of
/// display white. Without a floor, pixels that are black but for rare light could never be finished.
pub const FLOOR: f64 = 0.01;

/// The numbers that the study may vary; `Default` is what renders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// See [`SLACK`].
    pub slack: f64,
    /// See [`WIDENING`].
    pub widening: f64,
    /// See [`SIGNIFICANCE`].
    pub significance: f64,
    /// See [`STRENGTH`].
    pub strength: u32,
    /// See [`FEW`].
    pub few: f64,
    /// See [`LUCK`].
    pub luck: f64,
    /// See [`PILOT_BATCHES`].
    pub pilot: u32,
}

impl Default for Constants {
    fn default() -> Self {
        Self {
            slack: SLACK,
            widening: WIDENING,
            significance: SIGNIFICANCE,
            strength: STRENGTH,
            few: FEW,
            luck: LUCK,
            pilot: PILOT_BATCHES,
        }
    }
}

/// The target and the limits of an adaptive frame.
#[derive(Debug, Clone)]
pub struct Rule {
    relative_error: f64,
    confidence: f64,
    batch: u32,
    max_batches: u32,
    constants: Constants,
    /// Normal quantile that Student's goes to.
    z: f64,
    quantiles: Vec<f64>,
}

/// Degrees of freedom up to which quantiles are tabled; beyond, the expansion about the normal one is good
/// to five digits.
const TABLED: u64 = 64;

/// What the rule says of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Half-width of the interval of its luminance; infinite where nothing is known.
    pub half_width: f64,
    /// Half-width relative to max(luminance, [`FLOOR`]).
    pub relative: f64,
    /// Standard error of its luminance, from the variance that the interval rests on; infinite where
    /// nothing is known.
    pub standard_error: f64,
    /// Whether it keeps the target.
    pub met: bool,
    /// Batches it should have after the next pass; its present number where it should get none.
    pub batches: u32,
    /// Batches it is expected to have in the end.
    pub goal: u32,
}

impl Rule {
    /// A rule for pixels whose samples come in batches of `batch`.
    #[must_use]
    pub fn new(relative_error: f64, confidence: f64, max_samples: u32, batch: u32) -> Self {
        Self::with(Constants::default(), relative_error, confidence, max_samples, batch)
    }

    /// The same with other constants: for the study of what they do.
    #[must_use]
    pub fn with(constants: Constants, relative_error: f64, confidence: f64, max_samples: u32, batch: u32) -> Self {
        let z = normal_quantile(0.5 + 0.5 * confidence) * constants.widening;
        let probability = normal_cdf(z);
        let quantiles = (1..=TABLED).map(|dof| student_quantile(probability, dof as f64)).collect();
        let max_batches = max_samples.div_ceil(batch.max(1)).max(1);
        Self { relative_error, confidence, batch: batch.max(1), max_batches, constants, z, quantiles }
    }

    /// Most batches a pixel may get.
    #[must_use]
    pub fn max_batches(&self) -> u32 {
        self.max_batches
    }

    /// Batches of the first pass.
    #[must_use]
    pub fn pilot(&self) -> u32 {
        self.constants.pilot.min(self.max_batches)
    }

    /// Samples of a batch.
    #[must_use]
    pub fn batch(&self) -> u32 {
        self.batch
    }

    /// Share of intervals that are to hold the truth.
    #[must_use]
    pub fn confidence(&self) -> f64 {
        self.confidence
    }

    /// Whether a frame in which every pixel has stopped must be gone over again, with every pixel judged anew:
    /// what pixels learnt later may tell that neighbours stopped too early. So it is while the target is
    /// missed and can still be met, or more pixels than may miss it can still be helped. `verdicts` are those
    /// of the whole frame, with each pixel's batches.
    #[must_use]
    pub fn unsettled(&self, verdicts: impl Iterator<Item = (u32, Verdict)>) -> bool {
        let (mut all, mut full, mut helpable) = (0u64, 0u64, 0u64);
        for (batches, verdict) in verdicts {
            all += 1;
            full += u64::from(!verdict.met && batches >= self.max_batches);
            helpable += u64::from(!verdict.met && batches < self.max_batches);
        }
        let too_many = |pixels: u64| pixels as f64 > (1.0 - FRAME_SHARE) * all as f64;
        too_many(helpable) || (helpable > 0 && too_many(full + helpable) && !too_many(full))
    }

    /// Judge a pixel by itself and the pixels around it (`around` holds the pixel too; three by three,
    /// fewer at the edges of the frame).
    #[must_use]
    pub fn judge<'a>(&self, own: &Moments, around: impl IntoIterator<Item = &'a Moments>) -> Verdict {
        let scale = own.luminance().abs().max(FLOOR);
        let allowed = self.relative_error * scale;
        if own.known {
            let batches = own.batches;
            return Verdict { half_width: 0.0, relative: 0.0, standard_error: 0.0, met: true, batches, goal: batches };
        }
        let (half_width, standard_error) = self.half_width(own, around);
        let met = half_width <= allowed && half_width > 0.0;
        let wanted = if met {
            own.batches
        } else if half_width > 0.0 && half_width.is_finite() {
            predicted_with(own.batches, half_width / allowed, self.constants.slack)
        } else {
            u32::MAX
        };
        let grown = own.batches.saturating_mul(GROWTH).max(own.batches.saturating_add(1));
        let batches = wanted.min(grown).min(self.max_batches).max(own.batches);
        let (half_width, standard_error) =
            if half_width > 0.0 { (half_width, standard_error) } else { (f64::INFINITY, f64::INFINITY) };
        let goal = wanted.clamp(own.batches, self.max_batches.max(own.batches));
        Verdict { half_width, relative: half_width / scale, standard_error, met, batches, goal }
    }

    /// Half-width of the interval of the luminance, Student's quantile times the standard error, and that error.
    /// The variance is the pixel's own and that of the neighbours with a say, each weighing its degrees of
    /// freedom, the neighbours together at most [`STRENGTH`] of them; but see [`LUCK`]. 0 where no batch differed from another,
    /// infinite below two batches.
    fn half_width<'a>(&self, own: &Moments, around: impl IntoIterator<Item = &'a Moments>) -> (f64, f64) {
        if own.batches < 2 {
            return (f64::INFINITY, f64::INFINITY);
        }
        let own_dof = f64::from(own.batches - 1);
        let own_variance = own.m2 / own_dof;
        // The pixel itself is one of those around it: it always has its say, and is taken off again.
        let (mut m2, mut dof) = (-own.m2, -own_dof);
        for pixel in around {
            if pixel.batches >= 2 && !pixel.known {
                let its_dof = f64::from(pixel.batches - 1);
                let scatter = (2.0 / own_dof + 2.0 / its_dof).sqrt();
                if own_variance <= pixel.m2 / its_dof * (1.0 + self.constants.significance * scatter) {
                    m2 += pixel.m2;
                    dof += its_dof;
                }
            }
        }
        let strength = dof.clamp(0.0, f64::from(self.constants.strength));
        let neighbours = if dof > 0.0 { m2.max(0.0) / dof } else { 0.0 };
        let total = own_dof + strength;
        let pooled = (own.m2 + strength * neighbours) / total;
        let unlucky = (own.m2 + self.constants.luck * own.variance_within()) / (own_dof + 1.0);
        let variance = if unlucky > pooled { unlucky } else { pooled };
        let error = (variance / f64::from(own.samples)).sqrt();
        let few = 1.0 + self.constants.few / total;
        (few * self.quantile(total as u64) * error, error)
    }

    fn quantile(&self, dof: u64) -> f64 {
        match dof {
            0..=TABLED => self.quantiles[dof.saturating_sub(1) as usize],
            _ => student_quantile_near_normal(self.z, dof as f64),
        }
    }
}

/// Batches that bring an interval which is `ratio` times too wide, above 1, to its target; at least one more
/// than `batches`.
#[must_use]
pub fn predicted(batches: u32, ratio: f64) -> u32 {
    predicted_with(batches, ratio, SLACK)
}

fn predicted_with(batches: u32, ratio: f64, slack: f64) -> u32 {
    ceil_to_u32(f64::from(batches) * ratio * ratio * slack).max(batches.saturating_add(1))
}

fn ceil_to_u32(x: f64) -> u32 {
    // `as` saturates, which is what is wanted here.
    x.ceil() as u32
}

/// Distribution function of the standard normal distribution.
#[must_use]
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// Quantile of the standard normal distribution, for probabilities between 0 and 1.
#[must_use]
pub fn normal_quantile(probability: f64) -> f64 {
    invert(probability, normal_cdf)
}

/// Quantile of Student's t distribution with `dof` degrees of freedom.
///
/// In this crate and not from a library because plans are part of a picture's bits: it uses only
/// operations that give the same bits on every machine.
#[must_use]
pub fn student_quantile(probability: f64, dof: f64) -> f64 {
    invert(probability, |t| {
        let tail = 0.5 * incomplete_beta(dof / (dof + t * t), 0.5 * dof, 0.5);
        if t >= 0.0 { 1.0 - tail } else { tail }
    })
}

/// Student's quantile from the normal one `z`, for many degrees of freedom: the first terms of the
/// expansion in 1/dof (Abramowitz and Stegun 26.7.5).
fn student_quantile_near_normal(z: f64, dof: f64) -> f64 {
    let z2 = z * z;
    let g1 = (z2 + 1.0) * z / 4.0;
    let g2 = ((5.0 * z2 + 16.0) * z2 + 3.0) * z / 96.0;
    let g3 = (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) * z / 384.0;
    z + (g1 + (g2 + g3 / dof) / dof) / dof
}

/// Invert an increasing distribution function that is symmetric about 0, by bisection to the last bits.
fn invert(probability: f64, cdf: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (-1e6, 1e6);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if cdf(middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Regularised incomplete beta function by its continued fraction (DLMF 8.17.22, Lentz's method).
fn incomplete_beta(x: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return if x <= 0.0 { 0.0 } else { 1.0 };
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(1.0 - x, b, a);
    }
    let front =
        libm::exp(libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b) + a * libm::log(x) + b * libm::log1p(-x)) / a;
    let tiny = 1e-300;
    let guard = |v: f64| if v.abs() < tiny { tiny } else { v };
    let (mut c, mut d) = (1.0, 1.0 / guard(1.0 - (a + b) * x / (a + 1.0)));
    let mut f = d;
    for m in 1..500 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / guard(1.0 + even * d);
        c = guard(1.0 + even / c);
        f *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / guard(1.0 + odd * d);
        c = guard(1.0 + odd / c);
        let step = d * c;
        f *= step;
        if (step - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * f
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

    #[test]
    fn quantiles_are_those_of_the_library() {
        let normal = Normal::standard();
        for p in [0.6, 0.9, 0.975, 0.995, 0.9999] {
            assert!((normal_quantile(p) - normal.inverse_cdf(p)).abs() < 1e-8, "{p}");
            for dof in [1.0, 2.0, 3.0, 7.0, 27.0, 65.0, 400.0, 2048.0] {
                let expected = StudentsT::new(0.0, 1.0, dof).unwrap().inverse_cdf(p);
                let found = student_quantile(p, dof);
                assert!((found / expected - 1.0).abs() < 1e-6, "p {p} dof {dof}: {found} {expected}");
                if dof > 64.0 {
                    let near = student_quantile_near_normal(normal_quantile(p), dof);
                    assert!((near / expected - 1.0).abs() < 1e-5, "p {p} dof {dof}: {near} {expected}");
                }
            }
        }
    }

    fn pixel(batches: &[f64]) -> Moments {
        batches.iter().fold(Moments::default(), |sum, &v| sum.merge(Moments::batch(16, [v; 3])))
    }

    fn rule() -> Rule {
        Rule::new(0.05, 0.95, 4096, 16)
    }

    #[test]
    fn zero_variance_is_not_convergence_unless_it_is_known() {
        let black = pixel(&[0.0; 4]);
        let verdict = rule().judge(&black, [&black]);
        assert!(!verdict.met && verdict.half_width.is_infinite());
        assert_eq!(verdict.batches, 8);
        let known = Moments { known: true, ..black };
        let verdict = rule().judge(&known, [&known]);
        assert!(verdict.met);
        assert_eq!((verdict.batches, verdict.half_width), (4, 0.0));
    }

    #[test]
    fn a_pixel_that_missed_an_event_learns_of_it_from_its_neighbour() {
        let (quiet, lit) = (pixel(&[1.0, 1.001, 1.0, 0.999]), pixel(&[1.0, 9.0, 1.0, 1.0]));
        assert!(rule().judge(&quiet, [&quiet]).met);
        assert!(!rule().judge(&quiet, [&quiet, &lit]).met);
        // And a noisy pixel is not talked out of its noise by quiet ones, however many batches those have.
        let (quiet, noisy) = (pixel(&[1.0, 1.001].repeat(32)), pixel(&[0.0, 3.0].repeat(32)));
        let around: Vec<&Moments> = std::iter::once(&noisy).chain(std::iter::repeat_n(&quiet, 8)).collect();
        let alone = rule().judge(&noisy, [&noisy]).half_width;
        assert_eq!(rule().judge(&noisy, around).half_width, alone);
    }

    #[test]
    fn the_more_batches_a_pixel_has_the_less_it_needs_its_neighbours() {
        // Variances 1 and 4 of batch means, so that neighbours have their say.
        let width = |n: usize| {
            let (own, other) = (pixel(&[0.0, 2.0].repeat(n)), pixel(&[-1.0, 3.0].repeat(n)));
            let around: Vec<&Moments> = std::iter::once(&own).chain(std::iter::repeat_n(&other, 8)).collect();
            rule().judge(&own, around).half_width / rule().judge(&own, [&own]).half_width
        };
        let (few, many) = (width(4), width(2048));
        assert!((1.2..2.0).contains(&few) && (1.0..1.05).contains(&many), "{few} {many}");
    }

    #[test]
    fn batches_that_come_out_alike_by_luck_are_not_taken_for_certainty() {
        // A lamp over three quarters of a sixteenth of a pixel: each batch held it once.
        let once = |batches: u32| {
            (0..batches).fold(Moments::default(), |sum, _| {
                let within = 15.0 / 16.0 * 24.0f64.powi(2);
                sum.merge(Moments { within, ..Moments::batch(16, [1.5 + 1e-3 * f64::from(sum.batches % 2); 3]) })
            })
        };
        let rule = Rule::new(0.2, 0.95, 4096, 16);
        let quiet = pixel(&[0.1, 0.1001, 0.1, 0.0999]);
        let judge = |pixel: &Moments| rule.judge(pixel, [pixel, &quiet, &quiet, &quiet]);
        assert!(!judge(&once(4)).met, "{:?}", judge(&once(4)));
        assert!(judge(&once(64)).met, "sixty-four times is no luck: {:?}", judge(&once(64)));
        assert!(judge(&Moments { within: 0.0, ..once(4) }).met, "it is the spread within batches that tells");
    }

    #[test]
    fn the_prediction_is_the_square_of_the_ratio_with_slack_and_bounded_growth() {
        let values: Vec<f64> = (0..64).map(|i| if i % 2 == 0 { 0.8 } else { 1.2 }).collect();
        let own = pixel(&values);
        let verdict = rule().judge(&own, [&own]);
        let expected = (64.0 * (verdict.relative / 0.05).powi(2) * SLACK).ceil();
        assert!(!verdict.met && expected < 128.0, "{verdict:?}");
        assert_eq!(f64::from(verdict.batches), expected);
        let noisy = pixel(&[0.0, 9.0, 0.0, 0.0]);
        assert_eq!(rule().judge(&noisy, [&noisy]).batches, 8, "never more than doubled");
        let capped = Rule::new(0.05, 0.95, 80, 16);
        assert_eq!(capped.judge(&noisy, [&noisy]).batches, 5);
    }

    #[test]
    fn one_batch_knows_nothing() {
        let own = pixel(&[1.0]);
        let verdict = rule().judge(&own, [&own]);
        assert!(!verdict.met && verdict.half_width.is_infinite());
        assert_eq!(verdict.batches, 2);
    }
}
