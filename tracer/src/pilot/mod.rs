//! The pilot: tries the methods that could serve a scene and keeps the one with the least variance x cost.
//!
//! What the facts rule out is not tried. The rest is asked one question after the other (how direct light is
//! estimated; which light; where on it; how many samples; in how many ways paths go on), each alternative against the best
//! so far, on the same pixels, as many as a small part of the picture's own work affords. Work is counted, not timed, and the
//! samples are of another seed than the picture's and are thrown away: the choice is a pure function of scene, settings and
//! [`Trial`], the same on every machine, and says nothing of the picture's noise.

mod questions;
mod tried;
mod work;

use std::ops::Range;

use common::{
    luminance,
    method::{Direct, Method, Reuse},
    plan::{Considered, LEAST_PIXELS, MethodPlan, Trial, label},
    protocol::RenderSettings,
    tile::Rect,
};
use rayon::prelude::*;

pub use self::questions::ruled_out;
use self::{
    questions::{Question, begin, questions, sharing_is_open},
    tried::{GROUPS, Gain, Spread, Tried},
};
use crate::{
    Prepared,
    geometry::Counters,
    integrator::{Integrator, MEMBERS, Probe, Together, Wave},
    math::Rgb,
    sampler::{Sampler, Stream},
    unit::{SIDE, group_of},
};

/// Samples of a pixel of the pilot.
const SAMPLES: u32 = 64;
/// A pilot takes about this part of the picture's work.
const PART: f64 = 0.02;
/// The least pilot is made where it takes no more than so many times that part.
const EXCESS: f64 = 3.0;
/// Fewest pixels of a group.
const LEAST_GROUP: usize = 8;
/// Where it is not known what is asked of the picture: samples of a whole pilot for each pixel of it.
const SHARE: usize = 8;
/// Most samples of a pilot, about.
const MOST: usize = 300_000;
/// A pilot takes at most about this many times the samples of one look at one method.
const LOOKS: usize = 24;
/// A first look is at so many groups of pixels, the second at the others.
const FIRST_GROUPS: usize = 4;
/// A method below this efficiency at the first look is not looked at again.
const HOPELESS: f64 = 0.6;
/// A method must be better by this much to replace the one before it.
const GAIN: f64 = 0.02;
/// And by this many standard errors, unless it does without multiple importance sampling: where both look alike, either
/// will do, and the better guess loses less.
const SIGNIFICANCE: f64 = 0.5;
/// Without that, what is found by chance once in a while hardly shows in a trial.
const SIGNIFICANCE_WITHOUT_MIS: f64 = 1.0;
/// What is aimed at mirrors and glass must be better by this much and by so many standard errors: what it is for is found by chance
/// once in a while without it, and it makes each sample dearer for sure.
const GAIN_OF_AIM: f64 = 0.1;
const SIGNIFICANCE_OF_AIM: f64 = 1.0;
/// Going on in several ways must be better by so many squares of the standard error more: three seeds in eight of Veach's plates,
/// where two pixels in a hundred make up most of the variance, would choose it wrongly otherwise.
const SKEW: f64 = 3.0;
/// Pixels share paths where that gains this at least, as a logarithm: their errors then have much in common, which shows as
/// blotches and is no good to who works on with the picture.
const WORTH_SHARING: f64 = 0.4;
/// Keeps the samples apart from the picture's.
const SEED: u64 = 0x7069_6C6F_7421_5EED;

/// Choose a method for a scene that was loaded for the method of `settings`, whose choices but those that
/// `trial` names are open.
#[must_use]
pub fn choose(prepared: &Prepared, settings: &RenderSettings, trial: &Trial) -> MethodPlan {
    let facts = *prepared.facts();
    let first = begin(&settings.method, &facts, trial);
    let questions = questions(&first, &facts, trial);
    let untried = if settings.method.direct != Direct::Auto {
        Some("the method is named")
    } else if facts.lights == 0 {
        Some("there is no light")
    } else if questions.is_empty() {
        Some("nothing is left open")
    } else if trial.region.area() < LEAST_PIXELS {
        Some("a frame so small is not worth a trial")
    } else {
        None
    };
    let tried = match untried {
        Some(why) => Err(why),
        None => Pilot::new(prepared, settings, trial)
            .run(&first, &questions)
            .ok_or("a picture so quick is not worth a trial"),
    };
    let (method, considered, untried) = match tried {
        Ok((method, considered)) => (method, considered, None),
        Err(why) => (first, Vec::new(), Some(why)),
    };
    let chosen = label(&method, &facts);
    let kernel = match prepared.with_method(&settings.method, &method) {
        Some(prepared) => Integrator::new(prepared.scene(), &method).kernel_in_words(),
        None => Vec::new(),
    };
    MethodPlan { facts, chosen, method, kernel, untried: untried.map(Into::into), considered }
}

