//! How light is estimated: the options of `render`, `submit` and `chart`, as part of a job.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! choice {
    ($(#[$doc:meta])* $name:ident { $($(#[$vdoc:meta])* $variant:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
        pub enum $name { $($(#[$vdoc])* #[serde(rename = $text)] $variant),+ }

        impl $name {
            /// Every value, with its name on the command line and in JSON.
            pub const ALL: &[(&str, $name)] = &[$(($text, $name::$variant)),+];

            /// Its name on the command line and in JSON.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $($name::$variant => $text),+ }
            }
        }

        impl std::str::FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                Self::ALL.iter().find(|(name, _)| *name == text).map(|(_, value)| *value).ok_or_else(|| {
                    let names: Vec<&str> = Self::ALL.iter().map(|(name, _)| *name).collect();
                    format!("\"{text}\" is not one of {}", names.join(", "))
                })
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

choice!(
    /// How direct light is estimated at a hit.
    Direct {
        /// Chosen from the scene's facts and a pilot.
        Auto = "auto",
        /// BSDF sampling alone: paths find light by running into it.
        Bsdf = "bsdf",
        /// Uniform directions over the hemisphere; light is found by chance.
        Hemisphere = "hemisphere",
        /// Next-event estimation: points on lights, no BSDF sampling of lights.
        Light = "light",
        /// Next-event estimation and BSDF sampling, weighted by multiple importance sampling.
        Mis = "mis",
    }
);

choice!(
    /// Which lights a hit samples.
    LightPick {
        /// Every light, `light_samples` times each.
        All = "all",
        /// One light, each with equal probability, `light_samples` times.
        One = "one",
        /// One light, with probability proportional to its emitted power.
        Power = "power",
        /// One light by a walk down a light tree (Conty Estevez and Kulla 2018).
        Tree = "tree",
    }
);

choice!(
    /// How a point on an area light is chosen.
    LightSampling {
        /// Uniformly over its area.
        Area = "area",
        /// Over its area, stratified: four sub-triangles, slices of a sphere.
        Stratified = "stratified",
        /// Uniformly over the solid angle it subtends.
        SolidAngle = "solid-angle",
    }
);

choice!(
    /// What neighbouring pixels share of their paths (Bekaert, Sbert and Halton 2002).
    Reuse {
        /// Nothing: every pixel's error is its own.
        Off = "off",
        /// What is found from the second surface on, among sixteen pixels, where both surfaces follow Lambert's law.
        Paths = "paths",
    }
);

choice!(
    /// Which directions are drawn by more than the BSDF.
    Aim {
        /// None.
        Off = "off",
        /// Some are aimed at mirrors and smooth glass, where light was followed to come from.
        Delta = "delta",
    }
);

choice!(
    /// A part of the light transport, rendered alone.
    Only {
        /// Light that arrives from an emitter after exactly one scattering.
        Direct = "direct",
        /// Light that was scattered at least twice.
        Indirect = "indirect",
    }
);

choice!(
    /// Fresnel reflectance.
    Fresnel {
        /// The exact equations for dielectrics and conductors.
        Exact = "exact",
        /// Schlick's approximation (1994).
        Schlick = "schlick",
    }
);

choice!(
    /// Source of sample points.
    Sampler {
        /// Owen-scrambled Sobol', one independent scramble per batch.
        Sobol = "sobol",
        /// Jittered strata in each pair of dimensions, one independent set per batch.
        Stratified = "stratified",
        /// Independent uniform numbers.
        Independent = "independent",
    }
);

choice!(
    /// Ray/triangle intersection test.
    TriangleTest {
        /// Watertight (Woop, Benthin and Wald 2013).
        Watertight = "watertight",
        /// Moeller and Trumbore (1997): leaks at edges; kept for comparison.
        MoellerTrumbore = "moeller-trumbore",
    }
);

choice!(
    /// How the tree over the scene's surfaces is split; no picture depends on it.
    Bvh {
        /// Binned surface area heuristic.
        Sah = "sah",
        /// At the mean of the centroids along the longest axis; the textbook form.
        MeanCentroid = "mean-centroid",
        /// In the middle of the box, on the axis where count times area is least; another textbook form.
        Midpoint = "midpoint",
    }
);

choice!(
    /// When paths end at random.
    Roulette {
        /// By throughput times eta^2, after the third bounce.
        Throughput = "throughput",
        /// The same, but only paths whose throughput times eta^2 is below [`LATE_ROULETTE_WEIGHT`]: they live
        /// longer, and differ less in what they carry.
        Late = "late",
        /// With a fixed probability of 0.3 at every bounce; the textbook form.
        Fixed = "fixed",
        /// Never: paths end at `max_depth`.
        Off = "off",
    }
);

choice!(
    /// Which rule decides how many samples a pixel gets.
    Adaptive {
        /// The same number everywhere.
        Off = "off",
        /// Batches until 1.96 s / sqrt(n) <= tolerance x mean.
        Textbook = "textbook",
        /// Passes planned from the measured error of a pixel and its neighbours.
        On = "on",
    }
);

/// What roulette brings the throughput of a path that survives to, under [`Roulette::Late`].
pub const LATE_ROULETTE_WEIGHT: f32 = 0.4;
/// Probability with which a path survives each bounce under [`Roulette::Fixed`].
pub const FIXED_ROULETTE_SURVIVAL: f32 = 0.7;

macro_rules! method {
    ($($(#[$doc:meta])* $field:ident : $ty:ty = $default:expr),+ $(,)?) => {
        /// A complete method: every choice made. `Default` gives Tessera's own.
        /// A choice that a record of an older build lacks is the default.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Method { $($(#[$doc])* pub $field: $ty),+ }

        impl Default for Method {
            fn default() -> Self {
                Self { $($field: $default),+ }
            }
        }

        /// The choices that somebody made; the rest is left to whoever is asked next.
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct MethodChoices {
            $($(#[$doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $field: Option<$ty>),+
        }

        impl MethodChoices {
            /// These choices, with those of `fallback` where none was made here.
            #[must_use]
            pub fn or(self, fallback: &MethodChoices) -> MethodChoices {
                MethodChoices { $($field: self.$field.or_else(|| fallback.$field.clone())),+ }
            }

            /// These choices, with the defaults for the rest.
            #[must_use]
            pub fn resolve(self) -> Method {
                let default = Method::default();
                Method { $($field: self.$field.unwrap_or(default.$field)),+ }
            }
        }
    };
}

method! {
    /// Most bounces of a path: 0 is emission seen directly, 1 adds direct light.
    #[schemars(range(max = 10_000))]
    max_depth: u32 = 16,
    /// How direct light is estimated.
    direct: Direct = Direct::Auto,
    /// Which lights a hit samples; `None`: chosen from their number.
    light_pick: Option<LightPick> = None,
    /// Samples a hit takes of each light it samples, 1 to 4096.
    #[schemars(range(min = 1, max = 4096))]
    light_samples: u32 = 1,
    /// In how many ways a path goes on from its first surface that is no mirror or smooth glass: a power of two, 1 to
    /// 64 (splitting: Arvo and Kirk 1990).
    splits: u32 = 1,
    /// Whether neighbouring pixels share the paths that go on from what each of them sees.
    reuse: Reuse = Reuse::Off,
    /// How points on area lights are chosen; `None`: solid angle.
    light_sampling: Option<LightSampling> = None,
    /// Whether directions are aimed at mirrors and smooth glass that send light on: caustics are found by more than chance
    /// (after Jensen 1995 and 1996).
    aim: Aim = Aim::Off,
    /// Render a part of the light transport alone.
    only: Option<Only> = None,
    /// Fresnel reflectance.
    fresnel: Fresnel = Fresnel::Exact,
    /// Source of sample points.
    sampler: Sampler = Sampler::Sobol,
    /// Ray/triangle test.
    triangle: TriangleTest = TriangleTest::Watertight,
    /// How the tree over the surfaces is split.
    bvh: Bvh = Bvh::Sah,
    /// When paths end at random.
    roulette: Roulette = Roulette::Throughput,
    /// Rule for the number of samples; `None`: the quality target decides.
    adaptive: Option<Adaptive> = None,
    /// Textbook rule: samples between two looks at the error, 2 to 65536.
    #[schemars(range(min = 2, max = 65_536))]
    adaptive_batch: u32 = 32,
    /// Textbook rule: half-width of the 95% interval relative to the mean, above 0.
    #[schemars(extend("exclusiveMinimum" = 0))]
    adaptive_tolerance: f64 = 0.05,
}

/// Why a method cannot be used: the field and what it takes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {message}")]
pub struct BadMethod {
    /// The offending field.
    pub field: &'static str,
    /// What was expected.
    pub message: String,
}

impl Method {
    /// Check the ranges of all numbers.
    ///
    /// # Errors
    /// The first field that is out of its range.
    pub fn validate(&self) -> Result<(), BadMethod> {
        let check = |ok: bool, field, message: String| if ok { Ok(()) } else { Err(BadMethod { field, message }) };
        check(self.max_depth <= 10_000, "max_depth", format!("{} is not within 0 to 10000", self.max_depth))?;
        check(
            (1..=4096).contains(&self.light_samples),
            "light_samples",
            format!("{} is not within 1 to 4096", self.light_samples),
        )?;
        check(
            (1..=64).contains(&self.splits) && self.splits.is_power_of_two(),
            "splits",
            format!("{} is not a power of two within 1 to 64", self.splits),
        )?;
        check(
            self.reuse == Reuse::Off || self.aim == Aim::Off,
            "reuse",
            format!("\"{}\" does not go with aim \"{}\"", self.reuse, self.aim),
        )?;
        check(
            (2..=65_536).contains(&self.adaptive_batch),
            "adaptive_batch",
            format!("{} is not within 2 to 65536", self.adaptive_batch),
        )?;
        check(
            self.adaptive_tolerance.is_finite() && self.adaptive_tolerance > 0.0,
            "adaptive_tolerance",
            format!("{} is not a positive number", self.adaptive_tolerance),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_choice_wins_and_defaults_fill_the_rest() {
        let scene = MethodChoices { max_depth: Some(5), fresnel: Some(Fresnel::Schlick), ..Default::default() };
        let job = MethodChoices { max_depth: Some(2), ..Default::default() };
        let method = job.or(&scene).resolve();
        assert_eq!((method.max_depth, method.fresnel), (2, Fresnel::Schlick));
        assert_eq!(method.sampler, Sampler::Sobol);
        assert!(method.validate().is_ok());
    }

    #[test]
    fn names_parse_back_and_others_are_refused_with_the_list() {
        for (name, value) in Direct::ALL {
            assert_eq!(name.parse::<Direct>().unwrap(), *value);
            assert_eq!(serde_json::to_string(value).unwrap(), format!("\"{name}\""));
        }
        let error = "solid".parse::<LightSampling>().unwrap_err();
        assert!(error.contains("solid-angle"), "{error}");
    }

    #[test]
    fn numbers_out_of_range_name_their_field() {
        let bad = Method { light_samples: 0, ..Method::default() };
        assert_eq!(bad.validate().unwrap_err().field, "light_samples");
        for splits in [0, 3, 128] {
            assert_eq!(Method { splits, ..Method::default() }.validate().unwrap_err().field, "splits");
        }
        let bad = Method { reuse: Reuse::Paths, aim: Aim::Delta, ..Method::default() };
        assert_eq!(bad.validate().unwrap_err().to_string(), r#"reuse: "paths" does not go with aim "delta""#);
        let bad = Method { adaptive_tolerance: f64::NAN, ..Method::default() };
        assert_eq!(bad.validate().unwrap_err().field, "adaptive_tolerance");
    }
}
