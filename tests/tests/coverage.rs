//! Stopping rules on pixels whose truth is known: how often the interval holds it, and at what cost. The study
//! itself is `tessera coverage`; this is a small version with fixed seeds.

use cli::coverage::{
    Truth,
    simulated::{Around, Outcome, ours, textbook},
};
use common::{adaptive::Rule, pass::BATCH};

const TOLERANCE: f64 = 0.05;
const CAP: u32 = 16_384;
/// Frames of 225 pixels.
const FRAMES: usize = 3;

fn rule() -> Rule {
    Rule::new(TOLERANCE, 0.95, CAP, BATCH)
}

fn alike(truth: Truth, seed: u64) -> Outcome {
    ours(&[rule()], truth, Around::Alike, FRAMES, seed)
}

#[test]
fn intervals_hold_the_truth_as_often_as_they_say_and_the_mean_is_not_bent() {
    // 675 pixels know their coverage to about 0.008.
    for truth in [Truth::Bernoulli(0.5), Truth::Bernoulli(0.03), Truth::Lognormal(1.0), Truth::Exponential] {
        let ours = alike(truth, 1);
        assert!((0.925..=0.98).contains(&ours.coverage), "{}: {ours:?}", truth.name());
        assert!((ours.mean - 1.0).abs() < 0.004 + 3.0 * ours.mean_error, "{}: {ours:?}", truth.name());
    }
}

#[test]
fn a_noisy_pixel_is_not_talked_out_of_its_noise() {
    for around in [Around::Quiet, Around::Border] {
        let found = ours(&[rule()], Truth::Exponential, around, 24, 2);
        assert!(found.coverage > 0.91, "{around:?}: {found:?}");
    }
}

#[test]
fn the_textbook_rule_stops_at_black_and_we_do_not() {
    let rare = Truth::Bernoulli(0.01);
    let textbook = textbook(rare, TOLERANCE, CAP, FRAMES, 3);
    assert!(textbook.coverage < 0.5 && textbook.mean < 0.5, "{textbook:?}");
    let ours = alike(rare, 3);
    assert!(ours.coverage > 0.92 && (ours.mean - 1.0).abs() < 0.02, "{ours:?}");
}

#[test]
fn it_costs_little_where_the_textbook_rule_holds() {
    for truth in Truth::TEXTBOOK {
        let ratio = alike(truth, 4).samples / textbook(truth, TOLERANCE, CAP, FRAMES, 4).samples;
        assert!(ratio < 1.25, "{}: {ratio}", truth.name());
    }
}

#[test]
fn a_continued_job_is_as_honest_as_one_that_asked_for_the_finer_target_at_once() {
    let coarse = Rule::new(0.2, 0.95, 1024, BATCH);
    let fine = Rule::new(0.1, 0.95, 4096, BATCH);
    for truth in [Truth::Bernoulli(0.1), Truth::Lognormal(1.0), Truth::Exponential] {
        let once = ours(std::slice::from_ref(&fine), truth, Around::Alike, 4, 5);
        let continued = ours(&[coarse.clone(), fine.clone()], truth, Around::Alike, 4, 6);
        assert!((0.925..=0.98).contains(&continued.coverage), "{}: {continued:?}", truth.name());
        assert!((continued.samples / once.samples - 1.0).abs() < 0.05, "{}: {continued:?} {once:?}", truth.name());
    }
}