/// Work of a sample of the method of `settings`, as a pilot counts it.
#[must_use]
pub fn counted_work(prepared: &Prepared, settings: &RenderSettings, region: Rect) -> f64 {
    let trial = Trial { region, named: Default::default(), quality: None };
    let mut pilot = Pilot::new(prepared, settings, &trial);
    pilot.spread(pilot.most());
    let count = pilot.pixels.len();
    let tried = pilot.look(&settings.method, 0..count, &mut vec![1.0; count], false);
    tried.map_or(f64::NAN, |tried| tried.cost())
}

struct Pilot<'a> {
    prepared: &'a Prepared,
    settings: &'a RenderSettings,
    trial: &'a Trial,
    /// Columns and rows, spread over the region so that the first few are spread as well.
    pixels: Vec<[u32; 2]>,
    /// See [`work::least_variance`].
    least_variance: f64,
}

impl<'a> Pilot<'a> {
    fn new(prepared: &'a Prepared, settings: &'a RenderSettings, trial: &'a Trial) -> Self {
        let least_variance = work::least_variance(trial, settings.batch);
        let mut pilot = Self { prepared, settings, trial, pixels: Vec::new(), least_variance };
        pilot.spread(LEAST_GROUP);
        pilot
    }

    /// Take `group` pixels in each group; those of fewer are among those of more.
    fn spread(&mut self, group: usize) {
        let region = self.trial.region;
        // The R2 sequence (Roberts 2018): multiples of 1/g and 1/g^2, g^3 = g + 1.
        let place = |i: usize, step: f64, length: u32| {
            let at = (0.5 + (i + 1) as f64 * step).fract();
            ((at * f64::from(length)) as u32).min(length.saturating_sub(1))
        };
        let pixel = |i| {
            [region.x + place(i, 0.754_877_666_246_693, region.w), region.y + place(i, 0.569_840_290_998_053, region.h)]
        };
        self.pixels = (0..group * GROUPS).map(pixel).collect();
    }

    /// Most pixels of a group.
    fn most(&self) -> usize {
        let samples = if self.trial.quality.is_some() { MOST } else { MOST.min(self.trial.region.area() * SHARE) };
        (samples / (LOOKS * SAMPLES as usize)).div_ceil(FIRST_GROUPS).max(1)
    }

    /// Pixels of a group that the work of the picture affords, by what `first` found of the method to begin with; `None`
    /// where it affords no trial.
    fn afforded(&self, first: &Tried, questions: &[Question]) -> Option<usize> {
        let Some(picture) = work::of_picture(self.trial, first, self.settings.batch) else { return Some(self.most()) };
        let sharing = if sharing_is_open(&first.method, self.prepared.facts(), self.trial) { 3.0 } else { 0.0 };
        let looks = 1.0 + sharing + questions.iter().map(|question| question.looks).sum::<f64>();
        let of_pixel = first.work / first.variances.len() as f64;
        let group = PART * picture / (looks * of_pixel * GROUPS as f64);
        // `as` saturates.
        (EXCESS * group >= LEAST_GROUP as f64).then(|| (group as usize).min(self.most()).max(LEAST_GROUP))
    }

