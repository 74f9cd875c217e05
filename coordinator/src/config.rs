//! Settings of a coordinator, and which of them are refused.

use std::{net::SocketAddr, path::PathBuf};

/// Name of the record in the data folder.
pub const STORE: &str = "tessera.sqlite";

/// Settings of a coordinator.
#[derive(Debug, Clone)]
pub struct Config {
    /// Folder of the record and the assets; made if need be.
    pub data: PathBuf,
    /// Bearer token that every call under /api needs; none: everybody may call.
    pub token: Option<String>,
    /// Listen on any address without a token.
    pub insecure: bool,
    /// Largest asset, bytes.
    pub max_asset: u64,
    /// Largest body of any other request, bytes.
    pub max_body: usize,
    /// Memory for films between results, bytes.
    pub film_cache: usize,
}

/// Why settings are refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadConfig {
    /// An address that others can reach, and no token.
    #[error("{0} can be reached from other machines: set a token, or allow this with --insecure")]
    NoToken(SocketAddr),
    /// A token that guards nothing.
    #[error("the token must be at least 8 visible ASCII characters")]
    WeakToken,
}

impl Config {
    /// A coordinator that keeps its files in `data`, without a token.
    #[must_use]
    pub fn new(data: impl Into<PathBuf>) -> Self {
        Config {
            data: data.into(),
            token: None,
            insecure: false,
            max_asset: 4 << 30,
            max_body: 64 << 20,
            film_cache: 256 << 20,
        }
    }

    /// Check that these settings may be served at `address`.
    ///
    /// # Errors
    /// See [`BadConfig`].
    pub fn check(&self, address: SocketAddr) -> Result<(), BadConfig> {
        if let Some(token) = &self.token
            && (token.len() < 8 || !token.bytes().all(|b| b.is_ascii_graphic()))
        {
            return Err(BadConfig::WeakToken);
        }
        if !address.ip().to_canonical().is_loopback() && self.token.is_none() && !self.insecure {
            return Err(BadConfig::NoToken(address));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_others_can_reach_takes_a_token() {
        let open: SocketAddr = "0.0.0.0:7878".parse().unwrap();
        let loopback: SocketAddr = "127.0.0.1:7878".parse().unwrap();
        let mut config = Config::new("data");
        assert_eq!(config.check(loopback), Ok(()));
        assert_eq!(config.check(open), Err(BadConfig::NoToken(open)));
        config.insecure = true;
        assert_eq!(config.check(open), Ok(()));
        config.insecure = false;
        config.token = Some("a long secret".into());
        assert_eq!(config.check(loopback), Err(BadConfig::WeakToken));
        config.token = Some("long-enough".into());
        assert_eq!(config.check(open), Ok(()));
    }
}
