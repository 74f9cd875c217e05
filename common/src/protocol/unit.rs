//! The name of a unit, the one thing that is computed once.

use std::{fmt, str::FromStr};

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{job::JobId, tile::Rect};

/// Names a unit: job, frame, tile, pass, and the rectangle (the tile's, or a part of it). Written
/// `j3.f1.t12.p0.x64.y0.w64.h32`, so that a result can be placed even by a coordinator that was restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UnitId {
    /// Job.
    pub job: JobId,
    /// Frame number.
    pub frame: u32,
    /// Tile index in the frame.
    pub tile: u32,
    /// Pass of the tile.
    pub pass: u32,
    /// The pixels.
    pub rect: Rect,
}

/// What the name of a unit looks like.
const PATTERN: &str = "^j[0-9]{1,19}\\.f[0-9]{1,10}\\.t[0-9]{1,10}\\.p[0-9]{1,10}\\.x[0-9]{1,5}\\.y[0-9]{1,5}\\.w[0-9]{1,5}\\.h[0-9]{1,5}$";

impl fmt::Display for UnitId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let UnitId { job, frame, tile, pass, rect: Rect { x, y, w, h } } = self;
        write!(f, "{job}.f{frame}.t{tile}.p{pass}.x{x}.y{y}.w{w}.h{h}")
    }
}

impl FromStr for UnitId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || format!("\"{text}\" is not a unit such as j3.f1.t12.p0.x64.y0.w64.h32");
        let mut parts = text.split('.');
        let job = parts.next().and_then(|part| part.parse().ok()).ok_or_else(bad)?;
        let mut number = |prefix: &str| -> Result<u32, String> {
            let digits = parts.next().and_then(|part| part.strip_prefix(prefix)).ok_or_else(bad)?;
            if digits.bytes().all(|b| b.is_ascii_digit()) { digits.parse().map_err(|_| bad()) } else { Err(bad()) }
        };
        let (frame, tile, pass) = (number("f")?, number("t")?, number("p")?);
        let rect = Rect { x: number("x")?, y: number("y")?, w: number("w")?, h: number("h")? };
        if parts.next().is_some() { Err(bad()) } else { Ok(UnitId { job, frame, tile, pass, rect }) }
    }
}

impl Serialize for UnitId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for UnitId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl JsonSchema for UnitId {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "UnitId".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "pattern": PATTERN, "examples": ["j3.f1.t12.p0.x64.y0.w64.h32"] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_has_one_spelling() {
        let id = UnitId { job: JobId(3), frame: 1, tile: 12, pass: 0, rect: Rect { x: 64, y: 0, w: 64, h: 32 } };
        assert_eq!(id.to_string(), "j3.f1.t12.p0.x64.y0.w64.h32");
        assert_eq!(id.to_string().parse(), Ok(id));
        for bad in
            ["", "j3", "j3.f1.t12.p0.x64.y0.w64.h32.z1", "j3.f1.t12.p0.x64.y0.w64.h-2", "j3.f+1.t12.p0.x6.y0.w6.h2"]
        {
            assert!(bad.parse::<UnitId>().is_err(), "{bad}");
        }
    }
}