    /// The best method and all that was tried; `None` where the picture affords no trial.
    fn run(mut self, first: &Method, questions: &[Question]) -> Option<(Method, Vec<Considered>)> {
        let facts = self.prepared.facts();
        let begun = LEAST_GROUP * FIRST_GROUPS;
        let mut scales = vec![1.0; begun];
        let mut best = self.look(first, 0..begun, &mut scales, true)?;
        let group = self.afforded(&best, questions)?;
        self.spread(group);
        let (few, all_pixels) = (group * FIRST_GROUPS, self.pixels.len());
        scales.resize(all_pixels, 1.0);
        best.add(&self.look(first, begun..all_pixels, &mut scales, true)?);
        let mut all = vec![best.clone()];
        // How much better several ways are than one, where that was asked.
        let mut of_ways: Option<(Tried, f64)> = None;
        for question in questions {
            for change in &question.ways {
                let mut method = best.method.clone();
                change(&mut method);
                if label(&method, facts) == label(&best.method, facts) {
                    continue;
                }
                let ways = method.splits != best.method.splits;
                let Some(mut tried) = self.look(&method, 0..few, &mut scales, false) else { continue };
                if !ways && best.first_look(few) < HOPELESS * tried.first_look(few) {
                    all.push(tried);
                    if question.climbs {
                        break;
                    }
                    continue;
                }
                let Some(rest) = self.look(&method, few..all_pixels, &mut scales, false) else { continue };
                tried.add(&rest);
                let gain = if ways { tried.gain_of_ways(&best, self.least_variance) } else { tried.gain(&best) };
                all.push(tried.clone());
                if ways {
                    of_ways = Some((best.clone(), libm::exp(gain.log)));
                }
                // A sky of one colour hides nothing from chance.
                let plain_sky = !facts.area_lights && !self.prepared.scene().lights().has_picture();
                let leaves_mis = best.method.direct == Direct::Mis && tried.method.direct != Direct::Mis && !plain_sky;
                let (least, significance) = if tried.method.aim != best.method.aim {
                    (GAIN_OF_AIM, SIGNIFICANCE_OF_AIM)
                } else {
                    (GAIN, if leaves_mis { SIGNIFICANCE_WITHOUT_MIS } else { SIGNIFICANCE })
                };
                // The wider the spread, the fewer pixels decide, and the more it is by their chance that ways look better.
                let few_decide = if ways { SKEW * gain.error * gain.error } else { 0.0 };
                if gain.log > least && gain.log > significance * gain.error + few_decide {
                    best = tried;
                } else if question.climbs {
                    break;
                }
            }
        }
        let (one, gain_of_ways) = of_ways.unwrap_or_else(|| (best.clone(), 1.0));
        let efficiency = |tried: &Tried| {
            if tried.method.splits != one.method.splits {
                return gain_of_ways;
            }
            // In the pixels that both were tried in.
            let (mine, least) = if tried.variances.len() == one.variances.len() {
                (tried.product(), one.product())
            } else {
                (tried.first_look(few), one.first_look(few))
            };
            if mine > 0.0 { least / mine } else { 1.0 }
        };
        let chosen = efficiency(&best);
        let considered = |tried: &Tried, efficiency: f64| Considered {
            name: label(&tried.method, facts),
            samples: tried.samples,
            variance: tried.variance(),
            cost: tried.cost(),
            efficiency,
        };
        let mut considerations: Vec<Considered> =
            all.iter().map(|tried| considered(tried, efficiency(tried) / chosen)).collect();
        if let Some((shared, gain)) = self.sharing(&best.method, group) {
            let better = libm::exp(gain.log);
            considerations.push(considered(&shared, better));
            if gain.log > WORTH_SHARING + SIGNIFICANCE * gain.error {
                considerations.iter_mut().for_each(|other| other.efficiency /= better);
                best = shared;
            }
        }
        Some((best.method.clone(), considerations))
    }

