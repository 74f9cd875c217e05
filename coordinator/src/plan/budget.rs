//! The best picture for a budget: the worst pixels first.
//!
//! After the pilot a frame goes through rounds. Before each, the relative error is found to which its pixels
//! can be brought, as predicted, with what is left of the frame's budget; then every pixel gets what it needs
//! for that, but no more than it has. What a round really cost and showed steers the next one.
//!
//! What counts is the error that [`FRAME_SHARE`] of the pixels keep to, as it is for a noise target: the worst
//! of them are treated like the one at that quantile. Else a few black pixels beside a noisy edge, whose
//! relative error is thousands of percent, would take all there is.
//!
//! Here measured time chooses samples, so two renders with the same budget differ. It knows nothing of who
//! measures: costs and what is left come in.

use common::{
    adaptive::{self, FRAME_SHARE, GROWTH, Verdict, normal_quantile},
    film::Moments,
    job::DEFAULT_CONFIDENCE,
    pass::{BATCH, Work},
    tile::Rect,
};
use serde::{Deserialize, Serialize};

use super::{Field, Step};

/// Less than this share of a frame's budget is not worth another round.
pub const LEAST_SHARE: f64 = 0.01;

/// What all tiles of a frame do in one pass.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// The pass.
    pub pass: u32,
    /// Where pixels are to be brought.
    pub aim: Aim,
}

/// Where the pixels of a frame are to be brought.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aim {
    /// Relative error that they are to keep to.
    pub level: f64,
    /// A relative error above this counts as this.
    pub worst: f64,
}

/// What a frame may spend: its share of what the frames that are done have left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Purse {
    /// Processor seconds of the whole job.
    pub budget: f64,
    /// Spent on frames that are done.
    pub spent_before: f64,
    /// Frames that are not done, this one among them.
    pub frames_left: usize,
    /// Spent on this frame.
    pub spent: f64,
    /// Spent on the whole job.
    pub spent_in_all: f64,
}

impl Purse {
    /// Processor seconds that this frame may still spend; 0 where that is not worth a round.
    #[must_use]
    pub fn left(&self) -> f64 {
        let share = (self.budget - self.spent_before) / self.frames_left.max(1) as f64;
        let left = (share - self.spent).min(self.budget - self.spent_in_all);
        if left > LEAST_SHARE * share { left } else { 0.0 }
    }
}

/// What a pixel could use.
#[derive(Debug, Clone, Copy)]
struct Need {
    batches: u32,
    relative: f64,
    /// Processor seconds of a batch.
    cost: f64,
}

/// What can be afforded with `left` processor seconds; `None` where not even one batch can,
/// or no pixel can use any. `tiles` are all tiles of the frame, each with its measured processor seconds per
/// sample.
#[must_use]
pub fn aim(field: Field<'_>, tiles: &[(Rect, f64)], max_samples: u32, left: f64) -> Option<Aim> {
    let rule = judge();
    let most = max_samples.div_ceil(BATCH);
    let mut needs = Vec::new();
    for &(rect, per_sample) in tiles {
        let cost = per_sample * f64::from(BATCH);
        for (own, verdict) in field.judge(&rule, rect) {
            let relative = relative(own, &verdict);
            if own.batches < most && relative > 0.0 {
                needs.push(Need { batches: own.batches, relative, cost });
            }
        }
    }
    if needs.is_empty() || left <= 0.0 {
        return None;
    }
    let at = (((needs.len() as f64) * FRAME_SHARE) as usize).min(needs.len() - 1);
    let worst = needs.select_nth_unstable_by(at, |a, b| a.relative.total_cmp(&b.relative)).1.relative;
    let price = |level: f64| -> f64 {
        let aim = Aim { level, worst };
        needs.iter().map(|n| f64::from(wanted(n.batches, n.relative, aim, most) - n.batches) * n.cost).sum()
    };
    // Between a level that takes every pixel to the most samples and one that asks for none.
    let (mut low, mut high) = (worst * 1e-6, worst);
    if price(low) <= left {
        high = low;
    }
    for _ in 0..50 {
        let middle = (low * high).sqrt();
        if price(middle) <= left {
            high = middle;
        } else {
            low = middle;
        }
    }
    (price(high) > 0.0).then_some(Aim { level: high, worst })
}

