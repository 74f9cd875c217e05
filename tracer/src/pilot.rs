//! The pilot: tries the methods that could serve a scene and keeps the one with the least variance x cost.
//!
//! What the facts rule out is not tried. The rest is asked one question after the other (how direct light is
//! estimated; which light; where on it; how many samples; in how many ways paths go on), each alternative against the best
//! so far, on the same pixels. Work is counted, not timed, and the samples are of another seed than the
//! picture's and are thrown away: the choice is a pure function of scene, settings and [`Trial`], the same
//! on every machine, and says nothing of the picture's noise.

use std::ops::Range;

use common::{
    adaptive,
    job::Quality,
    luminance,
    method::{Direct, LightPick, LightSampling, Method, Roulette},
    plan::{Considered, Facts, LEAST_PIXELS, MethodPlan, RuledOut, Trial, label},
    protocol::RenderSettings,
    tile::Rect,
};
use rayon::prelude::*;

use crate::{
    Prepared,
    geometry::Counters,
    integrator::{Integrator, Wave},
    sampler::Sampler,
    scene::Scene,
};

/// Samples of a pixel of the pilot.
const SAMPLES: u32 = 64;
/// Samples of a whole pilot for each pixel of the picture.
const SHARE: usize = 8;
/// Most samples of a pilot, about.
const MOST: usize = 300_000;
/// A pilot takes at most about this many times the samples of one look at one method.
const LOOKS: usize = 24;
/// Pixels go in this many groups: work for threads, and the spread of a ratio is told from them.
const GROUPS: usize = 16;
/// A first look is at so many of them, the second at the others.
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
/// What this share of pixels does not exceed is usual.
const USUAL: f64 = 0.97;
/// More lights than this are never all sampled at one hit.
const MOST_OF_ALL: u32 = 8;
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
    let (method, considered) = match untried {
        Some(_) => (first, Vec::new()),
        None => Pilot::new(prepared, settings, trial).run(first, &questions),
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
    let pilot = Pilot::new(prepared, settings, &trial);
    let count = pilot.pixels.len();
    let tried = pilot.look(&settings.method, 0..count, &mut vec![1.0; count], false);
    tried.map_or(f64::NAN, |tried| tried.cost())
}

/// What is taken where nothing better is found: light sampling and BSDF sampling under multiple importance
/// sampling, a light by the tree, a point by solid angle, late roulette.
fn begin(method: &Method, facts: &Facts, trial: &Trial) -> Method {
    let mut method = method.clone();
    if method.direct == Direct::Auto {
        if trial.named.roulette.is_none() {
            // On no scene measured is another roulette better by more than a hundredth, and to tell that by a trial would
            // take more samples than it saves: paths that are let live find what is rare.
            method.roulette = Roulette::Late;
        }
        method.direct = if facts.light_can_be_hit() || facts.lights == 0 { Direct::Mis } else { Direct::Light };
    }
    if !facts.one_emitter && facts.lights > 0 && trial.named.light_pick.is_none() {
        method.light_pick = Some(LightPick::Tree);
    }
    if facts.area_lights && trial.named.light_sampling.is_none() {
        method.light_sampling = Some(LightSampling::SolidAngle);
    }
    method
}

/// Another way to answer a question.
type Change = Box<dyn Fn(&mut Method) + Sync>;

/// A question that a scene leaves open, with the answers beside the first.
struct Question {
    ways: Vec<Change>,
    /// Whether a way is worth a trial only where the one before it was better.
    climbs: bool,
    /// Whether pixels that vary far more than most count as if they did not: of methods that find rare light in the same
    /// way, a trial's few rare samples say nothing.
    robust: bool,
}

impl Question {
    fn of(ways: Vec<Change>) -> Self {
        Self { ways, climbs: false, robust: false }
    }
}

