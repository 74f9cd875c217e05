//! The next pass of an adaptive tile, from what was measured in it and around it.
//!
//! A pixel is judged by its own moments and those of the pixels that touch it, exactly as they stood at the
//! end of the pass before. Once it has stopped it stays so: a pixel that began again when a neighbour found
//! something new would make the picture depend on where tiles end, since a finished tile is not looked at
//! again. When all tiles of a frame are finished, or a job goes on to a finer target, all pixels of the frame
//! are judged anew: [`super::judge_anew`].

use common::{adaptive::Rule, pass::Work, tile::Rect};

use super::{Field, Step};

/// Plan the pass after those that `around` holds, or say that the tile is finished.
#[must_use]
pub fn next(rule: &Rule, tile: Rect, around: Field<'_>) -> Step {
    let mut first = Vec::with_capacity(tile.area());
    let mut batches = Vec::with_capacity(tile.area());
    let (mut after, mut goal) = (0u64, 0u64);
    for (own, verdict) in around.judge(rule, tile) {
        let wanted = if own.stopped { own.batches } else { verdict.batches };
        first.push(own.batches);
        batches.push(wanted.saturating_sub(own.batches));
        after += u64::from(wanted);
        goal += u64::from(if own.stopped { own.batches } else { verdict.goal });
    }
    if batches.iter().all(|&n| n == 0) {
        return Step::Finished;
    }
    let share = after as f64 / goal.max(after).max(1) as f64;
    Step::Render { work: Work::PerPixel { first, batches }, share }
}

#[cfg(test)]
mod tests {
    use common::{film::Moments, pass::BATCH};

    use super::{super::Surroundings, *};

    fn rule() -> Rule {
        Rule::new(0.05, 0.95, 1024, BATCH)
    }

    fn pixel(values: &[f64]) -> Moments {
        values.iter().fold(Moments::default(), |sum, &v| sum.merge(Moments::batch(BATCH, [v; 3])))
    }

    fn quiet() -> Moments {
        pixel(&[1.0, 1.001, 0.999, 1.0])
    }

    fn noisy() -> Moments {
        pixel(&[0.2, 2.0, 0.7, 1.1])
    }

    fn field(w: u32, h: u32, of: impl Fn(u32, u32) -> Moments) -> Surroundings {
        let rect = Rect::frame(w, h);
        let moments = rect.pixels().map(|(x, y)| of(x, y)).collect();
        Surroundings { rect, moments }
    }

    fn batches(step: Step) -> Vec<u32> {
        match step {
            Step::Render { work: Work::PerPixel { first, batches }, share } => {
                assert!(share > 0.0 && share <= 1.0);
                assert!(first.iter().all(|&n| n == 4));
                batches
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn quiet_pixels_finish_and_noise_spreads_to_the_pixels_that_touch_it() {
        let tile = Rect::frame(5, 5);
        assert_eq!(next(&rule(), tile, field(5, 5, |_, _| quiet()).field()), Step::Finished);
        let step = next(&rule(), tile, field(5, 5, |x, y| if (x, y) == (2, 2) { noisy() } else { quiet() }).field());
        let batches = batches(step);
        for (i, (x, y)) in tile.pixels().enumerate() {
            let touches = x.abs_diff(2) <= 1 && y.abs_diff(2) <= 1;
            assert_eq!(batches[i] > 0, touches, "{x},{y}");
        }
    }

    #[test]
    fn the_plan_does_not_depend_on_where_tiles_end() {
        let of = |x: u32, y: u32| if (x * 7 + y * 3).is_multiple_of(5) { noisy() } else { quiet() };
        let whole = field(8, 8, of);
        let all = batches(next(&rule(), Rect::frame(8, 8), whole.field()));
        for tile in [Rect { x: 0, y: 0, w: 4, h: 8 }, Rect { x: 4, y: 2, w: 4, h: 3 }] {
            // What the tile sees: itself and a ring of one pixel.
            let left = tile.x.saturating_sub(1);
            let top = tile.y.saturating_sub(1);
            let seen =
                Rect { x: left, y: top, w: (tile.x + tile.w + 1).min(8) - left, h: (tile.y + tile.h + 1).min(8) - top };
            let moments: Vec<Moments> = seen.pixels().map(|(x, y)| of(x, y)).collect();
            let part = Field::new(seen, &moments);
            let expected: Vec<u32> = tile.pixels().map(|(x, y)| all[(y * 8 + x) as usize]).collect();
            assert_eq!(batches(next(&rule(), tile, part)), expected);
        }
    }

    #[test]
    fn what_has_stopped_stays_so() {
        let stopped = Moments { stopped: true, ..noisy() };
        let step = next(&rule(), Rect::frame(3, 1), field(3, 1, |x, _| if x == 1 { stopped } else { noisy() }).field());
        let batches = batches(step);
        assert!(batches[0] > 0 && batches[1] == 0 && batches[2] > 0);
    }

    #[test]
    fn a_film_judged_anew_by_a_finer_rule_goes_on_from_the_batches_it_has() {
        let finer = Rule::new(0.0005, 0.95, 4096, BATCH);
        let mut film = field(3, 3, |_, _| Moments { stopped: true, ..quiet() });
        let tile = Rect::frame(3, 3);
        assert_eq!(next(&finer, tile, film.field()), Step::Finished, "what has stopped stays so");
        super::super::judge_anew(&mut film.moments);
        assert!(batches(next(&finer, tile, film.field())).iter().all(|&n| n == 4), "doubled, from batch 4 on");
    }

    #[test]
    fn the_cap_ends_a_tile() {
        let full = pixel(&[0.0, 9.0].repeat(32));
        assert_eq!(next(&rule(), Rect::frame(2, 2), field(2, 2, |_, _| full).field()), Step::Finished);
    }
}
