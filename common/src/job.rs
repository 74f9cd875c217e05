//! A job: a scene, frames, a quality target, a priority; and the states it goes through.

use std::{fmt, str::FromStr};

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{
    hash::AssetHash,
    method::MethodChoices,
    scene::{Import, SceneFile},
    tile::Rect,
};

/// Default edge of a tile, pixels.
pub const DEFAULT_TILE: u32 = 64;
/// Relative error asked for when neither the job nor the scene says anything.
pub const DEFAULT_RELATIVE_ERROR: f64 = 0.1;
/// Share of the intervals that hold the truth, where nothing else is asked for.
pub const DEFAULT_CONFIDENCE: f64 = 0.95;
/// Most samples a pixel gets under a noise target that names no maximum.
pub const DEFAULT_MAX_SAMPLES: u32 = 4096;
/// Largest edge of an image, pixels.
pub const MAX_EDGE: u32 = 16_384;
/// Most pixels of a frame: 64 Mi, which is 4 GiB of film.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Most samples of a pixel.
pub const MAX_SAMPLES: u32 = 1 << 24;
/// Most frames of a job.
pub const MAX_FRAMES: usize = 100_000;

macro_rules! id {
    ($(#[$doc:meta])* $name:ident, $prefix:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u64);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!($prefix, "{}"), self.0)
            }
        }

        impl FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                text.strip_prefix($prefix)
                    .filter(|digits| digits.len() <= 19 && digits.bytes().all(|b| b.is_ascii_digit()))
                    .and_then(|digits| digits.parse().ok())
                    .map(Self)
                    .ok_or_else(|| format!(concat!("\"{}\" is not of the form ", $prefix, "NUMBER"), text))
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
            }
        }

        impl JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!({ "type": "string", "pattern": concat!("^", $prefix, "[0-9]{1,19}$") })
            }
        }
    };
}

id!(
    /// Names a job: `j17`.
    JobId,
    "j"
);
id!(
    /// Names a worker, that is one start of a worker process: `w17`.
    WorkerId,
    "w"
);
id!(
    /// Names a lease: `l17`. Not kept across restarts of the coordinator.
    LeaseId,
    "l"
);

/// How exact the picture must be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "target", rename_all = "snake_case", deny_unknown_fields)]
pub enum Quality {
    /// Until the half-width of each pixel's interval is below `relative_error` of its luminance.
    Noise {
        /// Half-width relative to the luminance, above 0.
        #[schemars(extend("exclusiveMinimum" = 0))]
        relative_error: f64,
        /// Share of intervals that must hold the truth, between 0 and 1.
        #[serde(default = "default_confidence")]
        #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
        confidence: f64,
        /// Most samples of a pixel.
        #[serde(default = "default_max_samples")]
        #[schemars(range(min = 1, max = MAX_SAMPLES))]
        max_samples: u32,
    },
    /// This many samples of every pixel.
    Samples {
        /// Samples of a pixel.
        #[schemars(range(min = 1, max = MAX_SAMPLES))]
        samples: u32,
    },
    /// The best picture for this much work.
    Time {
        /// Processor seconds, all workers together, above 0.
        #[schemars(extend("exclusiveMinimum" = 0))]
        cpu_seconds: f64,
        /// Most samples of a pixel.
        #[serde(default = "default_max_samples")]
        #[schemars(range(min = 1, max = MAX_SAMPLES))]
        max_samples: u32,
    },
}

fn default_confidence() -> f64 {
    DEFAULT_CONFIDENCE
}

fn default_max_samples() -> u32 {
    DEFAULT_MAX_SAMPLES
}

impl Default for Quality {
    fn default() -> Self {
        Quality::Noise {
            relative_error: DEFAULT_RELATIVE_ERROR,
            confidence: default_confidence(),
            max_samples: DEFAULT_MAX_SAMPLES,
        }
    }
}

