//! Every request has an id, which the logs, the answer and the worker that renders what it asked for all carry.

use std::{any::Any, time::Instant};

use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method},
    middleware::Next,
    response::{IntoResponse, Response},
};
use tracing::Instrument;

use super::Shared;
use crate::error::Failure;

const HEADER: HeaderName = HeaderName::from_static("x-request-id");
/// Longest id that a client may give.
const LONGEST: usize = 64;

/// The id of a request, for routes that hand it on.
#[derive(Debug, Clone)]
pub(super) struct RequestId(pub(super) String);

/// Names a request: as the client did, if it did so soberly. Logs what came of it in one line.
pub(super) async fn name(State(service): Shared, mut request: Request, next: Next) -> Response {
    let id = given(request.headers()).unwrap_or_else(|| service.next_request());
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let span = tracing::info_span!("request", id);
    request.extensions_mut().insert(RequestId(id.clone()));
    let began = Instant::now();
    async move {
        let mut response = next.run(request).await;
        let (status, milliseconds) = (response.status().as_u16(), began.elapsed().as_millis() as u64);
        // What workers say all the time, and what only looks, is of interest to nobody but who looks for it.
        let talk = path.starts_with("/api/v1/leases") || path.ends_with("/lease") || path.ends_with("/heartbeat");
        if matches!(method, Method::GET | Method::HEAD) || talk {
            tracing::debug!(%method, path, status, milliseconds, "answered");
        } else {
            tracing::info!(%method, path, status, milliseconds, "answered");
        }
        if let Ok(value) = HeaderValue::from_str(&id) {
            response.headers_mut().insert(HEADER, value);
        }
        response
    }
    .instrument(span)
    .await
}

fn given(headers: &HeaderMap) -> Option<String> {
    let id = headers.get(HEADER)?.to_str().ok()?;
    let sober = |b: u8| b.is_ascii_alphanumeric() || b"-_.:".contains(&b);
    (!id.is_empty() && id.len() <= LONGEST && id.bytes().all(sober)).then(|| id.to_owned())
}

/// A route that panicked failed, and says so as all that fail do.
pub(super) fn panicked(panic: Box<dyn Any + Send>) -> Response {
    let said = panic.downcast_ref::<String>().cloned();
    let said = said.or_else(|| panic.downcast_ref::<&str>().map(|&said| said.to_owned()));
    Failure::Internal(format!("a route panicked: {}", said.unwrap_or_default())).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_that_would_spoil_a_log_are_not_taken() {
        for (id, taken) in
            [("abc-1.2:3_4", true), ("", false), ("a b", false), ("a\tb", false), (&"a".repeat(65), false)]
        {
            let mut headers = HeaderMap::new();
            headers.insert(HEADER, id.parse().unwrap());
            assert_eq!(given(&headers).is_some(), taken, "{id}");
        }
    }
}