/// The questions that a scene leaves open.
fn questions(first: &Method, facts: &Facts, trial: &Trial) -> Vec<Question> {
    let named = &trial.named;
    let mut all: Vec<Question> = Vec::new();
    if facts.lights == 0 || first.max_depth == 0 {
        return all;
    }
    if named.direct.is_none_or(|direct| direct == Direct::Auto) && facts.light_can_be_hit() {
        let mut ways: Vec<Change> = vec![Box::new(|m| m.direct = Direct::Light)];
        if !facts.delta_lights {
            ways.push(Box::new(|m| m.direct = Direct::Bsdf));
        }
        all.push(Question::of(ways));
    }
    if named.light_pick.is_none() && !facts.one_emitter {
        let mut ways: Vec<Change> = vec![Box::new(|m| m.light_pick = Some(LightPick::Power))];
        if facts.lights > 1 {
            ways.push(Box::new(|m| m.light_pick = Some(LightPick::One)));
            if facts.lights <= MOST_OF_ALL {
                ways.push(Box::new(|m| m.light_pick = Some(LightPick::All)));
            }
        }
        all.push(Question::of(ways));
    }
    if named.light_sampling.is_none() && facts.area_lights {
        all.push(Question::of(vec![Box::new(|m| m.light_sampling = Some(LightSampling::Area))]));
    }
    if counted(trial) {
        return all;
    }
    if named.light_samples.is_none() && (facts.area_lights || facts.environment || facts.lights > 1) {
        let ways: Vec<Change> = vec![Box::new(|m| m.light_samples = 2), Box::new(|m| m.light_samples = 4)];
        all.push(Question { climbs: true, ..Question::of(ways) });
    }
    if named.splits.is_none() && first.max_depth > 1 {
        // On every scene measured four ways are the best of 1, 2, 4, 8 and 16, or one is.
        all.push(Question { robust: true, ..Question::of(vec![Box::new(|m| m.splits = 4)]) });
    }
    all
}

/// Whether a number of samples is asked for.
fn counted(trial: &Trial) -> bool {
    matches!(trial.quality, Some(Quality::Samples { .. }))
}

/// The variance of a sample relative to the square of the luminance below which a pixel is done with the samples that it gets
/// in any case: less variance saves nothing there.
fn least_variance(trial: &Trial, batch: u32) -> f64 {
    match trial.quality {
        Some(Quality::Noise { relative_error, confidence, .. }) => {
            let error = relative_error / adaptive::normal_quantile(0.5 + 0.5 * confidence);
            f64::from(adaptive::PILOT_BATCHES * batch) * error * error
        }
        _ => 0.0,
    }
}

/// Ways to estimate light that are not tried, each with why: the facts or the user rule them out.
#[must_use]
pub fn ruled_out(facts: &Facts, trial: &Trial) -> Vec<RuledOut> {
    let named = &trial.named;
    let mut all = Vec::new();
    let mut add = |what: &str, why: &str| all.push(RuledOut { what: what.into(), why: why.into() });
    if facts.lights == 0 {
        add("every way to sample lights", "there is no light");
        return all;
    }
    match named.direct {
        Some(direct) if direct != Direct::Auto => add("other estimators of direct light", "one is named"),
        _ => {
            add("hemisphere", "BSDF sampling finds the same light, and more often");
            if !facts.light_can_be_hit() {
                add("mis, bsdf", "no ray can hit a light");
            } else if facts.delta_lights {
                add("bsdf", "it finds no point, spot or directional light");
            }
        }
    }
    if named.light_pick.is_some() {
        add("other choices of a light", "one is named");
    } else if facts.one_emitter {
        add("one, all, power, tree", "one emitter gives all light");
    } else if facts.lights == 1 {
        add("one, all", "with one light they are power");
    } else if facts.lights > MOST_OF_ALL {
        add("all", &format!("more than {MOST_OF_ALL} lights would be sampled at every hit"));
    }
    if named.light_sampling.is_some() {
        add("other places on a light", "one way is named");
    } else if facts.area_lights {
        add("stratified", "the points of a batch are stratified over a light as they are");
    } else {
        add("area, stratified, solid-angle", "no light has a surface");
    }
    if counted(trial) {
        add("light-samples and splits above 1", "a number of samples is asked for, and they would make each dearer");
    } else if named.light_samples.is_some() {
        add("other numbers of light samples", "one is named");
    } else if !(facts.area_lights || facts.environment || facts.lights > 1) {
        add("light-samples above 1", "one sample of the only light tells all");
    }
    if named.roulette.is_some() {
        add("other roulettes", "one is named");
    } else {
        add("throughput, fixed, off", "late is as good or better on every scene measured");
    }
    all
}

