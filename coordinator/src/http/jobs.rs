//! Routes of jobs.

use axum::{
    Extension, Json as Answer,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use common::{
    job::{FieldError, JobId, JobRequest, JobState},
    protocol::{API, AttemptList, Convergence, FailureList, JobList, JobPatch, JobView},
};

use super::{
    Shared,
    extract::{Json, Parameters, Parsed},
    request::RequestId,
};
use crate::{error::Failure, farm::Command, store::AttemptQuery};

/// Longest key that names a submission.
const LONGEST_KEY: usize = 255;

/// Submit a job
///
/// With an `Idempotency-Key`, a submission that is repeated, perhaps because its answer was lost, makes no second job:
/// it is answered by the first one as it stands.
#[utoipa::path(post, path = "/jobs", tag = "jobs",
    params(("Idempotency-Key" = Option<String>, Header, description = "Drawn by the client, 1 to 255 visible characters.", min_length = 1, max_length = 255)),
    request_body(content = ref("#/components/schemas/JobRequest"), content_type = "application/json"),
    responses(
        (status = 200, description = "The job that was made of the same request before.", body = ref("#/components/schemas/JobView")),
        (status = 201, description = "The job.", body = ref("#/components/schemas/JobView"), headers(("Location", description = "Where it is."))),
        (status = 409, description = "Files are missing: `error.missing` lists their hashes.", body = ref("#/components/schemas/ErrorBody")),
        (status = 422, description = "A field is wrong: `error.field` names it.", body = ref("#/components/schemas/ErrorBody")),
    ))]
pub(super) async fn submit(
    State(service): Shared,
    Extension(RequestId(id)): Extension<RequestId>,
    headers: HeaderMap,
    Json(request): Json<JobRequest>,
) -> Result<Response, Failure> {
    let key = key(&headers)?;
    let (view, new) = service.submit_once(request, key, Some(id)).await?;
    let place = [(header::LOCATION, format!("{API}/jobs/{}", view.id))];
    let status = if new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, place, Answer(view)).into_response())
}

fn key(headers: &HeaderMap) -> Result<Option<String>, Failure> {
    let Some(given) = headers.get("idempotency-key") else { return Ok(None) };
    let key = given.to_str().ok().filter(|key| (1..=LONGEST_KEY).contains(&key.len()));
    let message = format!("must be 1 to {LONGEST_KEY} visible ASCII characters");
    key.map(|key| Some(key.to_owned())).ok_or_else(|| FieldError::new("Idempotency-Key", message).into())
}

/// Jobs, newest first
#[utoipa::path(get, path = "/jobs", tag = "jobs",
    params(
        ("status" = Option<String>, Query, description = "Only jobs in this state: queued, active, paused, completed, failed or canceled."),
        ("limit" = Option<u32>, Query, description = "Most jobs of a page, 1 to 500; 50 where absent.", minimum = 1, maximum = 500),
        ("cursor" = Option<String>, Query, description = "`next` of the page before."),
    ),
    responses((status = 200, description = "A page of jobs.", body = ref("#/components/schemas/JobList"))))]
pub(super) async fn list(State(service): Shared, parameters: Parameters) -> Result<Answer<JobList>, Failure> {
    let parameters = parameters.only(&["status", "limit", "cursor"])?;
    let state: Option<JobState> = parameters.get("status")?;
    let before: Option<JobId> = parameters.get("cursor")?;
    let limit = limit(&parameters)?;
    let (jobs, next) = service.list_jobs(state, before, limit);
    Ok(Answer(JobList { jobs, next: next.map(|id| id.to_string()) }))
}

/// A job
#[utoipa::path(get, path = "/jobs/{id}", tag = "jobs",
    responses((status = 200, description = "The job.", body = ref("#/components/schemas/JobView"))))]
pub(super) async fn view(State(service): Shared, Parsed((id,)): Parsed<(JobId,)>) -> Result<Answer<JobView>, Failure> {
    service.job_view(id).map(Answer)
}

/// Change a job
///
/// A finer target ("continue") keeps every sample taken.
#[utoipa::path(patch, path = "/jobs/{id}", tag = "jobs",
    request_body(content = ref("#/components/schemas/JobPatch"), content_type = "application/json"),
    responses((status = 200, description = "The job.", body = ref("#/components/schemas/JobView"))))]
pub(super) async fn patch(
    State(service): Shared,
    Parsed((id,)): Parsed<(JobId,)>,
    Json(patch): Json<JobPatch>,
) -> Result<Answer<JobView>, Failure> {
    service.patch(id, patch).await.map(Answer)
}

