//! One coordinator as a caller sees it: its address, the token, and what can go wrong with a request.
//!
//! The command line speaks through this too. It knows nothing of leases or jobs.

use std::{error::Error, time::Duration};

use common::protocol::{API, ApiError, ErrorBody};
use reqwest::{
    Client, Method, RequestBuilder, Response, StatusCode, Url,
    header::{AUTHORIZATION, HeaderMap, HeaderValue},
};
use serde::de::DeserializeOwned;

/// A request is given up after this long, unless it says otherwise.
const TIMEOUT: Duration = Duration::from_secs(30);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Slowest transfer that is waited for, bytes a second.
const SLOWEST: f64 = 250e3;
/// Most bytes of an error body that are read.
const MAX_ERROR_BODY: usize = 64 << 10;

/// Where a coordinator is and who asks.
#[derive(Debug, Clone)]
pub struct Endpoint {
    url: Url,
    http: Client,
}

/// Why an address or token cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadEndpoint {
    /// Not of the form `http://HOST:PORT`.
    #[error("\"{0}\" is not a coordinator's address such as http://127.0.0.1:7878")]
    Url(String),
    /// TLS is asked for.
    #[error("\"{0}\": https is not supported yet; put the coordinator's plain http:// address here, or a tunnel's")]
    Tls(String),
    /// The token cannot be a header.
    #[error("the token holds characters that an HTTP header cannot")]
    Token,
    /// The HTTP client does not start.
    #[error("the HTTP client does not start: {0}")]
    Client(String),
}

/// Why a request has no answer that can be used.
#[derive(Debug, Clone, thiserror::Error)]
pub enum CallError {
    /// Nobody answered, or the connection broke.
    #[error("{url} cannot be reached: {cause}")]
    Unreachable {
        /// The coordinator.
        url: String,
        /// The innermost cause.
        cause: String,
    },
    /// Somebody answered that it cannot be done now.
    #[error("{url} cannot serve now: {status} {message}")]
    Unavailable {
        /// The coordinator.
        url: String,
        /// HTTP status, 5xx, 408 or 429.
        status: u16,
        /// What it said.
        message: String,
    },
    /// The coordinator refuses the request.
    #[error("{}", error.message)]
    Refused {
        /// HTTP status, 4xx.
        status: u16,
        /// What it said.
        error: ApiError,
    },
    /// The answer is not one of a coordinator.
    #[error("{url} does not answer like a Tessera coordinator: {cause}")]
    Garbled {
        /// The address.
        url: String,
        /// What is odd.
        cause: String,
    },
}

impl CallError {
    /// Whether the same request may succeed later.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, CallError::Unreachable { .. } | CallError::Unavailable { .. })
    }

    /// The HTTP status of a refusal.
    #[must_use]
    pub fn refusal(&self) -> Option<u16> {
        match self {
            CallError::Refused { status, .. } => Some(*status),
            _ => None,
        }
    }
}

impl Endpoint {
    /// A coordinator at `url`, with the bearer token it asks for, if any.
    ///
    /// # Errors
    /// An address that is not plain `http`, or a token that is not a header value.
    pub fn new(url: &str, token: Option<&str>) -> Result<Self, BadEndpoint> {
        let parsed = Url::parse(url).map_err(|_| BadEndpoint::Url(url.into()))?;
        match parsed.scheme() {
            "http" if parsed.has_host() && parsed.query().is_none() => {}
            "https" => return Err(BadEndpoint::Tls(url.into())),
            _ => return Err(BadEndpoint::Url(url.into())),
        }
        let mut headers = HeaderMap::new();
        if let Some(token) = token {
            let mut value = HeaderValue::from_str(&format!("Bearer {token}")).map_err(|_| BadEndpoint::Token)?;
            value.set_sensitive(true);
            headers.insert(AUTHORIZATION, value);
        }
        let http = Client::builder()
            .default_headers(headers)
            .connect_timeout(CONNECT_TIMEOUT)
            .user_agent(concat!("tessera/", env!("CARGO_PKG_VERSION")))
            .no_proxy()
            .build()
            .map_err(|error| BadEndpoint::Client(error.to_string()))?;
        Ok(Self { url: parsed, http })
    }