/// Plan a tile's part of a round.
#[must_use]
pub fn next(aim: Aim, max_samples: u32, tile: Rect, around: Field<'_>) -> Step {
    let most = max_samples.div_ceil(BATCH);
    let (mut first, mut batches) = (Vec::with_capacity(tile.area()), Vec::with_capacity(tile.area()));
    let (mut after, mut goal) = (0u64, 0u64);
    for (own, verdict) in around.judge(&judge(), tile) {
        let wanted = wanted(own.batches, relative(own, &verdict), aim, most);
        let now = wanted.min(own.batches.saturating_mul(GROWTH));
        first.push(own.batches);
        batches.push(now - own.batches);
        after += u64::from(now);
        goal += u64::from(wanted);
    }
    if batches.iter().all(|&n| n == 0) {
        return Step::Finished;
    }
    Step::Render { work: Work::PerPixel { first, batches }, share: after as f64 / goal.max(1) as f64 }
}

/// Batches that a pixel should have in the end.
fn wanted(batches: u32, relative: f64, aim: Aim, most: u32) -> u32 {
    let relative = relative.min(aim.worst);
    if relative > aim.level {
        adaptive::predicted(batches, relative / aim.level).clamp(batches, most.max(batches))
    } else {
        batches
    }
}

/// Where no batch of a pixel or its neighbours differs from another, and it is not known why, the pixel is
/// taken to vary by as much as the rule's floor from sample to sample, until it shows: it gets its share, but
/// does not take everything.
fn relative(own: &Moments, verdict: &Verdict) -> f64 {
    if verdict.relative.is_finite() {
        verdict.relative
    } else {
        normal_quantile(0.5 + 0.5 * DEFAULT_CONFIDENCE) / f64::from(own.samples.max(1)).sqrt()
    }
}

