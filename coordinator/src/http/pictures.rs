//! Routes of a frame's pictures and tiles.

use axum::{
    Json as Answer,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use common::{
    job::{FieldError, JobId},
    protocol::TileList,
};

use super::{
    Shared, etag,
    extract::{Parameters, Parsed},
};
use crate::{
    assemble::Picture,
    error::Failure,
    service::images::{MAX_PIXEL_TILES, Map},
};

/// The tiles of a frame
#[utoipa::path(get, path = "/jobs/{id}/frames/{frame}/tiles", tag = "frames",
    responses((status = 200, description = "The tiles, in index order.", body = ref("#/components/schemas/TileList"))))]
pub(super) async fn tiles(
    State(service): Shared,
    Parsed((id, frame)): Parsed<(JobId, u32)>,
) -> Result<Answer<TileList>, Failure> {
    Ok(Answer(TileList { tiles: service.tile_views(id, frame).await? }))
}

/// A picture of a frame, as far as it is
///
/// The image, the samples of each pixel, or the standard error of each pixel's luminance; PNG (maps with a legend), or
/// OpenEXR with linear 32-bit floats. `image.exr` has all layers. The tag changes with every pass that is merged.
#[utoipa::path(get, path = "/jobs/{id}/frames/{frame}/{picture}", tag = "frames",
    params(("width" = Option<u32>, Query, description = "Of image.png: make it no wider than this, 16 to 1024 pixels.", minimum = 16, maximum = 1024)),
    responses(
        (status = 200, description = "The picture.", content(("image/png"), ("image/x-exr"))),
        (status = 304, description = "The client has it."),
    ))]
pub(super) async fn picture(
    State(service): Shared,
    Parsed((id, frame, name)): Parsed<(JobId, u32, String)>,
    parameters: Parameters,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let Some(picture) = Picture::ALL.into_iter().find(|picture| picture.name() == name) else {
        return Err(Failure::NotFound(format!("picture \"{name}\" of a frame")));
    };
    let parameters = parameters.only(&["width"])?;
    let width: Option<u32> = parameters.get("width")?;
    if let Some(width) = width {
        if picture != Picture::ImagePng {
            return Err(FieldError::new("width", format!("is for image.png, not for {name}")).into());
        }
        if !(16..=1024).contains(&width) {
            return Err(FieldError::new("width", format!("{width} is not within 16 to 1024")).into());
        }
    }
    let tag = service.picture_tag(id, frame, picture)?;
    let tag = width.map_or(tag.clone(), |width| tag.replacen('"', &format!("\"{width}-"), 1));
    let cache = [(header::ETAG, tag.clone()), (header::CACHE_CONTROL, "no-cache".into())];
    if etag::known(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, cache).into_response());
    }
    let bytes = match width {
        None => service.picture(id, frame, picture).await?.into(),
        Some(width) => service.thumbnail(id, frame, width, &tag).await?,
    };
    Ok((cache, [(header::CONTENT_TYPE, picture.media_type())], bytes).into_response())
}

/// Pixels of tiles as numbers
///
/// For a page that draws only what changed. For each tile that has any samples: its index, x, y, width, height and
/// passes as 32-bit integers, then its pixels in row order. `map=image`: red, green and blue as 16-bit floats, linear
/// light; `samples` and `error`: one 32-bit float, the error infinite where it is not known. All little-endian.
#[utoipa::path(get, path = "/jobs/{id}/frames/{frame}/pixels", tag = "frames",
    params(
        ("map" = Option<String>, Query, description = "`image`, `samples` or `error`; `image` where absent."),
        ("tiles" = String, Query, description = "Indices of tiles with commas between, at most 64.", pattern = "^[0-9]{1,6}(,[0-9]{1,6}){0,63}$"),
    ),
    responses((status = 200, description = "The pixels.", content_type = "application/octet-stream")))]
pub(super) async fn pixels(
    State(service): Shared,
    Parsed((id, frame)): Parsed<(JobId, u32)>,
    parameters: Parameters,
) -> Result<Response, Failure> {
    let parameters = parameters.only(&["map", "tiles"])?;
    let map = parameters.get::<Map>("map")?.unwrap_or(Map::Image);
    let list = parameters.get::<String>("tiles")?.ok_or_else(|| FieldError::new("tiles", "is missing"))?;
    let tiles: Option<Vec<u32>> = list.split(',').map(|tile| tile.parse().ok()).collect();
    let tiles = tiles.filter(|tiles| tiles.len() <= MAX_PIXEL_TILES).ok_or_else(|| {
        FieldError::new("tiles", format!("must be at most {MAX_PIXEL_TILES} indices with commas between"))
    })?;
    let bytes = service.pixels(id, frame, map, &tiles).await?;
    Ok(([(header::CONTENT_TYPE, "application/octet-stream"), (header::CACHE_CONTROL, "no-store")], bytes)
        .into_response())
}