    /// The address without a slash at its end.
    #[must_use]
    pub fn url(&self) -> &str {
        self.url.as_str().trim_end_matches('/')
    }

    /// A request to `path` below the API's prefix; `path` begins with a slash.
    pub fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.http.request(method, format!("{}{API}{path}", self.url())).timeout(TIMEOUT)
    }

    /// Send a request.
    ///
    /// # Errors
    /// See [`CallError`]; every answer that is not a success is one.
    pub async fn send(&self, request: RequestBuilder) -> Result<Response, CallError> {
        let response = request.send().await.map_err(|error| self.unreachable(&error))?;
        let status = response.status();
        if status.is_success() { Ok(response) } else { Err(self.refusal(status, response).await) }
    }

    /// Send a request and read the JSON of its answer.
    ///
    /// # Errors
    /// As [`Endpoint::send`], and an answer that is not of type `T`.
    pub async fn fetch<T: DeserializeOwned>(&self, request: RequestBuilder) -> Result<T, CallError> {
        let body = self.send(request).await?.bytes().await.map_err(|error| self.unreachable(&error))?;
        serde_json::from_slice(&body).map_err(|error| self.garbled(&error.to_string()))
    }

    /// The error for an answer that makes no sense.
    #[must_use]
    pub fn garbled(&self, cause: &str) -> CallError {
        CallError::Garbled { url: self.url().into(), cause: cause.into() }
    }

    /// The error for a connection that failed.
    #[must_use]
    pub fn unreachable(&self, error: &reqwest::Error) -> CallError {
        CallError::Unreachable { url: self.url().into(), cause: innermost(error) }
    }

    async fn refusal(&self, status: StatusCode, response: Response) -> CallError {
        let body = response.bytes().await.unwrap_or_default();
        let told = serde_json::from_slice::<ErrorBody>(&body[..body.len().min(MAX_ERROR_BODY)]);
        if status.is_server_error() || matches!(status.as_u16(), 408 | 429) {
            let message = told.map_or_else(|_| String::new(), |body| body.error.message);
            return CallError::Unavailable { url: self.url().into(), status: status.as_u16(), message };
        }
        match told {
            Ok(ErrorBody { error }) => CallError::Refused { status: status.as_u16(), error },
            Err(_) => self.garbled(&format!("status {status}")),
        }
    }
}

/// Time to allow a request that moves `bytes`.
#[must_use]
pub fn transfer_timeout(bytes: usize) -> Duration {
    TIMEOUT + Duration::from_secs_f64(bytes as f64 / SLOWEST)
}

/// The cause at the bottom: "connection refused" says more than "error sending request".
fn innermost(error: &reqwest::Error) -> String {
    if error.is_timeout() {
        return "no answer in time".into();
    }
    let mut cause: &dyn Error = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    let text = cause.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_plain_http_addresses_are_taken() {
        for (url, taken) in [
            ("http://127.0.0.1:7878", true),
            ("http://farm.example/tessera/", true),
            ("127.0.0.1:7878", false),
            ("farm:7878", false),
            ("http://", false),
            ("", false),
        ] {
            assert_eq!(Endpoint::new(url, None).is_ok(), taken, "{url}");
        }
        assert_eq!(Endpoint::new("https://farm:1", None).unwrap_err(), BadEndpoint::Tls("https://farm:1".into()));
        assert_eq!(Endpoint::new("http://farm:1", Some("a\nb")).unwrap_err(), BadEndpoint::Token);
    }

    #[test]
    fn paths_are_below_the_prefix_and_the_token_is_not_shown() {
        let endpoint = Endpoint::new("http://farm:1/sub/", Some("hush")).unwrap();
        let request = endpoint.request(Method::GET, "/jobs").build().unwrap();
        assert_eq!(request.url().as_str(), "http://farm:1/sub/api/v1/jobs");
        assert!(!format!("{endpoint:?}").contains("hush"));
    }
}
