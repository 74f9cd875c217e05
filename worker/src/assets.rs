//! Files by their hash: from a folder on this machine, or from the coordinator.

use std::{io, path::PathBuf, sync::Arc};

use bytes::Bytes;
use common::hash::AssetHash;
use reqwest::Method;

use crate::{
    endpoint::CallError,
    link::{Link, entropy},
};

/// Where files come from.
#[derive(Debug, Clone)]
pub struct AssetSource {
    link: Arc<Link>,
    folder: Option<PathBuf>,
}

/// Why a file is not to be had.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// The coordinator refuses it, or does not have it.
    #[error("asset {hash} cannot be fetched: {source}")]
    Refused {
        /// The file.
        hash: AssetHash,
        /// What the coordinator said.
        source: CallError,
    },
    /// The bytes that came are others than those asked for.
    #[error("asset {0} arrived damaged: its bytes have another hash")]
    Damaged(AssetHash),
}

impl AssetSource {
    /// Files from the coordinator, kept in `folder` if one is given. Nothing is ever removed from it.
    #[must_use]
    pub fn new(link: Arc<Link>, folder: Option<PathBuf>) -> Self {
        Self { link, folder }
    }

    /// The bytes of a file, checked against its hash. Waits while the coordinator is away.
    ///
    /// # Errors
    /// The coordinator does not have it, or sends something else.
    pub async fn get(&self, hash: AssetHash) -> Result<Bytes, AssetError> {
        if let Some(bytes) = self.kept(hash).await {
            return Ok(bytes);
        }
        let bytes =
            self.link.persist(|| self.fetch(hash)).await.map_err(|source| AssetError::Refused { hash, source })?;
        if AssetHash::of(&bytes) != hash {
            return Err(AssetError::Damaged(hash));
        }
        self.keep(hash, &bytes).await;
        Ok(bytes)
    }

    async fn fetch(&self, hash: AssetHash) -> Result<Bytes, CallError> {
        let endpoint = &self.link.endpoint;
        // A large file takes as long as it takes; a connection that stalls is noticed by the system.
        let request = endpoint.request(Method::GET, &format!("/assets/{hash}")).timeout(std::time::Duration::MAX);
        endpoint.send(request).await?.bytes().await.map_err(|error| endpoint.unreachable(&error))
    }

    async fn kept(&self, hash: AssetHash) -> Option<Bytes> {
        let path = self.folder.as_ref()?.join(hash.to_string());
        let bytes = tokio::fs::read(&path).await.ok()?;
        // A file that was cut short or touched is fetched again and replaced.
        (AssetHash::of(&bytes) == hash).then(|| bytes.into())
    }

    /// Keep a copy. A full disk is no reason to stop: the file is fetched again next time.
    async fn keep(&self, hash: AssetHash, bytes: &Bytes) {
        let Some(folder) = &self.folder else { return };
        let write = async || -> io::Result<()> {
            tokio::fs::create_dir_all(folder).await?;
            // Workers of one machine may share the folder: only whole files appear under their name.
            let partial = folder.join(format!("{hash}.{:016x}", entropy()));
            tokio::fs::write(&partial, bytes).await?;
            tokio::fs::rename(&partial, folder.join(hash.to_string())).await
        };
        if let Err(error) = write().await {
            tracing::warn!("asset {hash} cannot be kept in {}: {error}", folder.display());
        }
    }
}
