//! Server-sent events: the present state at once, then what changes.

use std::{convert::Infallible, sync::Arc, time::Duration};

use axum::{
    extract::State,
    response::sse::{Event, KeepAlive, Sse},
};
use common::{
    job::JobId,
    protocol::{JobList, WorkerList},
};
use futures::StreamExt;
use serde::Serialize;
use tokio_stream::wrappers::{BroadcastStream, errors::BroadcastStreamRecvError};

use super::{Shared, extract::Parsed};
use crate::{error::Failure, service::Service};

type Events = Sse<axum::response::sse::KeepAliveStream<futures::stream::BoxStream<'static, Result<Event, Infallible>>>>;

/// What happens on the farm, as server-sent events
///
/// First the present state: `jobs` (the newest 100) and `workers`. Then `state` and `progress` of a job, `tile`,
/// `worker`, and `removed`, as they come.
#[utoipa::path(get, path = "/events", tag = "farm",
    responses((status = 200, description = "The events, without end.", content_type = "text/event-stream")))]
pub(super) async fn all(State(service): Shared) -> Events {
    stream(service, None)
}

/// What happens to a job, as server-sent events
///
/// First the present `state`; then `state`, `progress`, `tile` and `removed`, as they come.
#[utoipa::path(get, path = "/jobs/{id}/events", tag = "jobs",
    responses((status = 200, description = "The events, without end.", content_type = "text/event-stream")))]
pub(super) async fn of_job(State(service): Shared, Parsed((id,)): Parsed<(JobId,)>) -> Result<Events, Failure> {
    service.job_view(id)?;
    Ok(stream(service, Some(id)))
}

fn stream(service: Arc<Service>, only: Option<JobId>) -> Events {
    // Listening begins before the state is read: nothing falls in between.
    let notices = BroadcastStream::new(service.listen());
    let leaving = service.leaving.clone();
    let first = futures::stream::iter(present(&service, only));
    let rest = notices.flat_map(move |notice| {
        let events = match notice {
            Ok(notice) if only.is_none() || notice.job == only => {
                vec![Event::default().event(notice.name).data(&notice.data)]
            }
            Ok(_) => Vec::new(),
            // It fell behind: it is told the whole state again.
            Err(BroadcastStreamRecvError::Lagged(_)) => present(&service, only),
        };
        futures::stream::iter(events)
    });
    let all = first.chain(rest).map(Ok).take_until(async move { leaving.cancelled().await });
    Sse::new(all.boxed()).keep_alive(KeepAlive::new().interval(Duration::from_secs(10)))
}

/// The present state: one `state` of the job, or one `jobs` and one `workers` of all.
fn present(service: &Service, only: Option<JobId>) -> Vec<Event> {
    match only {
        Some(id) => service.job_view(id).ok().and_then(|view| event("state", &view)).into_iter().collect(),
        None => {
            let (jobs, next) = service.list_jobs(None, None, 100);
            let jobs = JobList { jobs, next: next.map(|id| id.to_string()) };
            let workers = WorkerList { workers: service.worker_views() };
            event("jobs", &jobs).into_iter().chain(event("workers", &workers)).collect()
        }
    }
}

fn event(name: &'static str, data: &impl Serialize) -> Option<Event> {
    Some(Event::default().event(name).data(serde_json::to_string(data).ok()?))
}