fn judge() -> adaptive::Rule {
    adaptive::Rule::new(f64::INFINITY, DEFAULT_CONFIDENCE, u32::MAX, BATCH)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECT: Rect = Rect { x: 0, y: 0, w: 64, h: 32 };

    /// SplitMix64 to [0, 1).
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Columns of growing noise, and beside quiet ones some where nothing is ever seen.
    fn batch(x: u32, state: &mut u64) -> Moments {
        let noise = if x >= 57 { 0.001 } else { f64::from(x % 16) / 16.0 };
        let value = if x >= 60 { 0.0 } else { 1.0 + noise * (random(state) - 0.5) };
        Moments::batch(BATCH, [value; 3])
    }

    /// Render under a budget with simulated costs, jittered by a fifth; two tiles, one three times as dear.
    /// Returns the moments, what was spent, and the rounds.
    fn render(budget: f64) -> (Vec<Moments>, f64, u32) {
        let tiles = [Rect { w: 32, ..RECT }, Rect { x: 32, w: 32, ..RECT }];
        let truth = [1e-5, 3e-5];
        let mut state = 7;
        let mut moments = vec![Moments::default(); RECT.area()];
        let (mut seconds, mut samples) = ([0.0; 2], [0.0; 2]);
        let mut give = |moments: &mut Vec<Moments>, tile: usize, counts: &[u32], state: &mut u64| {
            for ((x, y), &count) in tiles[tile].pixels().zip(counts) {
                let at = (y * RECT.w + x) as usize;
                for _ in 0..count {
                    moments[at] = moments[at].merge(batch(x, state));
                    seconds[tile] += truth[tile] * f64::from(BATCH) * (0.8 + 0.4 * random(state));
                    samples[tile] += f64::from(BATCH);
                }
            }
            let costs = [0, 1].map(|t| (tiles[t], if samples[t] > 0.0 { seconds[t] / samples[t] } else { 0.0 }));
            (seconds[0] + seconds[1], costs)
        };
        let pilot = vec![adaptive::PILOT_BATCHES; 32 * 32];
        give(&mut moments, 0, &pilot, &mut state);
        let (mut spent, mut costs) = give(&mut moments, 1, &pilot, &mut state);
        let mut rounds = 0;
        loop {
            let purse = Purse { budget, spent_before: 0.0, frames_left: 1, spent, spent_in_all: spent };
            let Some(aim) = aim(Field::new(RECT, &moments), &costs, 1 << 14, purse.left()) else { break };
            let steps = tiles.map(|tile| next(aim, 1 << 14, tile, Field::new(RECT, &moments)));
            assert!(steps.iter().any(|step| *step != Step::Finished), "a round does something");
            for (tile, step) in steps.iter().enumerate() {
                if let Step::Render { work: Work::PerPixel { first, batches }, .. } = step {
                    assert!(first.iter().zip(batches).all(|(has, more)| more <= has), "at most doubled");
                    (spent, costs) = give(&mut moments, tile, batches, &mut state);
                }
            }
            rounds += 1;
            assert!(rounds < 100, "no end");
        }
        (moments, spent, rounds)
    }

    #[test]
    fn the_budget_is_used_to_within_2_percent_and_the_worst_pixels_get_it() {
        for budget in [6.0, 20.0, 60.0] {
            let (moments, spent, rounds) = render(budget);
            assert!((spent / budget - 1.0).abs() < 0.02, "{spent} of {budget}");
            assert!(rounds < 30, "{rounds} rounds");
            let field = Field::new(RECT, &moments);
            let rule = judge();
            let samples = |x: u32| {
                let column = Rect { x, w: 1, ..RECT };
                field.judge(&rule, column).map(|(own, _)| f64::from(own.samples)).sum::<f64>() / f64::from(RECT.h)
            };
            let (quiet, noisy, unseen) = (samples(20), samples(30), samples(62));
            assert!(noisy > 2.0 * quiet, "{noisy} samples in noise, {quiet} in quiet");
            assert!(unseen > 64.0 && unseen < 1e4, "what has shown nothing gets a share: {unseen}");
            // Spent evenly, the noisiest columns would have the mean number of samples.
            let even = moments.iter().map(|m| f64::from(m.samples)).sum::<f64>() / moments.len() as f64;
            assert!(noisy > 1.25 * even, "evenly {even} samples, here {noisy}");
        }
    }

    #[test]
    fn a_budget_below_the_pilot_ends_with_the_pilot() {
        let (moments, _, rounds) = render(1.0);
        assert_eq!(rounds, 0);
        assert!(moments.iter().all(|m| m.batches == adaptive::PILOT_BATCHES));
    }

    #[test]
    fn a_few_hopeless_pixels_do_not_take_everything() {
        let pixel = |m2| Moments { samples: 64, batches: 4, mean: [1.0; 3], m2, ..Moments::default() };
        let mut moments = vec![pixel(1.0); 2000];
        // Too few to be the 1% that may miss, and so wide apart that all others are judged without them.
        (0..5).for_each(|i| moments[400 * i] = pixel(1e7));
        let rect = Rect::frame(2000, 1);
        let Some(aim) = aim(Field::new(rect, &moments), &[(rect, 1e-5)], 4096, 2.0) else {
            panic!("it can be afforded")
        };
        let Step::Render { work: Work::PerPixel { batches, .. }, .. } =
            next(aim, 4096, rect, Field::new(rect, &moments))
        else {
            panic!("something is rendered")
        };
        assert!(batches[100] > 0, "the many get their share: {aim:?}");
    }

    #[test]
    fn frames_share_what_is_left() {
        let purse = Purse { budget: 10.0, spent_before: 4.0, frames_left: 2, spent: 1.0, spent_in_all: 5.0 };
        assert_eq!(purse.left(), 2.0, "half of the 6 that are left, less what it spent");
        assert_eq!(Purse { spent_in_all: 9.5, ..purse }.left(), 0.5, "never more than there is");
        assert_eq!(Purse { spent: 2.99, ..purse }.left(), 0.0, "less than 1% is not worth a round");
        assert_eq!(Purse { budget: 1.0, ..purse }.left(), 0.0);
    }

    #[test]
    fn known_and_full_pixels_cost_nothing() {
        let known = Moments { known: true, ..Moments::default() };
        let known =
            [0.0; 4].iter().fold(known, |sum, _| sum.merge(Moments { known: true, ..Moments::batch(BATCH, [0.5; 3]) }));
        let rect = Rect::frame(2, 1);
        assert_eq!(aim(Field::new(rect, &[known; 2]), &[(rect, 1e-5)], 1024, 1e9), None);
        let full = Moments { samples: 1024, batches: 64, mean: [1.0; 3], m2: 90.0, ..Moments::default() };
        assert_eq!(aim(Field::new(rect, &[full; 2]), &[(rect, 1e-5)], 1024, 1e9), None);
        assert!(aim(Field::new(rect, &[full; 2]), &[(rect, 1e-5)], 2048, 1e9).is_some());
    }
}
