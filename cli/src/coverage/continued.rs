//! Jobs continued to a finer target: every pixel judged anew by the finer rule, every sample kept.

use super::{
    Bound, Effort, Grid, Part, Section, Truth, Value,
    simulated::{Around, frames, ours},
    tolerances::{GOAL, TOLERANCES, rule},
};
use crate::error::Failure;

/// Continued jobs, simulated; rendered ones are in the table of [`super::rendered`].
pub(super) const PART: Part = Part { id: "continued", measure };

fn measure(effort: &Effort) -> Result<Section, Failure> {
    let rules = TOLERANCES.map(rule);
    let frames = frames(effort.trials);
    let mut grid = Grid::new(
        "continued",
        "Coverage after a tolerance of 10%, at once and continued from 20%; and after 5%, at once and by 20%, then 10%.",
        &[
            "truth",
            "10% at once",
            "+-",
            "continued",
            "5% at once",
            "continued twice",
            "mean",
            "samples against at once",
        ],
    );
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for (truth, seen) in Truth::STUDY.into_iter().filter(|(truth, _)| *truth != Truth::Constant) {
        let at = |rules: &[_], seed| ours(rules, truth, Around::Alike, frames, seed);
        let (once, then) = (at(&rules[1..2], 40), at(&rules[..2], 41));
        let (finer, twice) = (at(&rules[2..3], 42), at(&rules[..3], 43));
        if seen {
            (least, most) = (least.min(then.coverage).min(twice.coverage), most.max(then.coverage).max(twice.coverage));
        }
        grid.rows.push(vec![
            truth.name().into(),
            Value::Number(once.coverage, 3),
            Value::Number(once.coverage_error, 3),
            Value::Number(then.coverage, 3),
            Value::Number(finer.coverage, 3),
            Value::Number(twice.coverage, 3),
            Value::Number(twice.mean, 4),
            Value::Number(twice.samples / finer.samples, 3),
        ]);
    }
    let slack = effort.of(0.0, 0.02);
    let bound = |which: &str, found| Bound {
        what: format!("{which} coverage of simulated pixels after a job is continued"),
        found,
        low: GOAL.0 - 0.005 - slack,
        high: GOAL.1 + 0.01 + slack,
        goal: Some(GOAL),
    };
    Ok(Section {
        title: "Continued jobs",
        text: "A job that is continued to a finer target keeps every sample; no pixel counts as stopped any more, and all \
               are judged anew by the finer rule. A look at the coarse target is one look more at which a pixel did \
               *not* stop for good, so its interval is no less honest than that of a job that asked for the finer \
               target at once. The table of rendered pixels has the same for the shipped scenes."
            .into(),
        grids: vec![grid],
        bounds: vec![bound("least", least), bound("greatest", most)],
        ..Section::default()
    })
}
