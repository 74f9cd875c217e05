//! Everything that a call can be refused for, and the one place where that becomes HTTP.
//!
//! What went wrong inside is logged and never returned.

use axum::{
    Json,
    http::StatusCode,
    response::{IntoResponse, Response},
};
use common::{
    hash::AssetHash,
    job::FieldError,
    protocol::{ApiError, ErrorBody},
    scene::SceneError,
};

use crate::{blobs::BlobError, store::StoreError};

/// Why a call was refused.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Not JSON, or a request that cannot be read at all.
    #[error("{0}")]
    Malformed(String),
    /// A field is wrong.
    #[error("{0}")]
    Invalid(FieldError),
    /// Well-formed, but refused as a whole.
    #[error("{0}")]
    Refused(String),
    /// No token, or a wrong one.
    #[error("this call needs the coordinator's token: Authorization: Bearer TOKEN")]
    Unauthorized,
    /// A page of another site may not do this.
    #[error("a page of another site may not change anything here")]
    Forbidden,
    /// There is no such thing.
    #[error("there is no {0}")]
    NotFound(String),
    /// The route has no such method.
    #[error("this method is not allowed here")]
    MethodNotAllowed,
    /// Files the scene names are not stored.
    #[error("{} of the scene's files are not stored; PUT them to /api/v1/assets/HASH first", .0.len())]
    MissingAssets(Vec<AssetHash>),
    /// It cannot be done in this state.
    #[error("{0}")]
    Conflict(String),
    /// Too large.
    #[error("{0}")]
    TooLarge(String),
    /// The coordinator is shutting down.
    #[error("the coordinator is shutting down")]
    Leaving,
    /// Our own fault.
    #[error("the coordinator failed; its log says why")]
    Internal(String),
}

impl Failure {
    fn status_and_code(&self) -> (StatusCode, &'static str) {
        match self {
            Failure::Malformed(_) => (StatusCode::BAD_REQUEST, "malformed"),
            Failure::Invalid(_) | Failure::Refused(_) => (StatusCode::UNPROCESSABLE_ENTITY, "invalid"),
            Failure::Unauthorized => (StatusCode::UNAUTHORIZED, "unauthorized"),
            Failure::Forbidden => (StatusCode::FORBIDDEN, "forbidden"),
            Failure::NotFound(_) => (StatusCode::NOT_FOUND, "not_found"),
            Failure::MethodNotAllowed => (StatusCode::METHOD_NOT_ALLOWED, "method_not_allowed"),
            Failure::MissingAssets(_) => (StatusCode::CONFLICT, "missing_assets"),
            Failure::Conflict(_) => (StatusCode::CONFLICT, "conflict"),
            Failure::TooLarge(_) => (StatusCode::PAYLOAD_TOO_LARGE, "too_large"),
            Failure::Leaving => (StatusCode::SERVICE_UNAVAILABLE, "leaving"),
            Failure::Internal(_) => (StatusCode::INTERNAL_SERVER_ERROR, "internal"),
        }
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let (status, code) = self.status_and_code();
        let message = self.to_string();
        let mut error = ApiError { code: code.into(), message, field: None, missing: Vec::new() };
        match self {
            Failure::Internal(cause) => tracing::error!(cause, "a call failed"),
            Failure::Invalid(FieldError { field, message }) => {
                error.message = format!("{field}: {message}");
                error.field = Some(field);
            }
            Failure::MissingAssets(missing) => error.missing = missing,
            _ => {}
        }
        (status, Json(ErrorBody { error })).into_response()
    }
}

impl From<FieldError> for Failure {
    fn from(error: FieldError) -> Self {
        Failure::Invalid(error)
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::Field(field) => Failure::Invalid(field),
            SceneError::Syntax(message) => Failure::Malformed(format!("not valid JSON: {message}")),
        }
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Closed => Failure::Leaving,
            other => Failure::Internal(other.to_string()),
        }
    }
}

impl From<BlobError> for Failure {
    fn from(error: BlobError) -> Self {
        match error {
            BlobError::OtherHash(_) => Failure::Refused(error.to_string()),
            BlobError::TooLarge(_) => Failure::TooLarge(error.to_string()),
            BlobError::BrokenOff(_) => Failure::Malformed(error.to_string()),
            BlobError::Failed(_) => Failure::Internal(error.to_string()),
        }
    }
}
