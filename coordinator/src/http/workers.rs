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

pub(super) async fn register(
    State(service): Shared,
    Json(register): Json<Register>,
) -> Result<(StatusCode, Answer<Registered>), Failure> {
    Ok((StatusCode::CREATED, Answer(service.register(register).await?)))
}

pub(super) async fn list(State(service): Shared) -> Answer<WorkerList> {
    Answer(WorkerList { workers: service.worker_views() })
}

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

pub(super) async fn heartbeat(
    State(service): Shared,
    Parsed((worker,)): Parsed<(WorkerId,)>,
    Json(heartbeat): Json<Heartbeat>,
) -> Result<Answer<HeartbeatReply>, Failure> {
    service.heartbeat(worker, heartbeat).map(Answer)
}

macro_rules! commands {
    ($($name:ident $command:expr),+ $(,)?) => {
        $(pub(super) async fn $name(
            State(service): Shared,
            Parsed((id,)): Parsed<(WorkerId,)>,
        ) -> Result<Answer<WorkerView>, Failure> {
            service.worker_command(id, $command).await.map(Answer)
        })+
    };
}

commands! {
    drain WorkerCommand::Drain,
    enable WorkerCommand::Enable,
    disable WorkerCommand::Disable,
}

pub(super) async fn result(
    State(service): Shared,
    Parsed((lease, unit)): Parsed<(LeaseId, UnitId)>,
    Body(bytes): Body,
) -> Result<Answer<Receipt>, Failure> {
    service.take_result(lease, unit, bytes).await.map(Answer)
}

pub(super) async fn fail(
    State(service): Shared,
    Parsed((lease,)): Parsed<(LeaseId,)>,
    Json(failure): Json<LeaseFailure>,
) -> StatusCode {
    service.lease_failed(lease, failure);
    StatusCode::NO_CONTENT
}
