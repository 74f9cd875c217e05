//! Routes of workers: what they say, and what people do to them.

use axum::{
    Json as Answer,
    extract::State,
    http::StatusCode,
    response::{IntoResponse, Response},
};
use common::{
    job::{LeaseId, WorkerId},
    protocol::{
        Heartbeat, HeartbeatReply, LeaseFailure, LeaseRequest, Register, Registered, UnitId, WorkerList, WorkerView,
    },
};

use super::{
    Shared,
    extract::{Body, Json, Parsed},
};
use crate::{error::Failure, farm::WorkerCommand, service::Receipt};

/// A worker process starts
#[utoipa::path(post, path = "/workers", tag = "worker side",
    request_body(content = ref("#/components/schemas/Register"), content_type = "application/json"),
    responses((status = 201, description = "Its name.", body = ref("#/components/schemas/Registered"))))]
pub(super) async fn register(
    State(service): Shared,
    Json(register): Json<Register>,
) -> Result<(StatusCode, Answer<Registered>), Failure> {
    Ok((StatusCode::CREATED, Answer(service.register(register).await?)))
}

/// The workers, oldest first
#[utoipa::path(get, path = "/workers", tag = "workers",
    responses((status = 200, description = "The workers.", body = ref("#/components/schemas/WorkerList"))))]
pub(super) async fn list(State(service): Shared) -> Answer<WorkerList> {
    Answer(WorkerList { workers: service.worker_views() })
}

/// A worker asks for work
///
/// Waits up to `wait_seconds` for some.
#[utoipa::path(post, path = "/workers/{id}/lease", tag = "worker side",
    request_body(content = ref("#/components/schemas/LeaseRequest"), content_type = "application/json"),
    responses(
        (status = 200, description = "Units to render.", body = ref("#/components/schemas/Lease")),
        (status = 204, description = "There is nothing to do."),
    ))]
pub(super) async fn lease(
    State(service): Shared,
    Parsed((worker,)): Parsed<(WorkerId,)>,
    Json(request): Json<LeaseRequest>,
) -> Result<Response, Failure> {
    Ok(match service.lease(worker, request).await? {
        Some(lease) => Answer(lease).into_response(),
        None => StatusCode::NO_CONTENT.into_response(),
    })
}

/// A worker is still there
#[utoipa::path(post, path = "/workers/{id}/heartbeat", tag = "worker side",
    request_body(content = ref("#/components/schemas/Heartbeat"), content_type = "application/json"),
    responses((status = 200, description = "What it is to stop.", body = ref("#/components/schemas/HeartbeatReply"))))]
pub(super) async fn heartbeat(
    State(service): Shared,
    Parsed((worker,)): Parsed<(WorkerId,)>,
    Json(heartbeat): Json<Heartbeat>,
) -> Result<Answer<HeartbeatReply>, Failure> {
    service.heartbeat(worker, heartbeat).map(Answer)
}

macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident $path:literal $command:expr),+ $(,)?) => {
        $($(#[$doc])*
        #[utoipa::path(post, path = $path, tag = "workers",
            responses((status = 200, description = "The worker.", body = ref("#/components/schemas/WorkerView"))))]
        pub(super) async fn $name(
            State(service): Shared,
            Parsed((id,)): Parsed<(WorkerId,)>,
        ) -> Result<Answer<WorkerView>, Failure> {
            service.worker_command(id, $command).await.map(Answer)
        })+
    };
}

commands! {
    /// Let a worker finish what it has begun, and give it no more
    drain "/workers/{id}/drain" WorkerCommand::Drain,
    /// Give a worker work again
    enable "/workers/{id}/enable" WorkerCommand::Enable,
    /// Give a worker no work; what it holds goes to others
    disable "/workers/{id}/disable" WorkerCommand::Disable,
}

/// A worker hands in a unit
#[utoipa::path(put, path = "/leases/{lease}/units/{unit}", tag = "worker side",
    request_body(content = Vec<u8>, content_type = "application/x-tessera-unit+zstd", description = "Its pixels."),
    responses(
        (status = 200, description = "It is on disk.", body = ref("#/components/schemas/Receipt")),
        (status = 422, description = "It is not a result of that unit.", body = ref("#/components/schemas/ErrorBody")),
    ))]
pub(super) async fn result(
    State(service): Shared,
    Parsed((lease, unit)): Parsed<(LeaseId, UnitId)>,
    Body(bytes): Body,
) -> Result<Answer<Receipt>, Failure> {
    service.take_result(lease, unit, bytes).await.map(Answer)
}

/// A worker hands units back unrendered
#[utoipa::path(post, path = "/leases/{lease}/fail", tag = "worker side",
    request_body(content = ref("#/components/schemas/LeaseFailure"), content_type = "application/json"),
    responses((status = 204, description = "Others will render them.")))]
pub(super) async fn fail(
    State(service): Shared,
    Parsed((lease,)): Parsed<(LeaseId,)>,
    Json(failure): Json<LeaseFailure>,
) -> StatusCode {
    service.lease_failed(lease, failure);
    StatusCode::NO_CONTENT
}