impl Quality {
    /// Check the ranges of all numbers.
    ///
    /// # Errors
    /// The field that is out of range, and what it takes.
    pub fn validate(&self) -> Result<(), FieldError> {
        let samples = |field: &str, n: u32| {
            if (1..=MAX_SAMPLES).contains(&n) {
                Ok(())
            } else {
                Err(FieldError::new(field, format!("{n} samples is not within 1 to {MAX_SAMPLES}")))
            }
        };
        let positive = |field: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(FieldError::new(field, format!("{value} is not a positive number")))
            }
        };
        match *self {
            Quality::Noise { relative_error, confidence, max_samples } => {
                positive("quality.relative_error", relative_error)?;
                if !(confidence > 0.0 && confidence < 1.0) {
                    return Err(FieldError::new("quality.confidence", format!("{confidence} is not between 0 and 1")));
                }
                samples("quality.max_samples", max_samples)
            }
            Quality::Samples { samples: n } => samples("quality.samples", n),
            Quality::Time { cpu_seconds, max_samples } => {
                positive("quality.cpu_seconds", cpu_seconds)?;
                samples("quality.max_samples", max_samples)
            }
        }
    }
}

/// A field of a request or file, and what is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {message}")]
pub struct FieldError {
    /// Path of the field: `quality.samples`, `scene.shapes[3].material`.
    pub field: String,
    /// What was found and what was expected, one clause.
    pub message: String,
}

impl FieldError {
    /// A new error.
    pub fn new(field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { field: field.into(), message: message.into() }
    }
}

/// What a list of frames looks like.
const FRAMES: &str = r"^\s*[0-9]+\s*(-\s*[0-9]+\s*)?(x\s*[0-9]+\s*)?(,\s*[0-9]+\s*(-\s*[0-9]+\s*)?(x\s*[0-9]+\s*)?)*$";

/// Frames of a job, in order, without repeats: `3`, `1-10`, `1-10x2`, `1,5,8-9`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frames(Vec<u32>);

impl Frames {
    /// These frames, in order, each once; `None` of none.
    #[must_use]
    pub fn of(numbers: impl IntoIterator<Item = u32>) -> Option<Self> {
        let frames: std::collections::BTreeSet<u32> = numbers.into_iter().collect();
        (!frames.is_empty()).then(|| Self(frames.into_iter().collect()))
    }

    /// The frame numbers, ascending.
    #[must_use]
    pub fn numbers(&self) -> &[u32] {
        &self.0
    }
}

impl Default for Frames {
    fn default() -> Self {
        Self(vec![1])
    }
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || format!("\"{text}\" is not a list of frames such as 1-10, 1-10x2 or 1,4,7-9");
        let mut frames = std::collections::BTreeSet::new();
        for part in text.split(',') {
            let (range, step) = match part.split_once('x') {
                Some((range, step)) => (range, step.trim().parse().map_err(|_| bad())?),
                None => (part, 1u32),
            };
            let (first, last) = range.split_once('-').unwrap_or((range, range));
            let first: u32 = first.trim().parse().map_err(|_| bad())?;
            let last: u32 = last.trim().parse().map_err(|_| bad())?;
            if step == 0 || last < first {
                return Err(bad());
            }
            if ((last - first) / step) as usize + 1 + frames.len() > MAX_FRAMES {
                return Err(format!("more than {MAX_FRAMES} frames"));
            }
            frames.extend((first..=last).step_by(step as usize));
        }
        Ok(Self(frames.into_iter().collect()))
    }
}

impl fmt::Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = self.0.as_slice();
        let mut separator = "";
        while let Some(&first) = rest.first() {
            let run = rest.iter().zip(first..).take_while(|(frame, expected)| *frame == expected).count();
            match run {
                1 => write!(f, "{separator}{first}")?,
                _ => write!(f, "{separator}{first}-{}", rest[run - 1])?,
            }
            rest = &rest[run..];
            separator = ",";
        }
        Ok(())
    }
}

impl Serialize for Frames {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Frames {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl JsonSchema for Frames {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Frames".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        // That a range runs upwards, a pattern cannot say.
        schemars::json_schema!({ "type": "string", "pattern": FRAMES, "examples": ["1", "1-10", "1-10x2", "1,5,8-9"] })
    }
}

/// The scene of a submitted job.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SceneRef {
    /// A scene file stored as an asset.
    Asset {
        /// Its hash.
        asset: AssetHash,
    },
    /// A file of another format.
    Import(Import),
    /// The scene itself.
    Inline(Box<SceneFile>),
}

