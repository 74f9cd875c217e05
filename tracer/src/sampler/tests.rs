use super::*;
use common::method::Sampler as Kind;
use statrs::distribution::{ChiSquared, ContinuousCDF};

const KINDS: [Kind; 3] = [Kind::Sobol, Kind::Stratified, Kind::Independent];

fn points(sampler: &Sampler, pixel: u32, batch: u32, dimension: u32) -> Vec<Vec2> {
    let n = sampler.batch();
    (0..n).map(|i| sampler.stream(pixel, 7, batch * n + i).two(dimension)).collect()
}

/// Whether each cell of a `columns` x `rows` grid holds exactly one point.
fn one_in_each(points: &[Vec2], columns: usize, rows: usize) -> bool {
    let mut counts = vec![0; columns * rows];
    for p in points {
        counts[(p.x * columns as f32) as usize + columns * (p.y * rows as f32) as usize] += 1;
    }
    counts.iter().all(|&n| n == 1)
}

#[test]
fn a_sobol_batch_has_one_point_in_every_elementary_interval() {
    for m in [4, 6] {
        let sampler = Sampler::new(Kind::Sobol, 3, 1, 1 << m);
        for batch in 0..40 {
            for dimension in 0..25 {
                let points = points(&sampler, batch, batch, dimension);
                for k in 0..=m {
                    assert!(one_in_each(&points, 1 << k, 1 << (m - k)), "batch {batch} dimension {dimension} k {k}");
                }
                let n = sampler.batch();
                let ones: Vec<Vec2> =
                    (0..n).map(|i| Vec2::new(sampler.stream(batch, 7, batch * n + i).one(dimension), 0.0)).collect();
                assert!(one_in_each(&ones, 1 << m, 1));
            }
        }
    }
}

#[test]
fn sets_of_batches_and_their_batches_have_one_point_in_every_elementary_interval() {
    for (batch, n) in [(16, 4), (4, 4), (16, 16)] {
        let sampler = Sampler::new(Kind::Sobol, 3, 1, batch).in_sets(n);
        for dimension in 0..25 {
            let points = |first: u32, count: u32| -> Vec<Vec2> {
                (first..first + count).map(|i| sampler.stream(dimension, 7, i).two(dimension)).collect()
            };
            let set = 3 * batch * n;
            for (first, count) in (0..n).map(|part| (set + part * batch, batch)).chain([(set, batch * n)]) {
                let m = count.trailing_zeros();
                for k in 0..=m {
                    assert!(one_in_each(&points(first, count), 1 << k, 1 << (m - k)), "{batch} x {n} k {k}");
                }
            }
        }
    }
    // Only Sobol' sequences have such parts: batches of other points stay by themselves.
    for kind in [Kind::Stratified, Kind::Independent] {
        let sampler = Sampler::new(kind, 3, 1, 16);
        assert_eq!(sampler.in_sets(4), sampler);
    }
}

#[test]
fn a_set_errs_less_than_its_batches_would_by_themselves_and_their_spread_tells_no_less() {
    // x y^2 over one pair, plus a product over two others, which no set evens out.
    let f = |stream: &Stream| {
        let (u, v, w) = (stream.two(4), stream.two(5), stream.two(6));
        f64::from(u.x * u.y * u.y + 0.02 * (v.x - 0.5) * (w.y - 0.5))
    };
    let variances = |n: u32| {
        let sampler = Sampler::new(Kind::Sobol, 11, 0, 16).in_sets(n);
        let (mut means, mut told) = (Vec::new(), 0.0);
        for set in 0..4000u32 {
            let batch = |b: u32| {
                (0..16).map(|i| f(&sampler.stream(set % 50, 2, (set / 50 * 4 + b) * 16 + i))).sum::<f64>() / 16.0
            };
            let (mean, variance) = mean_variance(&(0..4).map(batch).collect::<Vec<f64>>());
            means.push(mean);
            told += variance / 4.0 / 4000.0;
        }
        let (mean, variance) = mean_variance(&means);
        assert!((mean - 1.0 / 6.0).abs() < 4.0 * (variance / 4000.0).sqrt(), "{mean}");
        (variance, told)
    };
    let ((alone, told_alone), (together, told_together)) = (variances(1), variances(4));
    assert!((told_alone / alone - 1.0).abs() < 0.1, "{told_alone} of {alone}");
    // Parts that make up for each other to the last spread by 4 / 3 of what independent ones would.
    assert!(together < 0.4 * alone, "{together} against {alone}");
    assert!(told_together > together && told_together < 1.45 * alone, "{told_together} of {together}");
}

#[test]
fn forks_of_a_batch_are_a_batch_together() {
    for (batch, ways, n) in [(16, 4, 1), (8, 2, 1), (16, 1, 1), (16, 4, 4)] {
        let sampler = Sampler::new(Kind::Sobol, 3, 1, batch).in_sets(n);
        let m = (batch * ways).trailing_zeros();
        for dimension in 0..25 {
            let streams = || (0..batch).map(|i| sampler.stream(dimension, 7, 3 * batch + i));
            let forks: Vec<Stream> = streams().flat_map(|s| (0..ways).map(move |k| s.fork(k, ways))).collect();
            let points: Vec<Vec2> = forks.iter().map(|s| s.two(dimension)).collect();
            for k in 0..=m {
                assert!(one_in_each(&points, 1 << k, 1 << (m - k)), "{batch} x {ways}, dimension {dimension} k {k}");
            }
            // And they can be found again by their parts.
            let again = sampler.forked(ways);
            for fork in &forks {
                let (key, index) = fork.parts();
                assert_eq!(again.resume(key, index).one(dimension), fork.one(dimension));
            }
        }
    }
}

