//! Routes of files, named by the hash of their bytes. HEAD is GET without the bytes.

use axum::{
    Json as Answer,
    body::Body,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use common::{hash::AssetHash, protocol::Stored};

use super::{Shared, etag, extract::Parsed};
use crate::error::Failure;

/// A file
///
/// HEAD says whether it is stored.
#[utoipa::path(get, path = "/assets/{hash}", tag = "assets", responses(
    (status = 200, description = "Its bytes.", content_type = "application/octet-stream"),
    (status = 304, description = "The client has it."),
))]
pub(super) async fn get(
    State(service): Shared,
    Parsed((hash,)): Parsed<(AssetHash,)>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let tag = format!("\"{hash}\"");
    if etag::known(&headers, &tag) && service.blobs.size(hash).await?.is_some() {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response());
    }
    let (size, bytes) = service.blobs.stream(hash).await?.ok_or_else(|| Failure::NotFound(format!("asset {hash}")))?;
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, size.to_string()),
        (header::CACHE_CONTROL, "public, max-age=31536000, immutable".to_owned()),
        (header::ETAG, tag),
    ];
    Ok((headers, Body::from_stream(bytes)).into_response())
}

/// Store a file under its hash
#[utoipa::path(put, path = "/assets/{hash}", tag = "assets",
    request_body(content = Vec<u8>, content_type = "application/octet-stream", description = "Its bytes."),
    responses(
        (status = 200, description = "It was stored before."),
        (status = 201, description = "It is stored."),
        (status = 413, description = "It is larger than allowed.", body = ref("#/components/schemas/ErrorBody")),
        (status = 422, description = "The bytes have another hash.", body = ref("#/components/schemas/ErrorBody")),
    ))]
pub(super) async fn put(
    State(service): Shared,
    Parsed((hash,)): Parsed<(AssetHash,)>,
    body: Body,
) -> Result<StatusCode, Failure> {
    let new = service.blobs.put(hash, body.into_data_stream(), service.config.max_asset).await?;
    Ok(if new { StatusCode::CREATED } else { StatusCode::OK })
}

/// Store a file whose hash is not known
///
/// For clients that cannot compute BLAKE3, such as a page. The answer names the file.
#[utoipa::path(post, path = "/assets", tag = "assets",
    request_body(content = Vec<u8>, content_type = "application/octet-stream", description = "Its bytes."),
    responses(
        (status = 201, description = "It is stored.", body = ref("#/components/schemas/Stored")),
        (status = 413, description = "It is larger than allowed.", body = ref("#/components/schemas/ErrorBody")),
    ))]
pub(super) async fn post(State(service): Shared, body: Body) -> Result<(StatusCode, Answer<Stored>), Failure> {
    let (hash, size) = service.blobs.keep(body.into_data_stream(), service.config.max_asset).await?;
    Ok((StatusCode::CREATED, Answer(Stored { hash, size })))
}