impl<'de> Deserialize<'de> for SceneRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Asset {
            asset: AssetHash,
        }
        let map = serde_json::Map::deserialize(deserializer)?;
        if map.contains_key("asset") {
            crate::scene::nested::<Asset, D::Error>(map).map(|Asset { asset }| SceneRef::Asset { asset })
        } else if map.contains_key("import") {
            crate::scene::nested(map).map(SceneRef::Import)
        } else {
            crate::scene::nested(map).map(|scene| SceneRef::Inline(Box::new(scene)))
        }
    }
}

impl JsonSchema for SceneRef {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "SceneRef".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let scene = generator.subschema_for::<SceneFile>();
        let hash = generator.subschema_for::<AssetHash>();
        let import = generator.subschema_for::<Import>();
        schemars::json_schema!({ "anyOf": [
            { "type": "object", "properties": { "asset": hash }, "required": ["asset"], "additionalProperties": false },
            import,
            scene,
        ]})
    }
}

/// What `POST /jobs` takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JobRequest {
    /// What people call it; the scene's name where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The scene: `{"asset": hash}`, the scene itself, or a file that is to become one:
    /// `{"import": "bunny.obj", "assets": {"bunny.obj": hash, ...}}`.
    pub scene: SceneRef,
    /// Frames; the scene's own where absent, else frame 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<Frames>,
    /// Width and height in pixels; the scene's film where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "edges")]
    pub resolution: Option<[u32; 2]>,
    /// How exact the picture must be; what the scene asks where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    /// Choices of method; what the scene asks, then the defaults, where absent.
    #[serde(default)]
    pub method: MethodChoices,
    /// Edge of a tile, pixels, 8 to 1024.
    #[serde(default = "default_tile")]
    #[schemars(range(min = 8, max = 1024))]
    pub tile: u32,
    /// Part of the frame to render: `[x, y, width, height]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<[u32; 4]>,
    /// 0 (last) to 100 (first).
    #[serde(default = "default_priority")]
    #[schemars(range(max = 100))]
    pub priority: u8,
    /// Free words to find it by.
    #[serde(default)]
    pub tags: Vec<String>,
    /// Seed of the sample points; another seed gives an independent picture.
    #[serde(default)]
    pub seed: u64,
}

/// Width and height; that their product is at most [`MAX_PIXELS`], a schema cannot say.
fn edges(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({
        "type": ["array", "null"],
        "items": { "type": "integer", "minimum": 1, "maximum": MAX_EDGE },
        "minItems": 2,
        "maxItems": 2,
    })
}

fn default_tile() -> u32 {
    DEFAULT_TILE
}

fn default_priority() -> u8 {
    50
}

impl JobRequest {
    /// A request for `scene` with nothing else chosen.
    #[must_use]
    pub fn new(scene: SceneRef) -> Self {
        Self {
            name: None,
            scene,
            frames: None,
            resolution: None,
            quality: None,
            method: MethodChoices::default(),
            tile: DEFAULT_TILE,
            crop: None,
            priority: default_priority(),
            tags: Vec::new(),
            seed: 0,
        }
    }

    /// Check every range that does not need the scene.
    ///
    /// # Errors
    /// The first field that is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        if let Some(quality) = &self.quality {
            quality.validate()?;
        }
        self.method
            .clone()
            .resolve()
            .validate()
            .map_err(|e| FieldError::new(format!("method.{}", e.field), e.message))?;
        if let Some([w, h]) = self.resolution {
            check_resolution("resolution", w, h)?;
        }
        if !(8..=1024).contains(&self.tile) {
            return Err(FieldError::new("tile", format!("{} pixels is not within 8 to 1024", self.tile)));
        }
        if self.priority > 100 {
            return Err(FieldError::new("priority", format!("{} is not within 0 to 100", self.priority)));
        }
        Ok(())
    }

    /// The region to render of a frame of `resolution`: the crop, or all of it.
    ///
    /// # Errors
    /// The crop is empty or reaches outside the frame.
    pub fn region(&self, resolution: [u32; 2]) -> Result<Rect, FieldError> {
        let frame = Rect::frame(resolution[0], resolution[1]);
        let Some([x, y, w, h]) = self.crop else { return Ok(frame) };
        let crop = Rect { x, y, w, h };
        if w == 0 || h == 0 || !frame.contains(&crop) {
            let [fw, fh] = resolution;
            return Err(FieldError::new("crop", format!("{crop} is not inside the {fw}x{fh} frame")));
        }
        Ok(crop)
    }
}

