//! Tests of lights: what they share, and whole lights against closed forms.

mod choice;
mod emitters;
mod environment;
mod irradiance;

use common::method::{LightPick, LightSampling, Method};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::*;
use crate::testing::Rng;

const SAMPLINGS: [LightSampling; 3] = [LightSampling::Area, LightSampling::Stratified, LightSampling::SolidAngle];

fn method(pick: LightPick, sampling: LightSampling) -> Method {
    Method { light_pick: Some(pick), light_sampling: Some(sampling), ..Method::default() }
}

/// Pearson's test of counts against what is expected of them, at a chance of 1e-5 that it fails although
/// nothing is wrong: seeds are fixed, so a test that passes once passes always. A count where none is
/// expected fails at once; cells that expect fewer than 10 are pooled.
fn check_counts(name: &str, observed: &[u32], expected: &[f64]) {
    let (mut statistic, mut cells) = (0.0, 0);
    let (mut pool, mut pooled) = (0.0, 0.0);
    for (i, (&count, &expect)) in observed.iter().zip(expected).enumerate() {
        assert!(expect.is_finite() && (expect > 0.0 || count == 0), "{name}: {count} in cell {i}, expected {expect}");
        pool += expect;
        pooled += f64::from(count);
        if pool >= 10.0 {
            statistic += (pooled - pool) * (pooled - pool) / pool;
            cells += 1;
            (pool, pooled) = (0.0, 0.0);
        }
    }
    assert!(cells > 2, "{name}: too few samples");
    let p = ChiSquared::new(f64::from(cells - 1)).unwrap().sf(statistic);
    assert!(p > 1e-5, "{name}: chi-square {statistic:.1} with {cells} cells, p = {p:.1e}");
}
