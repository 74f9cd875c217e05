//! The REST interface under /api/v1, its description, and the dashboard.
//!
//! Routes read a request, call the service, and write the answer. They decide nothing. What each takes and answers is
//! written beside it, and [`openapi()`] is put together from that.

mod assets;
mod auth;
mod docs;
mod etag;
mod events;
mod extract;
mod farm;
mod jobs;
mod metrics;
mod openapi;
mod page;
mod pictures;
mod request;
mod workers;

use std::sync::Arc;

use axum::{Router, extract::DefaultBodyLimit, middleware, routing::get};
use common::protocol::API;
use tower_http::catch_panic::CatchPanicLayer;
use utoipa_axum::{
    router::{OpenApiRouter, UtoipaMethodRouterExt},
    routes,
};

use crate::{error::Failure, service::Service};

type Shared = axum::extract::State<Arc<Service>>;

/// The routes under /api/v1.
fn api() -> OpenApiRouter<Arc<Service>> {
    OpenApiRouter::new()
        .routes(routes!(assets::get, assets::put).layer(DefaultBodyLimit::disable()))
        .routes(routes!(assets::post).layer(DefaultBodyLimit::disable()))
        .routes(routes!(jobs::submit, jobs::list))
        .routes(routes!(jobs::view, jobs::patch, jobs::delete))
        .routes(routes!(jobs::cancel))
        .routes(routes!(jobs::pause))
        .routes(routes!(jobs::resume))
        .routes(routes!(jobs::requeue))
        .routes(routes!(jobs::attempts))
        .routes(routes!(jobs::failures))
        .routes(routes!(jobs::convergence))
        .routes(routes!(jobs::convergence_chart))
        .routes(routes!(events::of_job))
        .routes(routes!(pictures::tiles))
        .routes(routes!(pictures::pixels))
        .routes(routes!(pictures::picture))
        .routes(routes!(events::all))
        .routes(routes!(farm::view))
        .routes(routes!(farm::chart))
        .routes(routes!(farm::scenes))
        .routes(routes!(workers::register, workers::list))
        .routes(routes!(workers::lease))
        .routes(routes!(workers::heartbeat))
        .routes(routes!(workers::drain))
        .routes(routes!(workers::enable))
        .routes(routes!(workers::disable))
        .routes(routes!(workers::result))
        .routes(routes!(workers::fail))
}

/// The routes without a prefix.
fn plain() -> OpenApiRouter<Arc<Service>> {
    OpenApiRouter::new()
        .routes(routes!(metrics::health))
        .routes(routes!(metrics::ready))
        .routes(routes!(metrics::metrics))
}

/// The description of every route, OpenAPI 3.1.
#[must_use]
pub fn openapi() -> serde_json::Value {
    openapi::document(api().into_openapi(), plain().into_openapi())
}

/// Every route of a coordinator.
pub fn router(service: Arc<Service>) -> Router {
    let (api, described) = api().split_for_parts();
    let (plain, others) = plain().split_for_parts();
    let description: Arc<str> = openapi::document(described, others).to_string().into();
    let api = api
        .fallback(|| async { Failure::NotFound("such route".into()) })
        .method_not_allowed_fallback(|| async { Failure::MethodNotAllowed })
        .layer(middleware::from_fn(etag::tag))
        .layer(middleware::from_fn_with_state(Arc::clone(&service), auth::guard));
    Router::new()
        .nest(API, api)
        // What may be asked is no secret: it needs no token.
        .route(&format!("{API}/openapi.json"), get(move || docs::description(Arc::clone(&description))))
        .route("/docs", get(docs::moved))
        .route("/docs/", get(docs::index))
        .route("/docs/{file}", get(docs::file))
        .route("/", get(page::index))
        .route("/ui/{file}", get(page::file))
        .merge(plain)
        .fallback(|| async { Failure::NotFound("such page".into()) })
        .method_not_allowed_fallback(|| async { Failure::MethodNotAllowed })
        .layer(DefaultBodyLimit::max(service.config.max_body))
        .layer(CatchPanicLayer::custom(request::panicked))
        .layer(middleware::from_fn_with_state(Arc::clone(&service), request::name))
        .with_state(service)
}
