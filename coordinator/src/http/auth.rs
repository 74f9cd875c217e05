//! Who may call: the bearer token, or the cookie that the status page sets from it.

use axum::{
    extract::{Request, State},
    http::{HeaderMap, Method, header},
    middleware::Next,
    response::Response,
};

use super::Shared;
use crate::error::Failure;

/// Name of the cookie.
const COOKIE: &str = "tessera_token";

/// Lets a call through if it may be made.
pub(super) async fn guard(State(service): Shared, request: Request, next: Next) -> Result<Response, Failure> {
    if !matches!(*request.method(), Method::GET | Method::HEAD) && foreign(request.headers()) {
        return Err(Failure::Forbidden);
    }
    match &service.config.token {
        Some(token) if !carries(request.headers(), token) => Err(Failure::Unauthorized),
        _ => Ok(next.run(request).await),
    }
}

/// Whether a browser says that a page of another site makes this call.
fn foreign(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return false };
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let from = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, authority)| authority);
    from.is_none() || from != host
}

fn carries(headers: &HeaderMap, token: &str) -> bool {
    let bearer = headers
        .get_all(header::AUTHORIZATION)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .filter_map(|value| value.split_once(' '))
        .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
        .map(|(_, given)| given.trim());
    let cookies = headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .filter(|(name, _)| *name == COOKIE)
        .map(|(_, given)| given);
    // No short cut at the first match, so that the time says nothing.
    bearer.chain(cookies).fold(false, |found, given| found | same(given, token))
}

/// Compare by hash: comparing hashes takes the same time wherever the texts differ.
fn same(given: &str, token: &str) -> bool {
    // `blake3::Hash` compares in constant time.
    blake3::hash(given.as_bytes()) == blake3::hash(token.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers.append(name.parse::<header::HeaderName>().unwrap(), value.parse().unwrap());
        }
        headers
    }

    #[test]
    fn the_token_comes_as_bearer_or_cookie() {
        let token = "correct-horse";
        for (pairs, expected) in [
            (vec![("authorization", "Bearer correct-horse")], true),
            (vec![("authorization", "bearer correct-horse")], true),
            (vec![("cookie", "a=b; tessera_token=correct-horse")], true),
            (vec![("authorization", "Basic correct-horse")], false),
            (vec![("authorization", "Bearer correct-hors")], false),
            (vec![("cookie", "tessera_token=")], false),
            (vec![], false),
        ] {
            assert_eq!(carries(&headers(&pairs), token), expected, "{pairs:?}");
        }
    }

    #[test]
    fn pages_of_other_sites_are_told_apart() {
        for (pairs, expected) in [
            (vec![("host", "localhost:7878")], false),
            (vec![("host", "localhost:7878"), ("origin", "http://localhost:7878")], false),
            (vec![("host", "localhost:7878"), ("origin", "https://example.org")], true),
            (vec![("host", "localhost:7878"), ("origin", "null")], true),
        ] {
            assert_eq!(foreign(&headers(&pairs)), expected, "{pairs:?}");
        }
    }
}
