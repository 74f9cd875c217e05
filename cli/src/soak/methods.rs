//! The methods a soak takes each scene through: every value of every choice, in changing company.

use common::method::{
    Aim, Bvh, Direct, Fresnel, LightPick, LightSampling, Only, Reuse, Roulette, Sampler, TriangleTest,
};

use crate::args::JobOptions;

/// Methods a scene is taken through.
pub const COUNT: usize = 15;

/// Longest paths: cut short before, at and after each special case of the integrator, and long.
const DEPTHS: [u32; 4] = [4, 1, 2, 12];

/// Method number `i` below [`COUNT`] of scene number `scene`: each scene meets every value of every choice, every
/// estimator of direct light with every way of choosing points on lamps; the other pairs differ from scene to scene.
#[must_use]
pub fn method(scene: usize, i: usize) -> JobOptions {
    fn of<T: Copy>(all: &[(&str, T)], i: usize) -> T {
        all[i % all.len()].1
    }
    let only = [None, Some(Only::Direct), None, Some(Only::Indirect), None, None];
    JobOptions {
        direct: Some(of(Direct::ALL, i)),
        light_sampling: Some(of(LightSampling::ALL, i)),
        light_pick: Some(of(LightPick::ALL, i / 3 + scene)),
        light_samples: Some([1, 3][(i / 2 + scene) % 2]),
        splits: Some([1, 1, 4][(i + scene) % 3]),
        reuse: Some([Reuse::Off, Reuse::Off, Reuse::Paths][(i + i / 3 + scene) % 3]),
        aim: Some([Aim::Off, Aim::Delta, Aim::Off][(i + i / 3 + scene) % 3]),
        fresnel: Some(of(Fresnel::ALL, i / 6 + i + scene)),
        sampler: Some(of(Sampler::ALL, i / 4 + scene)),
        roulette: Some(of(Roulette::ALL, i / 3 + scene / 2)),
        triangle: Some(of(TriangleTest::ALL, usize::from(i % 6 == 5))),
        bvh: Some(of(Bvh::ALL, i / 4 + i)),
        max_depth: Some(DEPTHS[(i / 4 + i + scene) % DEPTHS.len()]),
        only: only[(i / 2 + scene) % only.len()],
        seed: Some(i as u64),
        ..JobOptions::default()
    }
}

/// The options as they are written on a command line, those of them that a soak sets.
#[must_use]
pub fn words(options: &JobOptions) -> String {
    let mut words = Vec::new();
    let mut add = |name: &str, value: Option<String>| words.extend(value.map(|value| format!("--{name} {value}")));
    add("resolution", options.resolution.map(|[w, h]| format!("{w}x{h}")));
    add("samples", options.target.samples.map(|n| n.to_string()));
    add("seed", options.seed.map(|n| n.to_string()));
    add("max-depth", options.max_depth.map(|n| n.to_string()));
    add("direct", options.direct.map(|choice| choice.to_string()));
    add("light-sampling", options.light_sampling.map(|choice| choice.to_string()));
    add("light-pick", options.light_pick.map(|choice| choice.to_string()));
    add("light-samples", options.light_samples.map(|n| n.to_string()));
    add("splits", options.splits.map(|n| n.to_string()));
    add("reuse", options.reuse.map(|choice| choice.to_string()));
    add("aim", options.aim.map(|choice| choice.to_string()));
    add("only", options.only.map(|choice| choice.to_string()));
    add("fresnel", options.fresnel.map(|choice| choice.to_string()));
    add("sampler", options.sampler.map(|choice| choice.to_string()));
    add("roulette", options.roulette.map(|choice| choice.to_string()));
    add("triangle", options.triangle.map(|choice| choice.to_string()));
    add("bvh", options.bvh.map(|choice| choice.to_string()));
    words.join(" ")
}
