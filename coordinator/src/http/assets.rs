//! Routes of files, named by the hash of their bytes. HEAD is GET without the bytes.

use axum::{
    body::Body,
    extract::State,
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use common::hash::AssetHash;

use super::{Shared, extract::Parsed};
use crate::error::Failure;

pub(super) async fn get(State(service): Shared, Parsed((hash,)): Parsed<(AssetHash,)>) -> Result<Response, Failure> {
    let (size, bytes) = service.blobs.stream(hash).await?.ok_or_else(|| Failure::NotFound(format!("asset {hash}")))?;
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, size.to_string()),
        (header::CACHE_CONTROL, "public, max-age=31536000, immutable".to_owned()),
    ];
    Ok((headers, Body::from_stream(bytes)).into_response())
}

pub(super) async fn put(
    State(service): Shared,
    Parsed((hash,)): Parsed<(AssetHash,)>,
    body: Body,
) -> Result<StatusCode, Failure> {
    let new = service.blobs.put(hash, body.into_data_stream(), service.config.max_asset).await?;
    Ok(if new { StatusCode::CREATED } else { StatusCode::OK })
}
