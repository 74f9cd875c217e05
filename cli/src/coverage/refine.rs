//! Passes until a frame has what its rule asks for, planned by the code that plans a farm's: one tile that
//! is the whole frame. Where samples come from is the caller's affair.

use common::{adaptive::Rule, film::Moments, pass::Work, tile::Rect};
use coordinator::plan::{self, Field, Step};

/// The frame that `rule` leaves, and the number of passes it took. `film` is empty at first; what an earlier,
/// coarser rule left is gone on with, every pixel judged anew. `render` gives each pixel of the frame, in row
/// order, what the work asks for.
pub fn refine(
    rule: &Rule,
    frame: Rect,
    film: Vec<Moments>,
    mut render: impl FnMut(&Work) -> Vec<Moments>,
) -> (Vec<Moments>, u32) {
    let mut passes = 0;
    let mut moments = if film.is_empty() {
        passes += 1;
        render(&Work::Uniform { first: 0, samples: rule.pilot() * rule.batch() })
    } else {
        let mut film = film;
        plan::judge_anew(&mut film);
        film
    };
    loop {
        while let Step::Render { work, .. } = plan::next(rule, frame, Field::new(frame, &moments)) {
            passes += 1;
            let later = render(&work);
            moments = moments.iter().zip(&later).map(|(before, later)| before.after_pass(*later)).collect();
        }
        let judged = Field::new(frame, &moments).judge(rule, frame);
        if !rule.unsettled(judged.map(|(own, verdict)| (own.batches, verdict))) {
            return (moments, passes);
        }
        plan::judge_anew(&mut moments);
    }
}

/// Half-width of every pixel's interval as the rule sees it on the finished frame, and whether it keeps the
/// target.
pub fn intervals(rule: &Rule, frame: Rect, film: &[Moments]) -> Vec<(f64, bool)> {
    let judged = Field::new(frame, film).judge(rule, frame);
    judged.map(|(_, verdict)| (verdict.half_width, verdict.met)).collect()
}