/// What a method was found to be worth.
#[derive(Debug, Clone, Default)]
struct Tried {
    method: Method,
    /// Of each pixel, the variance of a sample over luminance^2 + 0.01.
    variances: Vec<f64>,
    /// Pixels of a group.
    group: usize,
    samples: u64,
    work: f64,
}

impl Tried {
    fn variance(&self) -> f64 {
        self.variances.iter().sum::<f64>() / self.variances.len().max(1) as f64
    }

    /// Sums over the pixels of each group, none more than `most`.
    fn sums(&self, most: f64) -> [f64; GROUPS] {
        let mut sums = [0.0; GROUPS];
        for (sum, pixels) in sums.iter_mut().zip(self.variances.chunks(self.group.max(1))) {
            *sum = pixels.iter().map(|variance| variance.min(most)).sum();
        }
        sums
    }

    /// What few pixels exceed.
    fn usual(&self) -> f64 {
        let mut sorted = self.variances.clone();
        sorted.sort_by(f64::total_cmp);
        let at = (USUAL * sorted.len() as f64) as usize;
        sorted.get(at).copied().filter(|usual| *usual > 0.0).unwrap_or(f64::INFINITY)
    }

    fn cost(&self) -> f64 {
        self.work / self.samples.max(1) as f64
    }

    /// Variance x cost.
    fn product(&self) -> f64 {
        self.variance() * self.cost()
    }

    /// Variance x cost of the pixels of a first look alone, up to a factor that is the same for all.
    fn first_look(&self, most: f64) -> f64 {
        self.sums(most)[..FIRST_GROUPS].iter().sum::<f64>() * self.cost()
    }

    /// Take in what was found in other pixels.
    fn add(&mut self, other: &Tried) {
        self.variances.extend(&other.variances);
        self.samples += other.samples;
        self.work += other.work;
    }

    /// Logarithm of the efficiency relative to `other`, looked at in the same pixels, and its standard error:
    /// the jackknife over groups. No pixel counts for more than `most`.
    fn gain(&self, other: &Tried, most: f64) -> (f64, f64) {
        let (my_sums, their_sums) = (self.sums(most), other.sums(most));
        let (mine, theirs): (f64, f64) = (my_sums.iter().sum(), their_sums.iter().sum());
        let costs = other.cost() / self.cost();
        let log = |mine: f64, theirs: f64| libm::log((theirs * costs / mine).clamp(1e-9, 1e9));
        let without = |i: usize| log(mine - my_sums[i], theirs - their_sums[i]);
        let mean = (0..GROUPS).map(without).sum::<f64>() / GROUPS as f64;
        let spread: f64 = (0..GROUPS).map(|i| (without(i) - mean) * (without(i) - mean)).sum();
        (log(mine, theirs), (spread * (GROUPS - 1) as f64 / GROUPS as f64).sqrt())
    }
}

struct Pilot<'a> {
    prepared: &'a Prepared,
    settings: &'a RenderSettings,
    /// Columns and rows, spread over the region so that the first few are spread as well.
    pixels: Vec<[u32; 2]>,
    /// Pixels of a first look.
    few: usize,
    /// See [`least_variance`].
    least_variance: f64,
}

