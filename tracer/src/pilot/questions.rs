//! What a scene leaves open: where a pilot begins, and the questions that it asks.

use common::{
    job::Quality,
    method::{Aim, Direct, LightPick, LightSampling, Method, Reuse, Roulette},
    plan::{Facts, RuledOut, Trial},
};

/// More lights than this are never all sampled at one hit.
const MOST_OF_ALL: u32 = 8;

/// What is taken where nothing better is found: light sampling and BSDF sampling under multiple importance
/// sampling, a light by the tree, a point by solid angle, late roulette.
pub(super) fn begin(method: &Method, facts: &Facts, trial: &Trial) -> Method {
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
pub(super) struct Question {
    pub(super) ways: Vec<Change>,
    /// Whether a way is worth a trial only where the one before it was better.
    pub(super) climbs: bool,
    /// Work of asking it, in units of one method's in all pixels, about.
    pub(super) looks: f64,
}

impl Question {
    fn of(looks: f64, ways: Vec<Change>) -> Self {
        Self { ways, climbs: false, looks }
    }
}

/// The questions that a scene leaves open.
pub(super) fn questions(first: &Method, facts: &Facts, trial: &Trial) -> Vec<Question> {
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
        all.push(Question::of(1.0 + 0.3 * (ways.len() - 1) as f64, ways));
    }
    if named.light_pick.is_none() && !facts.one_emitter {
        let mut ways: Vec<Change> = vec![Box::new(|m| m.light_pick = Some(LightPick::Power))];
        if facts.lights > 1 {
            ways.push(Box::new(|m| m.light_pick = Some(LightPick::One)));
            if facts.lights <= MOST_OF_ALL {
                ways.push(Box::new(|m| m.light_pick = Some(LightPick::All)));
            }
        }
        all.push(Question::of(ways.len() as f64, ways));
    }
    if named.light_sampling.is_none() && facts.area_lights {
        all.push(Question::of(1.0, vec![Box::new(|m| m.light_sampling = Some(LightSampling::Area))]));
    }
    if named.aim.is_none() && first.max_depth > 1 && unaimed(facts, first.reuse).is_none() {
        // Before the others: what is found by chance once in a while would decide them.
        all.insert(0, Question::of(1.0, vec![Box::new(|m| m.aim = Aim::Delta)]));
    }
    if counted(trial) {
        return all;
    }
    if named.light_samples.is_none() && (facts.area_lights || facts.environment || facts.lights > 1) {
        let ways: Vec<Change> = vec![Box::new(|m| m.light_samples = 2), Box::new(|m| m.light_samples = 4)];
        all.push(Question { climbs: true, ..Question::of(2.0, ways) });
    }
    if named.splits.is_none() && first.max_depth > 1 {
        // On every scene measured four ways are the best of 1, 2, 4, 8 and 16, or one is.
        all.push(Question::of(3.5, vec![Box::new(|m| m.splits = 4)]));
    }
    all
}

/// Whether it is worth a trial that pixels share paths.
pub(super) fn sharing_is_open(method: &Method, facts: &Facts, trial: &Trial) -> bool {
    let open = trial.named.reuse.is_none() && method.aim == Aim::Off && !counted(trial);
    open && !facts.opacity && method.max_depth > 1 && facts.lights > 0
}

/// Why nothing is aimed at mirrors and smooth glass, if that is so.
fn unaimed(facts: &Facts, reuse: Reuse) -> Option<&'static str> {
    if reuse != Reuse::Off {
        Some("it does not go with reuse of paths")
    } else if !facts.delta {
        Some("no mirror or smooth glass sends light on")
    } else if !facts.light_can_be_hit() {
        Some("no ray can hit a light")
    } else {
        None
    }
}

/// Whether a number of samples is asked for.
fn counted(trial: &Trial) -> bool {
    matches!(trial.quality, Some(Quality::Samples { .. }))
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
    if named.reuse.is_some() {
        add("other reuse of paths", "one is named");
    } else if facts.opacity {
        add("reuse of paths", "whether one pixel's surface sees another's path is not sure behind opacity masks");
    }
    if named.aim.is_some() {
        add("aim", "it is named");
    } else if let Some(why) = unaimed(facts, named.reuse.unwrap_or(Reuse::Off)) {
        add("aim=delta", why);
    }
    if counted(trial) {
        let why = "a number of samples is asked for, and they would make each dearer";
        add("light-samples and splits above 1, reuse of paths", why);
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
