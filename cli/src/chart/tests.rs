//! Budgets are spent as they say, and methods are told apart from what they share.

use std::path::Path;

use super::{methods::Named, stage::Stage};
use crate::{args::JobOptions, bundle::Bundle, request};

/// The Cornell box in small, ready for a method.
fn stage(words: &str) -> Stage {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/cornell-box.json");
    let mut bundle = Bundle::read(&path).unwrap();
    let options = JobOptions { resolution: Some([12, 10]), crop: Some([2, 0, 10, 10]), ..JobOptions::default() };
    let mut request = request::of(&options, &bundle).unwrap();
    request.method = Named::parse(words).unwrap().choices;
    Stage::open(&mut bundle, &request, 1024, 2).unwrap()
}

#[test]
fn budgets_are_spent_as_the_rule_of_each_method_has_it() {
    let uniform = stage("mis").run(48, 7).unwrap();
    assert!(uniform.pixels.iter().all(|pixel| pixel.samples == 48));
    assert_eq!((uniform.pixels.len(), uniform.samples), (100, 4800));
    assert!(uniform.cpu_seconds > 0.0);

    // Pixels that see the lamp alone stop at the second look, or where one sample is all there is.
    let textbook = stage("mis+adaptive=textbook+adaptive-batch=16+adaptive-tolerance=0.3").run(256, 7).unwrap();
    let counts = || textbook.pixels.iter().map(|pixel| pixel.samples);
    assert!(counts().max() <= Some(256) && counts().min() < counts().max(), "{:?}", counts().collect::<Vec<_>>());

    let ours = stage("mis+on");
    let adaptive = ours.run(192, 7).unwrap();
    let spent = adaptive.samples as f64 / (192.0 * 100.0);
    assert!((0.9..=1.0).contains(&spent), "{spent} of the budget");
    let counts = || adaptive.pixels.iter().map(|pixel| pixel.samples);
    assert!(counts().min() >= Some(64) && counts().max() > Some(192), "more where it is needed");
    assert_eq!(ours.least(), 64);
    let again = ours.run(192, 7).unwrap();
    assert_eq!(again.pixels, adaptive.pixels, "no clock chooses samples");
}

#[test]
fn a_long_run_is_the_same_in_any_stride() {
    let stage = stage("auto");
    let mut taken = 0;
    let whole = stage.long(96, 96, 3, &mut |samples| taken += samples);
    assert_eq!(taken, 9600);
    let parts = stage.long(96, 32, 3, &mut |_| {});
    for (a, b) in whole.iter().zip(&parts) {
        assert_eq!((a.samples, a.batches), (b.samples, b.batches));
        assert!((a.mean[1] - b.mean[1]).abs() < 1e-9);
    }
}