    /// What is gained where pixels share the paths of `method`, which then go on in one way, in blocks of pixels that do: about
    /// `group` pixels in each group of them. `None` where that is not to be tried.
    fn sharing(&self, method: &Method, group: usize) -> Option<(Tried, Gain)> {
        if !sharing_is_open(method, self.prepared.facts(), self.trial) {
            return None;
        }
        let mut shared = method.clone();
        shared.reuse = Reuse::Paths;
        if self.trial.named.splits.is_none() {
            shared.splits = 1;
        }
        let mut pilot = Pilot { pixels: Vec::new(), ..*self };
        pilot.spread(group.div_ceil(MEMBERS));
        let RenderSettings { seed, frame, batch, resolution, .. } = *self.settings;
        let sampler = Sampler::new(method.sampler, seed ^ SEED, frame, batch);
        let whole = |pixel: &[u32; 2]| {
            // Where all of a group is in the picture.
            let place = |i: usize| (pixel[i] / SIDE).min((resolution[i] / SIDE).checked_sub(1)?).checked_mul(SIDE);
            group_of(&sampler, resolution, [place(0)? + pixel[0] % SIDE, place(1)? + pixel[1] % SIDE])
        };
        let blocks: Option<Vec<Vec<[u32; 2]>>> = pilot.pixels.iter().map(whole).collect();
        pilot.pixels = blocks?.concat();
        let all = 0..pilot.pixels.len();
        let mut scales = vec![1.0; all.len()];
        let alone = pilot.look(method, all.clone(), &mut scales, true)?;
        let mut shared = pilot.look(&shared, all, &mut scales, false)?;
        // Where each pixel gets what it needs, those of a block get what the one needs that needs most. Where it is not known what is
        // asked, all get the same.
        let as_needed = self.trial.quality.is_some();
        for block in shared.variances.chunks_mut(MEMBERS).filter(|_| as_needed) {
            let most = block.iter().fold(0.0, |most: f64, variance| most.max(*variance));
            block.fill(most);
        }
        let gain = shared.gain(&alone);
        Some((shared, gain))
    }

    /// Try a method in the pixels `which`, whole groups of them. `scales` are what variances are relative to; `set` them from
    /// this very look.
    fn look(&self, method: &Method, which: Range<usize>, scales: &mut [f64], set: bool) -> Option<Tried> {
        let prepared = self.prepared.with_method(&self.settings.method, method)?;
        let integrator = Integrator::new(prepared.scene(), method);
        let RenderSettings { seed, frame, batch, .. } = *self.settings;
        let sampler = Sampler::new(method.sampler, seed ^ SEED, frame, batch);
        let batches = (SAMPLES / batch.max(1)).max(4);
        let size = self.pixels.len() / GROUPS;
        let groups: Vec<(Vec<Looked>, Counters)> = self.pixels[which.clone()]
            .par_chunks(size)
            .map(|pixels| group(&integrator, &sampler, pixels, batches))
            .collect();
        let mut tried = Tried { method: method.clone(), ..Tried::default() };
        let mut counters = Counters::default();
        let mut pixel = which.start;
        for (pixels, counted) in &groups {
            for looked in pixels {
                let scale = &mut scales[pixel];
                if set {
                    *scale = 1.0 / (looked.mean * looked.mean + 0.01);
                }
                let of = |variance: f64| variance * *scale;
                tried.variances.push(of(looked.variance).max(self.least_variance));
                let (plain, among_ways) = (of(looked.plain), of(looked.among_ways));
                tried.spreads.push(Spread { batches: of(looked.variance), plain, among_ways, peak: looked.peak });
                pixel += 1;
            }
            counters += *counted;
        }
        tried.samples = which.len() as u64 * u64::from(batches * batch.max(1));
        tried.work = work::work(&counters, tried.samples, &integrator, prepared.scene(), method);
        Some(tried)
    }
}

/// What was found in a pixel.
struct Looked {
    /// Mean luminance.
    mean: f64,
    /// Variance of a sample, as batch means tell it.
    variance: f64,
    /// Variance of a sample as samples tell it: as if none of them knew of the others.
    plain: f64,
    /// The part of that that the sample furthest from the mean makes up alone.
    peak: f64,
    /// Variance of a way among those of one path, mean over paths.
    among_ways: f64,
}

/// Luminance, 0 of what is not finite.
fn brightness(radiance: Rgb) -> f64 {
    if radiance.is_finite() { luminance(radiance.as_dvec3().to_array()) } else { 0.0 }
}

/// Variance of values, as a sample of them tells it.
fn variance(values: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let n = values.len() as f64;
    let mean = values.clone().sum::<f64>() / n;
    if n > 1.0 { values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / (n - 1.0) } else { 0.0 }
}

