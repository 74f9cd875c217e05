//! Routes of jobs and their pictures.

use axum::{
    Json as Answer,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use common::{
    job::{FieldError, JobId, JobRequest, JobState},
    protocol::{API, JobList, JobPatch, JobView, TileList},
};

use super::{
    Shared,
    extract::{Json, Parameters, Parsed},
};
use crate::{assemble::Picture, error::Failure, farm::Command};

pub(super) async fn submit(State(service): Shared, Json(request): Json<JobRequest>) -> Result<Response, Failure> {
    let view = service.submit(request).await?;
    let place = format!("{API}/jobs/{}", view.id);
    Ok((StatusCode::CREATED, [(header::LOCATION, place)], Answer(view)).into_response())
}

pub(super) async fn list(State(service): Shared, parameters: Parameters) -> Result<Answer<JobList>, Failure> {
    let parameters = parameters.only(&["status", "limit", "cursor"])?;
    let state: Option<JobState> = parameters.get("status")?;
    let before: Option<JobId> = parameters.get("cursor")?;
    let limit: usize = parameters.get("limit")?.unwrap_or(50);
    if !(1..=500).contains(&limit) {
        return Err(FieldError::new("limit", format!("{limit} is not within 1 to 500")).into());
    }
    let (jobs, next) = service.list_jobs(state, before, limit);
    Ok(Answer(JobList { jobs, next: next.map(|id| id.to_string()) }))
}

pub(super) async fn view(State(service): Shared, Parsed((id,)): Parsed<(JobId,)>) -> Result<Answer<JobView>, Failure> {
    service.job_view(id).map(Answer)
}

pub(super) async fn patch(
    State(service): Shared,
    Parsed((id,)): Parsed<(JobId,)>,
    Json(patch): Json<JobPatch>,
) -> Result<Answer<JobView>, Failure> {
    service.patch(id, patch).await.map(Answer)
}

pub(super) async fn delete(State(service): Shared, Parsed((id,)): Parsed<(JobId,)>) -> Result<StatusCode, Failure> {
    service.delete(id).await?;
    Ok(StatusCode::NO_CONTENT)
}

macro_rules! commands {
    ($($name:ident $command:expr),+ $(,)?) => {
        $(pub(super) async fn $name(
            State(service): Shared,
            Parsed((id,)): Parsed<(JobId,)>,
        ) -> Result<Answer<JobView>, Failure> {
            service.command(id, $command).await.map(Answer)
        })+
    };
}

commands! {
    cancel Command::Cancel,
    pause Command::Pause,
    resume Command::Resume,
    requeue Command::Requeue,
}

pub(super) async fn tiles(
    State(service): Shared,
    Parsed((id, frame)): Parsed<(JobId, u32)>,
) -> Result<Answer<TileList>, Failure> {
    Ok(Answer(TileList { tiles: service.tile_views(id, frame).await? }))
}

pub(super) async fn picture(
    State(service): Shared,
    Parsed((id, frame, name)): Parsed<(JobId, u32, String)>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let Some(picture) = Picture::ALL.into_iter().find(|picture| picture.name() == name) else {
        return Err(Failure::NotFound(format!("picture \"{name}\" of a frame")));
    };
    let tag = service.picture_tag(id, frame, picture)?;
    let cache = [(header::ETAG, tag.clone()), (header::CACHE_CONTROL, "no-cache".into())];
    let known = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    if known.flat_map(|value| value.split(',')).any(|known| matches!(known.trim(), "*") || known.trim() == tag) {
        return Ok((StatusCode::NOT_MODIFIED, cache).into_response());
    }
    let bytes = service.picture(id, frame, picture).await?;
    Ok((cache, [(header::CONTENT_TYPE, picture.media_type())], bytes).into_response())
}
