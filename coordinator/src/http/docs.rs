//! The API's description, and Swagger UI to browse it: all of it inside the binary, nothing from any other host.

use std::sync::Arc;

use axum::{
    extract::Path,
    http::{HeaderValue, header},
    response::{IntoResponse, Redirect, Response},
};
use common::protocol::API;
use utoipa_swagger_ui::Config;

use crate::error::Failure;

/// Swagger UI styles elements as it goes, and draws its icons from data.
const POLICY: &str = "default-src 'none'; style-src 'self' 'unsafe-inline'; script-src 'self'; img-src 'self' data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

pub(super) async fn description(text: Arc<str>) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-cache")], text.to_string())
}

pub(super) async fn moved() -> Redirect {
    Redirect::permanent("docs/")
}

pub(super) async fn index() -> Result<Response, Failure> {
    serve("index.html")
}

pub(super) async fn file(Path(name): Path<String>) -> Result<Response, Failure> {
    serve(&name)
}

fn serve(name: &str) -> Result<Response, Failure> {
    // A farm without a network has no validator.swagger.io either.
    let config = Config::from(format!("..{API}/openapi.json")).validator_url("none").try_it_out_enabled(true);
    let found = utoipa_swagger_ui::serve(name, Arc::new(config));
    let found = found.map_err(|error| Failure::Internal(format!("the API's pages: {error}")))?;
    let file = found.ok_or_else(|| Failure::NotFound("such page".into()))?;
    let headers = [
        (header::CONTENT_TYPE, file.content_type),
        (header::CONTENT_SECURITY_POLICY, POLICY.to_owned()),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff".to_owned()),
    ];
    let mut response = (headers, file.bytes.into_owned()).into_response();
    if file.gzpipped {
        response.headers_mut().insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    Ok(response)
}
