//! What a scene needs, and which method was chosen for it: the facts, the estimators that were tried, the
//! choice. Made by whoever has the scene, kept with the job, shown to people.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    job::Quality,
    method::{Aim, Direct, LightPick, LightSampling, Method, MethodChoices, Reuse, Roulette},
    tile::Rect,
};

/// Fewest pixels of a frame for which methods are tried: below, the trial would cost as much as the picture.
pub const LEAST_PIXELS: usize = 128 * 128;

/// What is in a scene. What is not is never computed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Facts {
    /// Mirrors, smooth glass or metal, smooth coats.
    pub delta: bool,
    /// Light passes through some surface.
    pub transmission: bool,
    /// Microfacets or lobes: anything that is neither diffuse nor perfectly smooth.
    pub rough: bool,
    /// Values that vary over a surface.
    pub textures: bool,
    /// Normal maps, or roughness with a direction: tangents are needed.
    pub tangents: bool,
    /// Shading normals other than the geometric ones.
    pub smooth_normals: bool,
    /// Opacity masks.
    pub opacity: bool,
    /// Groups placed more than once.
    pub instances: bool,
    /// Rays that leave the scene meet light.
    pub environment: bool,
    /// Surfaces that give light.
    pub area_lights: bool,
    /// Lights without a surface.
    pub delta_lights: bool,
    /// Exactly one primitive, lamp or environment gives all light: nothing is to be chosen.
    pub one_emitter: bool,
    /// Lights: surfaces, lamps and the environment; an emissive mesh is one.
    pub lights: u32,
    /// Primitives of surfaces that give light.
    pub emitters: u32,
    /// Triangles, those of instances counted once.
    pub triangles: u64,
}

impl Facts {
    /// Whether a hit needs more than its geometric normal.
    #[must_use]
    pub fn attributes(&self) -> bool {
        self.textures || self.tangents || self.smooth_normals || self.instances
    }

    /// Whether a scattered ray can find light by chance.
    #[must_use]
    pub fn light_can_be_hit(&self) -> bool {
        self.area_lights || self.environment
    }

    /// What the scene has, and what it has not and nothing is spent on: names for people.
    #[must_use]
    pub fn has_and_has_not(&self) -> (Vec<&'static str>, Vec<&'static str>) {
        let all = [
            (self.area_lights, "area lights"),
            (self.delta_lights, "point, spot or directional lights"),
            (self.environment, "an environment"),
            (!self.one_emitter && self.lights > 0, "more than one emitter"),
            (self.delta, "mirrors or smooth glass"),
            (self.rough, "rough surfaces"),
            (self.transmission, "transmission"),
            (self.textures, "textures"),
            (self.smooth_normals, "shading normals"),
            (self.tangents, "tangents"),
            (self.opacity, "opacity masks"),
            (self.instances, "instances"),
        ];
        let names = |has: bool| all.iter().filter(|fact| fact.0 == has).map(|fact| fact.1).collect();
        (names(true), names(false))
    }
}

/// What a trial of methods is asked for; with the scene and the settings of its frame all that it depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// Part of the frame that will be rendered.
    pub region: Rect,
    /// Choices that were made already.
    pub named: MethodChoices,
    /// What is asked of the picture, where that is known. A number of samples is a price: methods that make a sample dearer are
    /// not tried. An error is reached by no pixel with fewer samples than it gets in any case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
}

/// A method and what it costs, as far as it was tried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Considered {
    /// The method in short, as [`label`] writes it.
    pub name: String,
    /// Samples taken of it.
    pub samples: u64,
    /// Variance of one sample's luminance relative to luminance^2 + 0.01, mean over pixels, as its share of the
    /// mean of a batch tells it; where an error is asked for, at least what any pixel's first samples bring down to that.
    pub variance: f64,
    /// Counted work of a sample, about nanoseconds of one core.
    pub cost: f64,
    /// Efficiency, 1 / (variance x cost), relative to the method chosen. Of paths that go on in several ways, variances that hang on
    /// single samples are left out of that: they are foretold by the law of total variance.
    pub efficiency: f64,
}

/// Estimators that were not tried, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RuledOut {
    /// Values of a method option, or what they have in common.
    pub what: String,
    /// Why.
    pub why: String,
}

/// What was chosen for a scene, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MethodPlan {
    /// What is in the scene.
    pub facts: Facts,
    /// The choice in short.
    pub chosen: String,
    /// The choice: what the job renders with.
    pub method: Method,
    /// The code that fits the scene, in words.
    pub kernel: Vec<String>,
    /// Why nothing was tried, where that is so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub untried: Option<String>,
    /// What was tried, the choice among it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub considered: Vec<Considered>,
}

impl MethodPlan {
    /// One line for people.
    #[must_use]
    pub fn line(&self) -> String {
        match &self.untried {
            Some(why) => format!("{} ({why})", self.chosen),
            None => format!("{} (best of {} methods tried)", self.chosen, self.considered.len()),
        }
    }
}

impl fmt::Display for MethodPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.line())
    }
}

/// A method in short: what this module's choices are about, joined by `+`, as `tessera chart --methods` takes it.
#[must_use]
pub fn label(method: &Method, facts: &Facts) -> String {
    let mut words = vec![method.direct.name().to_owned()];
    if matches!(method.direct, Direct::Light | Direct::Mis | Direct::Auto) && facts.lights > 0 {
        if !facts.one_emitter {
            words.push(method.light_pick.unwrap_or(LightPick::Tree).name().to_owned());
        }
        if facts.area_lights {
            words.push(method.light_sampling.unwrap_or(LightSampling::SolidAngle).name().to_owned());
        }
    }
    if method.light_samples > 1 && method.direct != Direct::Bsdf {
        words.push(format!("light-samples={}", method.light_samples));
    }
    if method.splits > 1 {
        words.push(format!("splits={}", method.splits));
    }
    if method.reuse != Reuse::Off {
        words.push(format!("reuse={}", method.reuse));
    }
    if method.aim != Aim::Off {
        words.push(format!("aim={}", method.aim));
    }
    if method.roulette != Roulette::Throughput {
        words.push(method.roulette.name().to_owned());
    }
    words.join("+")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_tells_what_was_chosen_and_nothing_else() {
        let one = Facts { lights: 1, area_lights: true, one_emitter: true, ..Facts::default() };
        let many = Facts { lights: 3, one_emitter: false, ..one };
        let mis = Method { direct: Direct::Mis, ..Method::default() };
        assert_eq!(label(&mis, &one), "mis+solid-angle");
        assert_eq!(label(&mis, &many), "mis+tree+solid-angle");
        let other = Method { light_samples: 2, roulette: Roulette::Late, light_pick: Some(LightPick::Power), ..mis };
        assert_eq!(label(&other, &many), "mis+power+solid-angle+light-samples=2+late");
        let aimed = Method { aim: Aim::Delta, ..other.clone() };
        assert_eq!(label(&aimed, &many), "mis+power+solid-angle+light-samples=2+aim=delta+late");
        assert_eq!(label(&Method { direct: Direct::Bsdf, ..other }, &many), "bsdf+late");
    }

    #[test]
    fn every_fact_is_told_as_had_or_as_left_out() {
        let (has, has_not) = Facts { delta: true, ..Facts::default() }.has_and_has_not();
        assert_eq!((has.len(), has_not.len()), (1, 11));
    }
}
