//! The pilot: tries the methods that could serve a scene and keeps the one with the least variance x cost.
//!
//! What the facts rule out is not tried. The rest is asked one question after the other (how direct light is
//! estimated; which light; where on it; how many samples; when paths end), each alternative against the best
//! so far, on the same pixels. Work is counted, not timed, and the samples are of another seed than the
//! picture's and are thrown away: the choice is a pure function of scene, settings and [`Trial`], the same
//! on every machine, and says nothing of the picture's noise.

use common::{
    luminance,
    method::{Direct, LightPick, LightSampling, Method, Roulette},
    plan::{Considered, Facts, LEAST_PIXELS, MethodPlan, Trial, label},
    protocol::RenderSettings,
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
const SHARE: usize = 4;
/// Most samples of a pilot, about.
const MOST: usize = 240_000;
/// A pilot takes at most about this many times the samples of one look at one method.
const LOOKS: usize = 24;
/// A second look takes this many times the pixels of the first.
const SECOND: usize = 4;
/// Pixels go in this many groups: work for threads, and the spread of a ratio is told from them.
const GROUPS: usize = 16;
/// A method below this efficiency at the first look is not looked at again.
const HOPELESS: f64 = 0.6;
/// A method must be better by this much to replace the one before it.
const GAIN: f64 = 0.04;
/// And by this many standard errors.
const SIGNIFICANCE: f64 = 1.5;
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

/// What is taken where nothing better is found: light sampling and BSDF sampling under multiple importance
/// sampling, a light by the tree, a point by solid angle.
fn begin(method: &Method, facts: &Facts, trial: &Trial) -> Method {
    let mut method = method.clone();
    if method.direct == Direct::Auto {
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

/// The questions that a scene leaves open, each with the answers beside the first.
fn questions(first: &Method, facts: &Facts, trial: &Trial) -> Vec<Vec<Change>> {
    let named = &trial.named;
    let mut all: Vec<Vec<Change>> = Vec::new();
    if facts.lights == 0 || first.max_depth == 0 {
        return all;
    }
    if named.direct.is_none_or(|direct| direct == Direct::Auto) && facts.light_can_be_hit() {
        let mut ways: Vec<Change> = vec![Box::new(|m| m.direct = Direct::Light)];
        if !facts.delta_lights {
            ways.push(Box::new(|m| m.direct = Direct::Bsdf));
        }
        all.push(ways);
    }
    if named.light_pick.is_none() && !facts.one_emitter {
        let mut ways: Vec<Change> = vec![Box::new(|m| m.light_pick = Some(LightPick::Power))];
        if facts.lights > 1 {
            ways.push(Box::new(|m| m.light_pick = Some(LightPick::One)));
            if facts.lights <= MOST_OF_ALL {
                ways.push(Box::new(|m| m.light_pick = Some(LightPick::All)));
            }
        }
        all.push(ways);
    }
    if named.light_sampling.is_none() && facts.area_lights {
        all.push(vec![Box::new(|m| m.light_sampling = Some(LightSampling::Area))]);
    }
    if named.light_samples.is_none() && (facts.area_lights || facts.environment || facts.lights > 1) {
        all.push(vec![Box::new(|m| m.light_samples = 2), Box::new(|m| m.light_samples = 4)]);
    }
    if named.roulette.is_none() && first.max_depth > 4 {
        all.push(vec![Box::new(|m| m.roulette = Roulette::Late)]);
    }
    all
}

/// What a method was found to be worth.
#[derive(Debug, Clone, Default)]
struct Tried {
    method: Method,
    /// Of each group, the pixels' variances of a sample over their luminance^2 + 0.01, summed.
    variance: [f64; GROUPS],
    pixels: usize,
    samples: u64,
    work: f64,
}

impl Tried {
    fn variance(&self) -> f64 {
        self.variance.iter().sum::<f64>() / self.pixels.max(1) as f64
    }

    fn cost(&self) -> f64 {
        self.work / self.samples.max(1) as f64
    }

    /// Variance x cost.
    fn product(&self) -> f64 {
        self.variance() * self.cost()
    }

    /// Logarithm of the efficiency relative to `other`, looked at in the same pixels, and its standard error:
    /// the jackknife over groups.
    fn gain(&self, other: &Tried) -> (f64, f64) {
        let (mine, theirs): (f64, f64) = (self.variance.iter().sum(), other.variance.iter().sum());
        let costs = other.cost() / self.cost();
        let log = |mine: f64, theirs: f64| libm::log((theirs * costs / mine).clamp(1e-9, 1e9));
        let without = |i: usize| log(mine - self.variance[i], theirs - other.variance[i]);
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
}

impl<'a> Pilot<'a> {
    fn new(prepared: &'a Prepared, settings: &'a RenderSettings, trial: &Trial) -> Self {
        let region = trial.region;
        let samples = (region.area() * SHARE).min(MOST);
        let few = (samples / (LOOKS * SAMPLES as usize)).max(GROUPS);
        // The R2 sequence (Roberts 2018): multiples of 1/g and 1/g^2, g^3 = g + 1.
        let place = |i: usize, step: f64, length: u32| {
            let at = (0.5 + (i + 1) as f64 * step).fract();
            ((at * f64::from(length)) as u32).min(length.saturating_sub(1))
        };
        let pixel = |i| {
            [region.x + place(i, 0.754_877_666_246_693, region.w), region.y + place(i, 0.569_840_290_998_053, region.h)]
        };
        Self { prepared, settings, pixels: (0..few * SECOND).map(pixel).collect(), few }
    }

    fn run(&self, first: Method, questions: &[Vec<Change>]) -> (Method, Vec<Considered>) {
        let facts = self.prepared.facts();
        let mut scales = vec![1.0; self.pixels.len()];
        let mut all = Vec::new();
        let Some(mut best) = self.look(&first, self.pixels.len(), &mut scales, true) else {
            return (first, Vec::new());
        };
        let mut glance = self.look(&first, self.few, &mut scales, false);
        all.push(best.clone());
        for question in questions {
            for change in question {
                let mut method = best.method.clone();
                change(&mut method);
                if label(&method, facts) == label(&best.method, facts) {
                    continue;
                }
                let Some(quick) = self.look(&method, self.few, &mut scales, false) else { continue };
                let hopeless = glance.as_ref().is_some_and(|g| g.product() < HOPELESS * quick.product());
                if hopeless {
                    all.push(quick);
                    continue;
                }
                let Some(tried) = self.look(&method, self.pixels.len(), &mut scales, false) else { continue };
                let (gain, error) = tried.gain(&best);
                all.push(tried.clone());
                if gain > GAIN && gain > SIGNIFICANCE * error {
                    (best, glance) = (tried, Some(quick));
                }
            }
        }
        let product = best.product();
        let considered = all.iter().map(|tried| Considered {
            name: label(&tried.method, facts),
            samples: tried.samples,
            variance: tried.variance(),
            cost: tried.cost(),
            efficiency: if tried.product() > 0.0 { product / tried.product() } else { 1.0 },
        });
        (best.method.clone(), considered.collect())
    }

    /// Try a method in the first `count` pixels. `scales` are what variances are relative to; `set` them from
    /// this very look.
    fn look(&self, method: &Method, count: usize, scales: &mut [f64], set: bool) -> Option<Tried> {
        let prepared = self.prepared.with_method(&self.settings.method, method)?;
        let integrator = Integrator::new(prepared.scene(), method);
        let RenderSettings { seed, frame, batch, .. } = *self.settings;
        let sampler = Sampler::new(method.sampler, seed ^ SEED, frame, batch);
        let batches = (SAMPLES / batch.max(1)).max(4);
        let size = count.div_ceil(GROUPS);
        let groups: Vec<(Vec<(f64, f64)>, Counters)> =
            self.pixels[..count].par_chunks(size).map(|pixels| group(&integrator, &sampler, pixels, batches)).collect();
        let mut tried = Tried { method: method.clone(), ..Tried::default() };
        let mut counters = Counters::default();
        for (g, (pixels, counted)) in groups.iter().enumerate() {
            for (i, &(mean, variance)) in pixels.iter().enumerate() {
                let scale = &mut scales[g * size + i];
                if set {
                    *scale = 1.0 / (mean * mean + 0.01);
                }
                tried.variance[g] += variance * *scale;
            }
            tried.pixels += pixels.len();
            counters += *counted;
        }
        tried.samples = count as u64 * u64::from(batches * batch.max(1));
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

/// Counted work, about nanoseconds: each kind of step at what it was measured to take on one core of an AVX2
/// machine, fitted over methods and the shipped scenes of few primitives to 6%.
fn work(counters: &Counters, samples: u64, integrator: &Integrator, scene: &Scene, method: &Method) -> f64 {
    let in_waves = integrator.has_wave();
    let (sample, vertex, ray, node, primitive) =
        if in_waves { (0.0, 160.0, 5.0, 9.0, 0.2) } else { (190.0, 90.0, 95.0, 9.0, 2.0) };
    let lights = match method.direct {
        Direct::Bsdf => 0.0,
        _ => light(scene, method, in_waves) * f64::from(method.light_samples),
    };
    samples as f64 * sample
        + counters.vertices as f64 * (vertex + lights)
        + counters.rays as f64 * ray
        + counters.node_tests as f64 * node
        + counters.primitive_tests as f64 * primitive
}

/// Counted work of a hit's light samples, one of each light that is sampled, the rays left out.
fn light(scene: &Scene, method: &Method, in_waves: bool) -> f64 {
    let facts = scene.facts();
    let by_area = matches!(method.light_sampling, Some(LightSampling::Area | LightSampling::Stratified));
    let point = match (in_waves, by_area) {
        (true, _) if scene.lights().lone_rectangle().is_some() => 135.0,
        (true, false) => 235.0,
        (true, true) | (false, false) => 175.0,
        (false, true) => 100.0,
    };
    match method.light_pick {
        _ if facts.one_emitter => point,
        Some(LightPick::Tree) | None => point + 60.0 * libm::log2(f64::from(facts.emitters.max(2))),
        Some(LightPick::Power | LightPick::One) => point + 60.0,
        Some(LightPick::All) => (point + 40.0) * f64::from(facts.lights),
    }
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
        choose(&prepare(scene, method), &settings(scene, method, 16), &Trial { region, named })
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
