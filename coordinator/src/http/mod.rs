//! The REST interface under /api/v1, and the status page.
//!
//! Routes read a request, call the service, and write the answer. They decide nothing.

mod assets;
mod auth;
mod events;
mod extract;
mod jobs;
mod metrics;
mod page;
mod workers;

use std::sync::Arc;

use axum::{
    Router,
    extract::DefaultBodyLimit,
    middleware,
    routing::{get, patch, post, put},
};
use common::protocol::API;

use crate::{error::Failure, service::Service};

type Shared = axum::extract::State<Arc<Service>>;

/// Every route of a coordinator.
pub fn router(service: Arc<Service>) -> Router {
    let api = Router::new()
        .route("/assets/{hash}", get(assets::get).put(assets::put).layer(DefaultBodyLimit::disable()))
        .route("/jobs", post(jobs::submit).get(jobs::list))
        .route("/jobs/{id}", get(jobs::view).merge(patch(jobs::patch)).delete(jobs::delete))
        .route("/jobs/{id}/cancel", post(jobs::cancel))
        .route("/jobs/{id}/pause", post(jobs::pause))
        .route("/jobs/{id}/resume", post(jobs::resume))
        .route("/jobs/{id}/requeue", post(jobs::requeue))
        .route("/jobs/{id}/events", get(events::of_job))
        .route("/jobs/{id}/frames/{frame}/tiles", get(jobs::tiles))
        .route("/jobs/{id}/frames/{frame}/{picture}", get(jobs::picture))
        .route("/events", get(events::all))
        .route("/workers", post(workers::register).get(workers::list))
        .route("/workers/{id}/lease", post(workers::lease))
        .route("/workers/{id}/heartbeat", post(workers::heartbeat))
        .route("/workers/{id}/drain", post(workers::drain))
        .route("/workers/{id}/enable", post(workers::enable))
        .route("/workers/{id}/disable", post(workers::disable))
        .route("/leases/{lease}/units/{unit}", put(workers::result))
        .route("/leases/{lease}/fail", post(workers::fail))
        .fallback(|| async { Failure::NotFound("such route".into()) })
        .method_not_allowed_fallback(|| async { Failure::MethodNotAllowed })
        .layer(middleware::from_fn_with_state(Arc::clone(&service), auth::guard));
    Router::new()
        .nest(API, api)
        .route("/", get(page::index))
        .route("/page.css", get(page::style))
        .route("/page.js", get(page::script))
        .route("/healthz", get(metrics::health))
        .route("/readyz", get(metrics::ready))
        .route("/metrics", get(metrics::metrics))
        .fallback(|| async { Failure::NotFound("such page".into()) })
        .method_not_allowed_fallback(|| async { Failure::MethodNotAllowed })
        .layer(DefaultBodyLimit::max(service.config.max_body))
        .with_state(service)
}