impl<'a> Pilot<'a> {
    fn new(prepared: &'a Prepared, settings: &'a RenderSettings, trial: &Trial) -> Self {
        let region = trial.region;
        let least_variance = least_variance(trial, settings.batch);
        let samples = (region.area() * SHARE).min(MOST);
        // Of whole groups, so that a second look goes on where the first ended.
        let few = (samples / (LOOKS * SAMPLES as usize)).next_multiple_of(FIRST_GROUPS).max(FIRST_GROUPS);
        // The R2 sequence (Roberts 2018): multiples of 1/g and 1/g^2, g^3 = g + 1.
        let place = |i: usize, step: f64, length: u32| {
            let at = (0.5 + (i + 1) as f64 * step).fract();
            ((at * f64::from(length)) as u32).min(length.saturating_sub(1))
        };
        let pixel = |i| {
            [region.x + place(i, 0.754_877_666_246_693, region.w), region.y + place(i, 0.569_840_290_998_053, region.h)]
        };
        Self { prepared, settings, pixels: (0..few * GROUPS / FIRST_GROUPS).map(pixel).collect(), few, least_variance }
    }

    fn run(&self, first: Method, questions: &[Question]) -> (Method, Vec<Considered>) {
        let facts = self.prepared.facts();
        let (few, all_pixels) = (self.few, self.pixels.len());
        let mut scales = vec![1.0; all_pixels];
        let mut all = Vec::new();
        let Some(mut best) = self.look(&first, 0..all_pixels, &mut scales, true) else {
            return (first, Vec::new());
        };
        all.push(best.clone());
        for question in questions {
            let most = if question.robust { best.usual() } else { f64::INFINITY };
            for change in &question.ways {
                let mut method = best.method.clone();
                change(&mut method);
                if label(&method, facts) == label(&best.method, facts) {
                    continue;
                }
                let Some(mut tried) = self.look(&method, 0..few, &mut scales, false) else { continue };
                if !question.robust && best.first_look(most) < HOPELESS * tried.first_look(most) {
                    all.push(tried);
                    if question.climbs {
                        break;
                    }
                    continue;
                }
                let Some(rest) = self.look(&method, few..all_pixels, &mut scales, false) else { continue };
                tried.add(&rest);
                let (gain, error) = tried.gain(&best, most);
                all.push(tried.clone());
                // A sky of one colour hides nothing from chance.
                let plain_sky = !facts.area_lights && !self.prepared.scene().lights().has_picture();
                let leaves_mis = best.method.direct == Direct::Mis && tried.method.direct != Direct::Mis && !plain_sky;
                let significance = if leaves_mis { SIGNIFICANCE_WITHOUT_MIS } else { SIGNIFICANCE };
                // What the usual pixels promise, the others must not contradict: they are in the picture too.
                let contradicted = question.robust && tried.gain(&best, f64::INFINITY).0 < 0.0;
                if gain > GAIN && gain > significance * error && !contradicted {
                    best = tried;
                } else if question.climbs {
                    break;
                }
            }
        }
        let efficiency = |tried: &Tried| {
            // In the pixels that both were tried in.
            let (mine, least) = if tried.variances.len() == best.variances.len() {
                (tried.product(), best.product())
            } else {
                (tried.first_look(f64::INFINITY), best.first_look(f64::INFINITY))
            };
            if mine > 0.0 { least / mine } else { 1.0 }
        };
        let considered = all.iter().map(|tried| Considered {
            name: label(&tried.method, facts),
            samples: tried.samples,
            variance: tried.variance(),
            cost: tried.cost(),
            efficiency: efficiency(tried),
        });
        (best.method.clone(), considered.collect())
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
        let groups: Vec<(Vec<(f64, f64)>, Counters)> = self.pixels[which.clone()]
            .par_chunks(size)
            .map(|pixels| group(&integrator, &sampler, pixels, batches))
            .collect();
        let mut tried = Tried { method: method.clone(), group: size, ..Tried::default() };
        let mut counters = Counters::default();
        let mut pixel = which.start;
        for (pixels, counted) in &groups {
            for &(mean, variance) in pixels {
                let scale = &mut scales[pixel];
                if set {
                    *scale = 1.0 / (mean * mean + 0.01);
                }
                tried.variances.push((variance * *scale).max(self.least_variance));
                pixel += 1;
            }
            counters += *counted;
        }
        tried.samples = which.len() as u64 * u64::from(batches * batch.max(1));
        tried.work = work(&counters, tried.samples, &integrator, prepared.scene(), method);
        Some(tried)
    }
}