#[test]
fn a_stratified_batch_has_one_point_in_every_cell() {
    let sampler = Sampler::new(Kind::Stratified, 3, 1, 16);
    for batch in 0..100 {
        assert!(one_in_each(&points(&sampler, 5, batch, batch % 9), 4, 4));
    }
}

#[test]
fn points_are_uniform_over_batches_pixels_and_seeds() {
    const CELLS: usize = 16;
    for kind in KINDS {
        let mut counts = vec![0.0f64; CELLS * CELLS];
        let mut total = 0.0;
        for seed in 0..400u32 {
            // Batch 3 of 5 points: a count that fills no grid must be uniform too.
            let sampler = Sampler::new(kind, u64::from(seed), seed % 3, if seed % 2 == 0 { 16 } else { 5 });
            for p in (0..20).flat_map(|pixel| points(&sampler, pixel, 3, pixel)) {
                counts[(p.x * CELLS as f32) as usize + CELLS * (p.y * CELLS as f32) as usize] += 1.0;
                total += 1.0;
            }
        }
        let expected = total / (CELLS * CELLS) as f64;
        let statistic: f64 = counts.iter().map(|n| (n - expected) * (n - expected) / expected).sum();
        let degrees = (CELLS * CELLS - 1) as f64;
        let p = ChiSquared::new(degrees).unwrap().sf(statistic);
        // Stratified points are more even than chance: only excess is a fault.
        assert!(p > 1e-4, "{kind}: chi-square {statistic} of {degrees}, p = {p}");
    }
}

/// Mean and variance over many batches of the batch mean of `f`.
fn batch_means(kind: Kind, f: impl Fn(&Stream) -> f32) -> Vec<f64> {
    let sampler = Sampler::new(kind, 11, 0, 16);
    (0..4000u32)
        .map(|batch| {
            let values = (0..16).map(|i| f64::from(f(&sampler.stream(batch % 50, 2, batch / 50 * 16 + i))));
            values.sum::<f64>() / 16.0
        })
        .collect()
}

fn mean_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0))
}

#[test]
fn batch_means_of_a_smooth_integrand_spread_far_less_than_independent_ones() {
    // The integral of x y^2 is 1/6.
    let f = |stream: &Stream| {
        let u = stream.two(4);
        u.x * u.y * u.y
    };
    let (mean, independent) = mean_variance(&batch_means(Kind::Independent, f));
    assert!((mean - 1.0 / 6.0).abs() < 4.0 * (independent / 4000.0).sqrt());
    for (kind, gain) in [(Kind::Sobol, 30.0), (Kind::Stratified, 8.0)] {
        let (mean, variance) = mean_variance(&batch_means(kind, f));
        assert!((mean - 1.0 / 6.0).abs() < 4.0 * (variance / 4000.0).sqrt(), "{kind} {mean}");
        assert!(variance * gain < independent, "{kind}: {variance} against {independent}");
    }
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let ((ma, va), (mb, vb)) = (mean_variance(a), mean_variance(b));
    let covariance: f64 = a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / (a.len() - 1) as f64;
    covariance / (va * vb).sqrt()
}

#[test]
fn batches_and_dimensions_are_independent_of_each_other() {
    for kind in KINDS {
        let f = |dimension: u32| move |stream: &Stream| stream.two(dimension).dot(Vec2::new(1.0, 1.7)).powi(2);
        let base = batch_means(kind, f(3));
        // 4,000 pairs: the standard error of a correlation of nothing is 0.016.
        let next: Vec<f64> = base[1..].iter().chain(&base[..1]).copied().collect();
        let below: Vec<f64> = base[50..].iter().chain(&base[..50]).copied().collect();
        for (name, other) in [("pixel", next), ("batch", below), ("dimension", batch_means(kind, f(4)))] {
            let r = correlation(&base, &other);
            assert!(r.abs() < 0.06, "{kind}: {r} with the next {name}");
        }
        // Inside a batch, a product over two dimensions integrates to the product of the integrals.
        let product = batch_means(kind, |stream| (stream.two(1).x - 0.5) * (stream.two(2).x - 0.5));
        let (mean, variance) = mean_variance(&product);
        assert!(mean.abs() < 4.0 * (variance / 4000.0).sqrt(), "{kind} {mean}");
        let chance = 1.0 / 144.0 / 16.0;
        assert!(variance < 1.3 * chance, "{kind}: dimensions are correlated, {variance} against {chance}");
    }
}

#[test]
fn a_value_depends_on_every_part_of_its_key_and_on_nothing_else() {
    for kind in KINDS {
        let value = |seed, frame, x, y, sample, dimension| {
            Sampler::new(kind, seed, frame, 16).stream(x, y, sample).two(dimension)
        };
        let base = value(1, 2, 3, 4, 5, 6);
        assert_eq!(base, value(1, 2, 3, 4, 5, 6));
        let others = [
            value(2, 2, 3, 4, 5, 6),
            value(1, 3, 3, 4, 5, 6),
            value(1, 2, 4, 4, 5, 6),
            value(1, 2, 4, 3, 5, 6),
            value(1, 2, 3, 5, 5, 6),
            value(1, 2, 3, 4, 6, 6),
            value(1, 2, 3, 4, 21, 6),
            value(1, 2, 3, 4, 5, 7),
        ];
        assert!(others.iter().all(|other| *other != base), "{kind}");
        let stream = Sampler::new(kind, 1, 2, 16).stream(3, 4, 5);
        assert_ne!(stream.split(0).two(6), stream.split(1).two(6));
    }
}
