//! Reading a scene file so that every error names its place.
//!
//! Serde's own tagged enums lose the path below the tag; [`nested`] reads the part behind a tag with a
//! path of its own, and [`SceneFile::parse`] joins the two.

use serde::{
    Deserialize, Deserializer,
    de::{DeserializeOwned, Error as _},
};
use serde_json::{Map, Value};

use super::{Rgb, SceneFile};
use crate::job::FieldError;

/// Why a scene cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// The text is not JSON.
    #[error("not valid JSON: {0}")]
    Syntax(String),
    /// A field is missing, unknown, of the wrong type or out of range.
    #[error(transparent)]
    Field(#[from] FieldError),
}

/// Marks a path inside an error message on its way up through serde.
const MARK: char = '\u{1}';

/// Read `T` from the members of an object, keeping the path inside it for the error.
///
/// # Errors
/// What `T` refuses.
pub fn nested<T: DeserializeOwned, E: serde::de::Error>(map: Map<String, Value>) -> Result<T, E> {
    serde_path_to_error::deserialize(Value::Object(map)).map_err(|error| {
        let (path, message) = place(&error);
        E::custom(format!("{MARK}{path}{MARK}{message}"))
    })
}

/// Take the member `type` out of an object.
pub(super) fn take_type<E: serde::de::Error>(map: &mut Map<String, Value>) -> Result<String, E> {
    match map.remove("type") {
        Some(Value::String(text)) => Ok(text),
        Some(other) => {
            Err(E::custom(format!("{MARK}type{MARK}expected the name of a type as a string, found {}", kind(&other))))
        }
        None => Err(E::custom("missing field `type`")),
    }
}

/// The error for a `type` that does not exist.
pub(super) fn unknown_type<E: serde::de::Error>(found: &str, known: &[&str]) -> E {
    let hint = nearest(found, known.iter().copied()).map_or(String::new(), |n| format!("; did you mean \"{n}\"?"));
    E::custom(format!("{MARK}type{MARK}unknown type \"{found}\", expected one of {}{hint}", known.join(", ")))
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}

/// The known name nearest to a misspelt one, if any is near.
pub(super) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    known
        .map(|candidate| (edits(name, candidate), candidate))
        .filter(|(distance, candidate)| *distance <= candidate.len().max(3) / 3)
        .min()
        .map(|(_, candidate)| candidate)
}

/// Levenshtein's distance.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let cost = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = cost.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// Path and message of an error, with marked inner paths joined to the outer one.
fn place(error: &serde_path_to_error::Error<serde_json::Error>) -> (String, String) {
    let mut path = error.path().to_string();
    let mut message = error.inner().to_string();
    if path == "." {
        path.clear();
    }
    if let Some((before, rest)) = message.split_once(MARK)
        && let Some((inner, after)) = rest.split_once(MARK)
    {
        let separator = if path.is_empty() || inner.is_empty() || inner.starts_with('[') { "" } else { "." };
        path = format!("{path}{separator}{inner}");
        message = format!("{before}{after}");
    }
    // serde_json ends its messages with a place in the text, which is of no use after buffering: always 0.
    if let Some(cut) = message.find(" at line 0 column 0") {
        message.truncate(cut);
    }
    (path, message)
}

/// Read a JSON document as `T`; the error names the path of the offending field.
///
/// # Errors
/// Text that is not JSON, or a field that `T` refuses.
pub fn from_json<T: DeserializeOwned>(text: &[u8]) -> Result<T, SceneError> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let value: T = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        if error.inner().is_data() {
            let (path, message) = place(&error);
            SceneError::Field(FieldError::new(if path.is_empty() { "(top level)".into() } else { path }, message))
        } else {
            SceneError::Syntax(error.inner().to_string())
        }
    })?;
    deserializer.end().map_err(|error| SceneError::Syntax(error.to_string()))?;
    Ok(value)
}

impl SceneFile {
    /// Read and check a scene file: fields, ranges, and that everything named exists.
    ///
    /// # Errors
    /// The first thing that is wrong, by its path in the file.
    pub fn parse(text: &[u8]) -> Result<SceneFile, SceneError> {
        let scene: SceneFile = from_json(text)?;
        scene.check()?;
        Ok(scene)
    }
}

/// A colour as `[r, g, b]` or one number.
pub(super) fn rgb<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Rgb, D::Error> {
    let expected = || D::Error::custom("expected a colour: [r, g, b] in linear light, or one number for a grey");
    match Value::deserialize(deserializer)? {
        Value::Number(grey) => grey.as_f64().map(Rgb::grey).ok_or_else(expected),
        Value::Array(items) => {
            let values: Option<Vec<f64>> = items.iter().map(Value::as_f64).collect();
            values.and_then(|v| <[f64; 3]>::try_from(v).ok()).map(Rgb).ok_or_else(expected)
        }
        _ => Err(expected()),
    }
}

/// An enum whose variants each hold a struct of the same name, told apart in JSON by `type`.
macro_rules! tagged {
    ($(#[$doc:meta])* $name:ident { $($(#[$vdoc:meta])* $variant:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
        #[serde(tag = "type")]
        pub enum $name { $($(#[$vdoc])* #[serde(rename = $text)] $variant($variant)),+ }

        impl $name {
            /// Names of all types.
            pub const TYPES: &[&str] = &[$($text),+];

            /// Its type's name in a scene file.
            #[must_use]
            pub fn type_name(&self) -> &'static str {
                match self { $($name::$variant(_) => $text),+ }
            }

            pub(super) fn from_map<E: serde::de::Error>(
                mut map: serde_json::Map<String, serde_json::Value>,
            ) -> Result<Self, E> {
                let name = super::parse::take_type::<E>(&mut map)?;
                match name.as_str() {
                    $($text => super::parse::nested(map).map($name::$variant),)+
                    other => Err(super::parse::unknown_type(other, Self::TYPES)),
                }
            }
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                Self::from_map(serde_json::Map::deserialize(deserializer)?)
            }
        }
    };
}
pub(super) use tagged;
