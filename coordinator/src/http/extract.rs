//! Reading requests so that every error is ours and names its field.

use std::collections::BTreeMap;

use axum::{
    body::Bytes,
    extract::{FromRequest, FromRequestParts, Path, Query, Request, rejection::BytesRejection},
    http::{StatusCode, request::Parts},
};
use common::{job::FieldError, scene::from_json};
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::Failure;

/// A whole body, within the limit.
pub(super) struct Body(pub(super) Bytes);

impl<S: Send + Sync> FromRequest<S> for Body {
    type Rejection = Failure;

    async fn from_request(request: Request, state: &S) -> Result<Self, Failure> {
        Bytes::from_request(request, state).await.map(Body).map_err(|rejection: BytesRejection| {
            if rejection.status() == StatusCode::PAYLOAD_TOO_LARGE {
                Failure::TooLarge("the body is larger than this route takes".into())
            } else {
                Failure::Malformed(rejection.body_text())
            }
        })
    }
}

/// A JSON body, whatever the content type says; unknown fields are refused and errors name their path.
pub(super) struct Json<T>(pub(super) T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for Json<T> {
    type Rejection = Failure;

    async fn from_request(request: Request, state: &S) -> Result<Self, Failure> {
        let Body(bytes) = Body::from_request(request, state).await?;
        // serde would take the fields of an object in the order of a list, too.
        if bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'[') {
            return Err(Failure::Malformed("the body is a list; an object is expected".into()));
        }
        from_json(&bytes).or_else(|error| with_whole_numbers(&bytes).ok_or(error)).map(Json).map_err(Failure::from)
    }
}

/// The same with 64.0 read as 64, which JSON does not tell apart and serde does.
fn with_whole_numbers<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    /// Up to here every whole number is one in double precision.
    const EXACT: f64 = (1u64 << 53) as f64;
    fn settle(value: &mut Value) {
        match value {
            Value::Number(number) if number.is_f64() => {
                if let Some(whole) = number.as_f64().filter(|v| v.fract() == 0.0 && v.abs() <= EXACT) {
                    *value = Value::from(whole as i64);
                }
            }
            Value::Array(items) => items.iter_mut().for_each(settle),
            Value::Object(map) => map.values_mut().for_each(settle),
            _ => {}
        }
    }
    let mut value: Value = serde_json::from_slice(bytes).ok()?;
    settle(&mut value);
    from_json(value.to_string().as_bytes()).ok()
}

/// The parts of a path, each read by `FromStr`; what cannot be read does not exist.
pub(super) struct Parsed<T>(pub(super) T);

async fn segments<S: Send + Sync>(parts: &mut Parts, state: &S) -> Result<Vec<String>, Failure> {
    let Path(found) = Path::<Vec<(String, String)>>::from_request_parts(parts, state)
        .await
        .map_err(|rejection| Failure::Malformed(rejection.body_text()))?;
    Ok(found.into_iter().map(|(_, text)| text).collect())
}

fn read<T: std::str::FromStr>(segments: &[String], index: usize) -> Result<T, Failure>
where
    T::Err: std::fmt::Display,
{
    let text = segments.get(index).map_or("", String::as_str);
    text.parse().map_err(|error| Failure::NotFound(format!("such thing: {error}")))
}

macro_rules! parsed {
    ($($name:ident $index:literal),+) => {
        impl<S: Send + Sync, $($name: std::str::FromStr),+> FromRequestParts<S> for Parsed<($($name,)+)>
        where
            $($name::Err: std::fmt::Display),+
        {
            type Rejection = Failure;

            async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Failure> {
                let segments = segments(parts, state).await?;
                Ok(Parsed(($(read::<$name>(&segments, $index)?,)+)))
            }
        }
    };
}

parsed!(A 0);
parsed!(A 0, B 1);
parsed!(A 0, B 1, C 2);

/// The parameters of a query; those that a route does not know are refused.
pub(super) struct Parameters(BTreeMap<String, String>);

impl<S: Send + Sync> FromRequestParts<S> for Parameters {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Failure> {
        let Query(found) = Query::<BTreeMap<String, String>>::from_request_parts(parts, state)
            .await
            .map_err(|rejection| Failure::Malformed(rejection.body_text()))?;
        Ok(Parameters(found))
    }
}

impl Parameters {
    /// Refuse parameters that are not in the list.
    pub(super) fn only(self, known: &[&str]) -> Result<Self, Failure> {
        match self.0.keys().find(|name| !known.contains(&name.as_str())) {
            Some(name) => {
                Err(FieldError::new(name, format!("unknown parameter, expected {}", known.join(", "))).into())
            }
            None => Ok(self),
        }
    }

    /// A parameter; an empty one counts as absent.
    pub(super) fn get<T: std::str::FromStr>(&self, name: &str) -> Result<Option<T>, Failure>
    where
        T::Err: std::fmt::Display,
    {
        let Some(text) = self.0.get(name).filter(|text| !text.is_empty()) else { return Ok(None) };
        text.parse().map(Some).map_err(|error| FieldError::new(name, format!("{error}")).into())
    }
}
