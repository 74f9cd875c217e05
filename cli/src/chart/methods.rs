//! The methods of a chart: values of the method options, joined by `+`.

use common::method::{
    Adaptive, Bvh, Direct, Fresnel, LightPick, LightSampling, MethodChoices, Only, Roulette, Sampler, TriangleTest,
};
use serde_json::{Map, Value};

/// What efficiencies are relative to: points spread evenly over all lights, independent numbers, paths that end with
/// a fixed chance; how a path tracer is first taught.
pub const TEXTBOOK: &str = "light+all+area+independent+fixed";

/// A method by the words that name it.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// As it was written.
    pub name: String,
    /// The choices that the words make.
    pub choices: MethodChoices,
}

impl Named {
    /// The method that `words` name.
    ///
    /// # Errors
    /// A word that is no value of any option, an option chosen twice, or a number that is out of range.
    pub fn parse(words: &str) -> Result<Self, String> {
        let mut chosen = Map::new();
        for word in words.split('+').map(str::trim) {
            let (field, value) = match word.split_once('=') {
                Some((option, value)) => (option.replace('-', "_"), spelled(value)),
                None => (bare(word, &chosen)?.into(), Value::from(word)),
            };
            if chosen.contains_key(&field) {
                return Err(format!("{words}: --{} is chosen twice", field.replace('_', "-")));
            }
            // Each by itself, so that an error names its word.
            let alone = Map::from_iter([(field.clone(), value.clone())]);
            serde_json::from_value::<MethodChoices>(alone.into())
                .map_err(|error| error.to_string())
                .and_then(|choices| choices.resolve().validate().map_err(|error| error.message))
                .map_err(|error| format!("{words}: {word}: {error}"))?;
            chosen.insert(field, value);
        }
        let choices = serde_json::from_value(chosen.into()).map_err(|error| format!("{words}: {error}"))?;
        Ok(Self { name: words.into(), choices })
    }
}

/// A number where it reads as one.
fn spelled(value: &str) -> Value {
    let number = value.parse::<u64>().map(Value::from).or_else(|_| value.parse::<f64>().map(Value::from));
    number.unwrap_or_else(|_| value.into())
}

/// The field that a bare word is a value of. Where two options share a value, it is the first's that is not chosen
/// yet: `stratified` is how points on lights are chosen, after `area` it is the source of sample points.
fn bare(word: &str, chosen: &Map<String, Value>) -> Result<&'static str, String> {
    fn names<T>(all: &[(&'static str, T)]) -> Vec<&'static str> {
        all.iter().map(|(name, _)| *name).collect()
    }
    let options = [
        ("direct", names(Direct::ALL)),
        ("light_pick", names(LightPick::ALL)),
        ("light_sampling", names(LightSampling::ALL)),
        ("only", names(Only::ALL)),
        ("fresnel", names(Fresnel::ALL)),
        ("sampler", names(Sampler::ALL)),
        ("roulette", names(Roulette::ALL)),
        ("triangle", names(TriangleTest::ALL)),
        ("bvh", names(Bvh::ALL)),
        ("adaptive", names(Adaptive::ALL)),
    ];
    let mut having = options.iter().filter(|(_, values)| values.contains(&word)).map(|(field, _)| *field);
    let first = having.clone().next();
    having.find(|field| !chosen.contains_key(*field)).or(first).ok_or_else(|| {
        let mut all: Vec<&str> = options.iter().flat_map(|(_, values)| values.iter().copied()).collect();
        let mut seen = std::collections::BTreeSet::new();
        all.retain(|value| seen.insert(*value));
        format!("\"{word}\" is not a method; expected values such as {}, joined by +, or option=value", all.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_of_every_option_is_a_word() {
        let is = |words: &str, choices: MethodChoices| assert_eq!(Named::parse(words).unwrap().choices, choices);
        let none = MethodChoices::default;
        for (name, direct) in Direct::ALL {
            is(name, MethodChoices { direct: Some(*direct), ..none() });
        }
        for (name, pick) in LightPick::ALL {
            is(name, MethodChoices { light_pick: Some(Some(*pick)), ..none() });
        }
        for (name, sampling) in LightSampling::ALL {
            is(name, MethodChoices { light_sampling: Some(Some(*sampling)), ..none() });
        }
        for (name, only) in Only::ALL {
            is(name, MethodChoices { only: Some(Some(*only)), ..none() });
        }
        for (name, fresnel) in Fresnel::ALL {
            is(name, MethodChoices { fresnel: Some(*fresnel), ..none() });
        }
        for (name, sampler) in Sampler::ALL {
            is(&format!("sampler={name}"), MethodChoices { sampler: Some(*sampler), ..none() });
        }
        for (name, roulette) in Roulette::ALL {
            is(name, MethodChoices { roulette: Some(*roulette), ..none() });
        }
        for (name, triangle) in TriangleTest::ALL {
            is(name, MethodChoices { triangle: Some(*triangle), ..none() });
        }
        for (name, bvh) in Bvh::ALL {
            is(name, MethodChoices { bvh: Some(*bvh), ..none() });
        }
        for (name, adaptive) in Adaptive::ALL {
            is(&format!("adaptive={name}"), MethodChoices { adaptive: Some(Some(*adaptive)), ..none() });
        }
        is(
            "light+area+stratified+light-samples=4+adaptive-tolerance=0.1",
            MethodChoices {
                direct: Some(Direct::Light),
                light_sampling: Some(Some(LightSampling::Area)),
                sampler: Some(Sampler::Stratified),
                light_samples: Some(4),
                adaptive_tolerance: Some(0.1),
                ..none()
            },
        );
        assert!(Named::parse(TEXTBOOK).is_ok());
    }

    /// Values of the method options as the architecture's text has them.
    #[test]
    fn the_values_that_are_promised_are_taken() {
        for words in [
            "auto",
            "hemisphere",
            "light",
            "mis",
            "light+all",
            "light+one+area",
            "light+power+stratified",
            "mis+tree+solid-angle",
            "light-samples=4",
            "max-depth=0",
            "direct",
            "indirect",
            "exact",
            "schlick",
            "sobol",
            "sampler=stratified",
            "independent",
            "adaptive=off",
            "textbook",
            "on",
            "textbook+adaptive-batch=16+adaptive-tolerance=0.1",
        ] {
            assert!(Named::parse(words).is_ok(), "{words}: {:?}", Named::parse(words));
        }
    }

    #[test]
    fn a_word_that_is_none_is_named() {
        for (words, expected) in [
            ("fastest", "\"fastest\" is not a method; expected values such as auto, bsdf, hemisphere"),
            ("light+", "\"\" is not a method"),
            ("light+mis", "light+mis: --direct is chosen twice"),
            ("light-samples=0", "light-samples=0: light-samples=0: 0 is not within 1 to 4096"),
            ("light-samples=many", "light-samples=many: invalid type"),
            ("sampler=halton", "sampler=halton: unknown variant `halton`"),
            ("samplers=sobol", "samplers=sobol: unknown field `samplers`"),
        ] {
            let error = Named::parse(words).unwrap_err();
            assert!(error.contains(expected), "{words}: {error}");
        }
    }
}