/// Of each pixel, the mean luminance and the variance of a sample, as batch means tell it.
fn group(integrator: &Integrator, sampler: &Sampler, pixels: &[[u32; 2]], batches: u32) -> (Vec<(f64, f64)>, Counters) {
    let mut counters = Counters::default();
    let batch = sampler.batch();
    let each = batches * batch;
    let requests: Vec<[u32; 3]> = pixels.iter().flat_map(|&[x, y]| (0..each).map(move |s| [x, y, s])).collect();
    let mut values = Vec::with_capacity(requests.len());
    let of =
        |radiance: crate::math::Rgb| if radiance.is_finite() { luminance(radiance.as_dvec3().to_array()) } else { 0.0 };
    if integrator.has_wave() {
        let mut wave = Wave::new();
        integrator.wave(&mut wave, sampler, &requests, false, &mut counters);
        values.extend((0..requests.len()).map(|i| of(wave.traced(i).sample.radiance)));
    } else {
        for &[x, y, s] in &requests {
            values.push(of(integrator.sample(x, y, &sampler.stream(x, y, s), &mut counters).radiance));
        }
    }
    let pixel = |values: &[f64]| {
        let means: Vec<f64> =
            values.chunks(batch as usize).map(|batch| batch.iter().sum::<f64>() / batch.len() as f64).collect();
        let mean = means.iter().sum::<f64>() / means.len() as f64;
        let m2: f64 = means.iter().map(|m| (m - mean) * (m - mean)).sum();
        (mean, m2 / (means.len() - 1) as f64 * f64::from(batch))
    };
    (values.chunks(each as usize).map(pixel).collect(), counters)
}

/// Counted work, about nanoseconds: each kind of step at what it was measured to take on one core of an AVX-512
/// machine, fitted over all combinations of choices and the shipped scenes (`tessera bench auto` shows both). What
/// matters is how methods compare within a scene: of those within twice the best, that is off by 3% (one standard
/// deviation).
fn work(counters: &Counters, samples: u64, integrator: &Integrator, scene: &Scene, method: &Method) -> f64 {
    let small = scene.accel().is_small();
    let (sample, vertex, ray, node, primitive) = match (integrator.has_wave(), small) {
        (true, true) => (125.0, 70.0, 1.0, 0.0, 0.0),
        (true, false) => (125.0, 70.0, 3.0, 0.65, 6.7),
        (false, _) => (100.0, 180.0, 40.0, 48.0, 0.0),
    };
    // Paths that go on in several ways wait for lanes, and draw from larger sets of points.
    let ray = if method.splits > 1 { ray + 38.0 } else { ray };
    samples as f64 * sample
        + counters.vertices as f64 * vertex
        + counters.light_samples as f64 * light_sample(scene, method, integrator.has_wave())
        + counters.rays as f64 * ray
        + counters.node_tests as f64 * node
        + counters.primitive_tests as f64 * primitive
}

/// Counted work of a sample of a light; that of its ray is partly in here.
fn light_sample(scene: &Scene, method: &Method, in_waves: bool) -> f64 {
    let facts = scene.facts();
    let by_area = matches!(method.light_sampling, Some(LightSampling::Area | LightSampling::Stratified));
    let point = match (in_waves, by_area) {
        (true, _) if scene.lights().lone_rectangle().is_some() => 88.0,
        (true, true) => 137.0,
        (true, false) => 162.0,
        (false, true) => 50.0,
        (false, false) => 70.0,
    };
    let choice = match (method.light_pick, in_waves) {
        _ if facts.one_emitter => 0.0,
        (Some(LightPick::Tree) | None, true) => 12.0 + 20.0 * libm::log2(f64::from(facts.emitters.max(2))),
        (Some(LightPick::Tree) | None, false) => 45.0 + 20.0 * libm::log2(f64::from(facts.emitters.max(2))),
        (Some(LightPick::Power | LightPick::One), _) => 8.0,
        (Some(LightPick::All), _) => 0.0,
    };
    point + choice
}

