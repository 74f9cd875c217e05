//! Routes of the farm as a whole.

use axum::{
    Json as Answer,
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};
use common::protocol::{FarmView, ShippedScenes};

use super::{Shared, extract::Parsed};
use crate::error::Failure;

/// The farm as a whole
///
/// Queue, jobs and workers now, and how the queue, the throughput and the busy share were over the last hour.
#[utoipa::path(get, path = "/farm", tag = "farm",
    responses((status = 200, description = "The farm.", body = ref("#/components/schemas/FarmView"))))]
pub(super) async fn view(State(service): Shared) -> Answer<FarmView> {
    Answer(service.farm_view())
}

/// A chart of the farm over the last hour, as SVG
#[utoipa::path(get, path = "/farm/{chart}", tag = "farm",
    responses((status = 200, description = "The chart.", content_type = "image/svg+xml")))]
pub(super) async fn chart(State(service): Shared, Parsed((name,)): Parsed<(String,)>) -> Result<Response, Failure> {
    let Some(chart) = name.strip_suffix(".svg") else {
        return Err(Failure::NotFound(format!("chart \"{name}\" of the farm")));
    };
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], service.farm_chart(chart)?).into_response())
}

/// The scenes that come with the coordinator
///
/// They and their files are stored: `POST /jobs` takes `{"scene": {"asset": hash}}`.
#[utoipa::path(get, path = "/scenes", tag = "farm",
    responses((status = 200, description = "The scenes.", body = ref("#/components/schemas/ShippedScenes"))))]
pub(super) async fn scenes(State(service): Shared) -> Result<Answer<ShippedScenes>, Failure> {
    service.shipped().await.map(Answer)
}