/// Look at some pixels.
fn group(integrator: &Integrator, sampler: &Sampler, pixels: &[[u32; 2]], batches: u32) -> (Vec<Looked>, Counters) {
    let mut counters = Counters::default();
    let batch = sampler.batch();
    let each = batches * batch;
    if integrator.shares() {
        return (shared(integrator, sampler, pixels, each, &mut counters), counters);
    }
    let requests: Vec<[u32; 3]> = pixels.iter().flat_map(|&[x, y]| (0..each).map(move |s| [x, y, s])).collect();
    // Of each path its luminance, and the variance of that among its ways.
    let mut values = Vec::with_capacity(requests.len());
    if integrator.has_wave() {
        let mut wave = Wave::new();
        integrator.wave(&mut wave, sampler, &requests, &[], false, &mut counters);
        values.extend((0..requests.len()).map(|i| {
            let ways = wave.ways(i).iter().map(|way| brightness(way.radiance));
            (brightness(wave.traced(i).sample.radiance), variance(ways))
        }));
    } else {
        for &[x, y, s] in &requests {
            let (radiance, ways) = sample(integrator, x, y, &sampler.stream(x, y, s), &mut counters);
            values.push((brightness(radiance), variance(ways.iter().copied())));
        }
    }
    (values.chunks(each as usize).map(|values| looked(values, batch)).collect(), counters)
}

/// What `values` tell of their pixel: of each sample the luminance and the variance among its ways.
fn looked(values: &[(f64, f64)], batch: u32) -> Looked {
    let mean_of = |values: &[(f64, f64)]| values.iter().map(|value| value.0).sum::<f64>() / values.len() as f64;
    let means: Vec<f64> = values.chunks(batch as usize).map(mean_of).collect();
    let mean = mean_of(values);
    let squares = values.iter().map(|value| (value.0 - mean) * (value.0 - mean));
    let (sum, most) = squares.fold((0.0, 0.0f64), |(sum, most), square| (sum + square, most.max(square)));
    Looked {
        mean,
        plain: sum / (values.len() - 1) as f64,
        peak: if sum > 0.0 { most / sum } else { 0.0 },
        variance: variance(means.iter().copied()) * f64::from(batch),
        among_ways: values.iter().map(|value| value.1).sum::<f64>() / values.len() as f64,
    }
}

/// Look at blocks of pixels that share their paths.
fn shared(
    integrator: &Integrator,
    sampler: &Sampler,
    pixels: &[[u32; 2]],
    each: u32,
    counters: &mut Counters,
) -> Vec<Looked> {
    let mut values = vec![Vec::with_capacity(each as usize); pixels.len()];
    let blocks = || pixels.chunks(MEMBERS);
    let (mut wave, mut room) = (Wave::new(), Together::default());
    for sample in 0..each {
        let requests: Vec<[u32; 3]> = pixels.iter().map(|[x, y]| [*x, *y, sample]).collect();
        if integrator.has_wave() {
            let ends: Vec<u32> = (1..=blocks().len()).map(|n| (n * MEMBERS).min(pixels.len()) as u32).collect();
            integrator.wave(&mut wave, sampler, &requests, &ends, false, counters);
            let luminance = |i| brightness(wave.traced(i).sample.radiance);
            values.iter_mut().enumerate().for_each(|(i, values)| values.push((luminance(i), 0.0)));
        } else {
            for (block, values) in requests.chunks(MEMBERS).zip(values.chunks_mut(MEMBERS)) {
                integrator.together(&mut room, sampler, block, None, counters);
                let luminance = |i| brightness(room.traced(i).sample.radiance);
                values.iter_mut().enumerate().for_each(|(i, values)| values.push((luminance(i), 0.0)));
            }
        }
    }
    values.iter().map(|values| looked(values, sampler.batch())).collect()
}

/// One path by itself, and the luminance that each of its ways brings.
fn sample(integrator: &Integrator, x: u32, y: u32, stream: &Stream, counters: &mut Counters) -> (Rgb, Vec<f64>) {
    struct Ways(Vec<f64>);
    impl Probe for Ways {
        fn way(&mut self, radiance: Rgb) {
            self.0.push(brightness(radiance));
        }
    }
    if !integrator.splits() {
        return (integrator.sample(x, y, stream, counters).radiance, Vec::new());
    }
    let mut ways = Ways(Vec::new());
    (integrator.probed(x, y, stream, counters, &mut ways).radiance, ways.0)
}

#[cfg(test)]
mod tests;