#[cfg(test)]
mod tests {
    use common::{method::MethodChoices, pass::Work, scene::SceneFile, tile::Rect};
    use serde_json::{Value, json};

    use super::*;
    use crate::testing::{prepare, render, settings};

    fn scene(rest: Value) -> SceneFile {
        let mut scene = json!({
            "tessera": 1, "camera": { "position": [0, 1, 6], "target": [0, 1, 0], "fov": 50 },
            "film": { "width": 128, "height": 128 },
            "shapes": [{ "type": "quad", "vertices": [[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]] },
                       { "type": "sphere", "center": [0, 0.6, 0], "radius": 0.6 }]
        });
        for (key, value) in rest.as_object().unwrap() {
            match (scene.get_mut(key), value) {
                (Some(Value::Array(old)), Value::Array(new)) => old.extend(new.iter().cloned()),
                _ => scene[key] = value.clone(),
            }
        }
        SceneFile::parse(scene.to_string().as_bytes()).unwrap()
    }

    fn plan_for(scene: &SceneFile, method: &Method, named: MethodChoices) -> MethodPlan {
        let region = Rect::frame(scene.film.width, scene.film.height);
        choose(&prepare(scene, method), &settings(scene, method, 16), &Trial { region, named, quality: None })
    }

    fn plan(scene: &SceneFile) -> MethodPlan {
        plan_for(scene, &Method::default(), MethodChoices::default())
    }

    fn small_lamp() -> SceneFile {
        scene(json!({ "shapes": [{ "type": "disk", "center": [0, 3, 0], "normal": [0, -1, 0], "radius": 0.1,
            "emission": 100 }] }))
    }

    #[test]
    fn a_small_lamp_is_sampled_and_a_white_sky_is_run_into() {
        let lamp = plan(&small_lamp());
        assert!(matches!(lamp.method.direct, Direct::Light | Direct::Mis), "{lamp:?}");
        let bsdf = lamp.considered.iter().find(|tried| tried.name.starts_with("bsdf")).unwrap();
        assert!(bsdf.efficiency < 0.5, "{lamp:?}");
        let sky = plan(&scene(json!({ "environment": { "type": "constant", "radiance": 1 } })));
        assert_eq!(sky.method.direct, Direct::Bsdf, "a sample of a white sky costs a ray and tells nothing: {sky:?}");
    }

    #[test]
    fn what_is_chosen_has_the_best_efficiency_of_what_was_tried_or_nearly() {
        for scene in [small_lamp(), scene(json!({ "environment": { "type": "constant", "radiance": 1 } }))] {
            let plan = plan(&scene);
            assert!(
                plan.considered.iter().any(|tried| tried.name == plan.chosen && tried.efficiency == 1.0),
                "{plan:?}"
            );
            // A first look at few pixels may flatter what a second found no better.
            assert!(plan.considered.iter().all(|tried| tried.efficiency < 1.3), "{plan:?}");
        }
    }

    #[test]
    fn paths_split_where_that_pays_for_what_is_asked() {
        let sky = scene(json!({ "environment": { "type": "constant", "radiance": 1 } }));
        let splits = |quality: Option<Quality>| {
            let region = Rect::frame(sky.film.width, sky.film.height);
            let trial = Trial { region, named: MethodChoices::default(), quality };
            let method = Method::default();
            choose(&prepare(&sky, &method), &settings(&sky, &method, 16), &trial).method.splits
        };
        let noise = |relative_error| Quality::Noise { relative_error, confidence: 0.95, max_samples: 4096 };
        assert!(splits(None) > 1, "more ways are spread more evenly, and share a camera ray");
        assert!(splits(Some(noise(1e-4))) > 1);
        assert_eq!(splits(Some(noise(0.5))), 1, "the first samples do for that");
        assert_eq!(splits(Some(Quality::Samples { samples: 64 })), 1, "a number of samples is a price");
    }