/// Delete a job that is over, and its files
#[utoipa::path(delete, path = "/jobs/{id}", tag = "jobs",
    responses((status = 204, description = "It is gone.")))]
pub(super) async fn delete(State(service): Shared, Parsed((id,)): Parsed<(JobId,)>) -> Result<StatusCode, Failure> {
    service.delete(id).await?;
    Ok(StatusCode::NO_CONTENT)
}

macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident $path:literal $command:expr),+ $(,)?) => {
        $($(#[$doc])*
        #[utoipa::path(post, path = $path, tag = "jobs", responses(
            (status = 200, description = "The job.", body = ref("#/components/schemas/JobView")),
            (status = 409, description = "Its state does not allow it.", body = ref("#/components/schemas/ErrorBody")),
        ))]
        pub(super) async fn $name(
            State(service): Shared,
            Parsed((id,)): Parsed<(JobId,)>,
        ) -> Result<Answer<JobView>, Failure> {
            service.command(id, $command).await.map(Answer)
        })+
    };
}

commands! {
    /// Give a job up
    cancel "/jobs/{id}/cancel" Command::Cancel,
    /// Hold a job back
    pause "/jobs/{id}/pause" Command::Pause,
    /// Let a paused job go on
    resume "/jobs/{id}/resume" Command::Resume,
    /// Try a failed or canceled job again, from what it has
    requeue "/jobs/{id}/requeue" Command::Requeue,
}

/// What went wrong in a job
#[utoipa::path(get, path = "/jobs/{id}/failures", tag = "jobs",
    responses((status = 200, description = "The last attempts that came to nothing.", body = ref("#/components/schemas/FailureList"))))]
pub(super) async fn failures(
    State(service): Shared,
    Parsed((id,)): Parsed<(JobId,)>,
) -> Result<Answer<FailureList>, Failure> {
    Ok(Answer(FailureList { failures: service.failures(id)? }))
}

/// Attempts at a job's units, newest first
///
/// Who had each unit, for how long, and what came of it: the log of a job, a frame or a tile.
#[utoipa::path(get, path = "/jobs/{id}/attempts", tag = "jobs",
    params(
        ("frame" = Option<u32>, Query, description = "Only of this frame."),
        ("tile" = Option<u32>, Query, description = "Only of tiles with this index."),
        ("outcome" = Option<String>, Query, description = "Only those that ended so."),
        ("limit" = Option<u32>, Query, description = "Most attempts of a page, 1 to 500; 50 where absent.", minimum = 1, maximum = 500),
        ("cursor" = Option<String>, Query, description = "`next` of the page before."),
    ),
    responses((status = 200, description = "A page of attempts.", body = ref("#/components/schemas/AttemptList"))))]
pub(super) async fn attempts(
    State(service): Shared,
    Parsed((job,)): Parsed<(JobId,)>,
    parameters: Parameters,
) -> Result<Answer<AttemptList>, Failure> {
    let parameters = parameters.only(&["frame", "tile", "outcome", "limit", "cursor"])?;
    let query = AttemptQuery {
        job,
        frame: parameters.get("frame")?,
        tile: parameters.get("tile")?,
        outcome: parameters.get("outcome")?,
        before: parameters.get("cursor")?,
        limit: limit(&parameters)?,
    };
    service.attempts(query).await.map(Answer)
}

/// The length of a page.
fn limit(parameters: &Parameters) -> Result<usize, Failure> {
    let limit: usize = parameters.get("limit")?.unwrap_or(50);
    if !(1..=500).contains(&limit) {
        return Err(FieldError::new("limit", format!("{limit} is not within 1 to 500")).into());
    }
    Ok(limit)
}

/// How the error of a job falls with the work spent
#[utoipa::path(get, path = "/jobs/{id}/convergence.json", tag = "jobs",
    responses((status = 200, description = "The points, and the forecast.", body = ref("#/components/schemas/Convergence"))))]
pub(super) async fn convergence(
    State(service): Shared,
    Parsed((id,)): Parsed<(JobId,)>,
) -> Result<Answer<Convergence>, Failure> {
    service.convergence(id).map(Answer)
}

/// How the error of a job falls with the work spent, as a chart
#[utoipa::path(get, path = "/jobs/{id}/convergence.svg", tag = "jobs",
    responses((status = 200, description = "The chart.", content_type = "image/svg+xml")))]
pub(super) async fn convergence_chart(
    State(service): Shared,
    Parsed((id,)): Parsed<(JobId,)>,
) -> Result<Response, Failure> {
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], service.convergence_chart(id)?).into_response())
}