/// Check an image size.
///
/// # Errors
/// It is empty or larger than the farm takes; `field` is named.
pub fn check_resolution(field: &str, w: u32, h: u32) -> Result<(), FieldError> {
    if w == 0 || h == 0 || w > MAX_EDGE || h > MAX_EDGE || u64::from(w) * u64::from(h) > MAX_PIXELS {
        let message = format!("{w}x{h} is not within 1x1 to {MAX_EDGE}x{MAX_EDGE} and {MAX_PIXELS} pixels");
        return Err(FieldError::new(field, message));
    }
    Ok(())
}

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Accepted; no worker has begun.
    Queued,
    /// Units are being rendered.
    Active,
    /// Held back; keeps what it has.
    Paused,
    /// Every frame is done.
    Completed,
    /// A frame could not be rendered.
    Failed,
    /// Given up by a person.
    Canceled,
}

impl JobState {
    /// Its name in the API.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            JobState::Queued => "queued",
            JobState::Active => "active",
            JobState::Paused => "paused",
            JobState::Completed => "completed",
            JobState::Failed => "failed",
            JobState::Canceled => "canceled",
        }
    }

    /// Whether nothing more will happen by itself.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, JobState::Completed | JobState::Failed | JobState::Canceled)
    }
}

impl FromStr for JobState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        use JobState::*;
        let all = [Queued, Active, Paused, Completed, Failed, Canceled];
        all.into_iter()
            .find(|state| state.name() == text)
            .ok_or_else(|| format!("\"{text}\" is not one of {}", all.map(JobState::name).join(", ")))
    }
}

impl fmt::Display for JobState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_parse_print_and_refuse() {
        for (text, expected, printed) in [
            ("3", vec![3], "3"),
            ("1-4", vec![1, 2, 3, 4], "1-4"),
            ("1-10x3", vec![1, 4, 7, 10], "1,4,7,10"),
            ("8-9,1,5,9", vec![1, 5, 8, 9], "1,5,8-9"),
        ] {
            let frames: Frames = text.parse().unwrap();
            assert_eq!(frames.numbers(), expected);
            assert_eq!(frames.to_string(), printed);
        }
        for bad in ["", "a", "4-1", "1-", "1-5x0", "0-4294967295"] {
            assert!(bad.parse::<Frames>().is_err(), "{bad}");
        }
    }

    #[test]
    fn ids_have_one_spelling() {
        assert_eq!(JobId(7).to_string().parse::<JobId>(), Ok(JobId(7)));
        for bad in ["7", "w7", "j", "j+7", "j-1", "jx"] {
            assert!(bad.parse::<JobId>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_crop_outside_the_frame_is_refused() {
        let mut request = JobRequest::new(SceneRef::Asset { asset: AssetHash::of(b"") });
        assert_eq!(request.region([8, 4]), Ok(Rect::frame(8, 4)));
        for crop in [[0, 0, 0, 1], [7, 0, 2, 1], [u32::MAX, 0, 1, 1]] {
            request.crop = Some(crop);
            assert_eq!(request.region([8, 4]).unwrap_err().field, "crop");
        }
        request.crop = Some([6, 2, 2, 2]);
        assert_eq!(request.region([8, 4]), Ok(Rect { x: 6, y: 2, w: 2, h: 2 }));
    }

    #[test]
    fn a_huge_resolution_is_refused_by_name() {
        assert_eq!(check_resolution("film", 1_000_000, 1).unwrap_err().field, "film");
        assert!(check_resolution("film", 16_384, 16_384).is_err());
        assert!(check_resolution("film", 8192, 8192).is_ok());
    }

    #[test]
    fn quality_is_as_the_contract_writes_it() {
        let parse = |text| serde_json::from_str::<Quality>(text);
        assert_eq!(parse(r#"{"target":"samples","samples":256}"#).unwrap(), Quality::Samples { samples: 256 });
        assert_eq!(
            parse(r#"{"target":"noise","relative_error":0.05}"#).unwrap(),
            Quality::Noise { relative_error: 0.05, confidence: 0.95, max_samples: 4096 }
        );
        assert!(parse(r#"{"target":"samples","samples":256,"colour":1}"#).is_err());
        assert!(parse(r#"{"target":"time","cpu_seconds":-1}"#).unwrap().validate().is_err());
    }
}