    #[test]
    fn the_choice_depends_on_neither_threads_nor_turns() {
        let scene = small_lamp();
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| plan(&scene)), plan(&scene));
    }

    #[test]
    fn what_is_named_is_kept_and_what_facts_rule_out_is_not_tried() {
        let named = MethodChoices {
            light_sampling: Some(Some(LightSampling::Area)),
            light_samples: Some(1),
            roulette: Some(Roulette::Off),
            ..MethodChoices::default()
        };
        let plan_of = |named: MethodChoices| plan_for(&small_lamp(), &named.clone().resolve(), named);
        let plan = plan_of(named.clone());
        assert!(
            plan.considered.len() > 1 && plan.considered.iter().all(|tried| !tried.name.contains("solid")),
            "{plan:?}"
        );
        assert_eq!((plan.method.light_samples, plan.method.roulette), (1, Roulette::Off));
        let all = plan_of(MethodChoices { direct: Some(Direct::Mis), ..named });
        assert_eq!((all.untried.as_deref(), all.considered.len()), (Some("the method is named"), 0));

        let point = json!({ "lights": [{ "type": "point", "position": [0, 3, 1], "intensity": 9 }] });
        let plan = super::tests::plan(&scene(point));
        assert_eq!(plan.method.direct, Direct::Light, "no ray can hit a point");
        assert!(plan.considered.iter().all(|tried| tried.name.starts_with("light")), "{plan:?}");
        assert_eq!(super::tests::plan(&scene(json!({}))).untried.as_deref(), Some("there is no light"));
        let tiny = scene(json!({ "film": { "width": 16, "height": 16 },
            "environment": { "type": "constant", "radiance": 1 } }));
        assert!(super::tests::plan(&tiny).untried.unwrap().contains("small"));
    }

    #[test]
    fn a_scene_for_another_method_has_the_bits_of_one_loaded_for_it() {
        let scene = scene(json!({ "shapes": [
            { "type": "disk", "center": [0, 3, 0], "normal": [0, -1, 0], "radius": 0.4, "emission": 9 },
            { "type": "sphere", "center": [2, 2, 0], "radius": 0.2, "emission": 9 }] }));
        let old = Method::default();
        let prepared = prepare(&scene, &old);
        for (light_pick, light_sampling, direct) in [
            (LightPick::Power, LightSampling::Area, Direct::Mis),
            (LightPick::All, LightSampling::SolidAngle, Direct::Light),
            (LightPick::One, LightSampling::Stratified, Direct::Bsdf),
        ] {
            let method =
                Method { direct, light_pick: Some(light_pick), light_sampling: Some(light_sampling), ..old.clone() };
            let settings = settings(&scene, &method, 16);
            let again = prepared.with_method(&old, &method).unwrap();
            let work = Work::Uniform { first: 0, samples: 4 };
            let shared = crate::testing::render_rect(&again, &settings, Rect::frame(128, 128), work.clone());
            assert!(shared.film.moments == render(&scene, &method, work, 16).film.moments, "{method:?}");
        }
        let schlick = Method { fresnel: common::method::Fresnel::Schlick, ..old.clone() };
        assert!(prepared.with_method(&old, &schlick).is_none(), "materials depend on it");
    }

    /// The choice must not be made by the very samples of the picture, and the mean must not depend on it.
    #[test]
    fn the_picture_by_the_chosen_method_has_the_mean_of_the_others() {
        let scene = small_lamp();
        let plan = plan(&scene);
        let n = Work::Uniform { first: 0, samples: 64 };
        let chosen = render(&scene, &plan.method, n.clone(), 16);
        let other =
            render(&scene, &Method { direct: Direct::Mis, roulette: Roulette::Off, ..Method::default() }, n, 16);
        let ((a, ea), (b, eb)) = (chosen.mean_and_error(), other.mean_and_error());
        assert!((a - b).abs() < 4.0 * (ea * ea + eb * eb).sqrt(), "{a} ± {ea}, {b} ± {eb}");
    }
}
