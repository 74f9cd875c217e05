//! Files by the hash of their bytes, in a folder (or any object store).

use std::{
    path::Path as FilePath,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use bytes::Bytes;
use common::hash::AssetHash;
use futures::{Stream, StreamExt, TryStreamExt, stream::BoxStream};
use object_store::{ObjectStore, ObjectStoreExt, WriteMultipart, local::LocalFileSystem, path::Path};

/// Numbers files that are on their way in.
static INCOMING: AtomicU64 = AtomicU64::new(0);

/// Content-addressed files.
#[derive(Debug, Clone)]
pub struct Blobs(Arc<dyn ObjectStore>);

/// Why a file could not be stored or read.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// The bytes have another hash than their name.
    #[error("the bytes have the hash {0}")]
    OtherHash(AssetHash),
    /// The file is larger than allowed.
    #[error("the file is larger than {0} bytes")]
    TooLarge(u64),
    /// The sender stopped.
    #[error("the upload broke off: {0}")]
    BrokenOff(String),
    /// The store failed.
    #[error("the asset store failed: {0}")]
    Failed(#[from] object_store::Error),
}

impl Blobs {
    /// Files in a folder, which is made if need be. A stored file has reached the disk.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn folder(path: &FilePath) -> anyhow::Result<Self> {
        std::fs::create_dir_all(path)?;
        Ok(Blobs(Arc::new(LocalFileSystem::new_with_prefix(path)?.with_fsync(true))))
    }

    /// Size of a file in bytes; `None` if it is not stored.
    ///
    /// # Errors
    /// The store failed.
    pub async fn size(&self, hash: AssetHash) -> Result<Option<u64>, BlobError> {
        match self.0.head(&place(hash)).await {
            Ok(meta) => Ok(Some(meta.size)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// A file's size and bytes; `None` if it is not stored.
    ///
    /// # Errors
    /// The store failed.
    pub async fn stream(
        &self,
        hash: AssetHash,
    ) -> Result<Option<(u64, BoxStream<'static, std::io::Result<Bytes>>)>, BlobError> {
        match self.0.get(&place(hash)).await {
            Ok(found) => {
                let size = found.meta.size;
                Ok(Some((size, found.into_stream().map_err(std::io::Error::other).boxed())))
            }
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// A whole file of at most `limit` bytes; `None` if it is not stored.
    ///
    /// # Errors
    /// The file is larger, or the store failed.
    pub async fn read(&self, hash: AssetHash, limit: u64) -> Result<Option<Bytes>, BlobError> {
        match self.0.get(&place(hash)).await {
            Ok(found) if found.meta.size > limit => Err(BlobError::TooLarge(limit)),
            Ok(found) => Ok(Some(found.bytes().await?)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Store a file under its hash. Whether it was new.
    ///
    /// # Errors
    /// Bytes that do not match the hash or the limit leave nothing behind.
    pub async fn put<E: std::fmt::Display>(
        &self,
        hash: AssetHash,
        mut bytes: impl Stream<Item = Result<Bytes, E>> + Unpin,
        limit: u64,
    ) -> Result<bool, BlobError> {
        let known = self.size(hash).await?.is_some();
        let mut upload = WriteMultipart::new(self.0.put_multipart(&place(hash)).await?);
        let received = match receive(&mut upload, &mut bytes, limit).await {
            Ok((found, _)) if found != hash => Err(BlobError::OtherHash(found)),
            received => received,
        };
        match received {
            Err(error) => {
                upload.abort().await?;
                Err(error)
            }
            Ok(_) if known => {
                upload.abort().await?;
                Ok(false)
            }
            Ok(_) => {
                upload.finish().await?;
                Ok(true)
            }
        }
    }

    /// Store a file whose hash the sender does not know: the hash and the size in bytes.
    ///
    /// # Errors
    /// A file above the limit, or one that breaks off, leaves nothing behind.
    pub async fn keep<E: std::fmt::Display>(
        &self,
        mut bytes: impl Stream<Item = Result<Bytes, E>> + Unpin,
        limit: u64,
    ) -> Result<(AssetHash, u64), BlobError> {
        // Not a place that a hash names; what a coordinator that was killed left there is written over.
        let there = Path::from(format!("incoming/{}", INCOMING.fetch_add(1, Ordering::Relaxed)));
        let mut upload = WriteMultipart::new(self.0.put_multipart(&there).await?);
        match receive(&mut upload, &mut bytes, limit).await {
            Err(error) => {
                upload.abort().await?;
                Err(error)
            }
            Ok((hash, size)) => {
                upload.finish().await?;
                self.0.rename(&there, &place(hash)).await?;
                Ok((hash, size))
            }
        }
    }
}

/// Take in a file: its hash and size.
async fn receive<E: std::fmt::Display>(
    upload: &mut WriteMultipart,
    bytes: &mut (impl Stream<Item = Result<Bytes, E>> + Unpin),
    limit: u64,
) -> Result<(AssetHash, u64), BlobError> {
    let mut hasher = blake3::Hasher::new();
    let mut size = 0;
    while let Some(chunk) = bytes.next().await {
        let chunk = chunk.map_err(|error| BlobError::BrokenOff(error.to_string()))?;
        size += chunk.len() as u64;
        if size > limit {
            return Err(BlobError::TooLarge(limit));
        }
        hasher.update(&chunk);
        upload.wait_for_capacity(4).await?;
        upload.put(chunk);
    }
    let hash = hasher.finalize().to_hex().parse().map_err(|_| BlobError::BrokenOff("it has no hash".into()))?;
    Ok((hash, size))
}

/// Two levels of folders, so that no folder grows too long.
fn place(hash: AssetHash) -> Path {
    let text = hash.to_string();
    Path::from(format!("{}/{text}", &text[..2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn put(blobs: &Blobs, hash: AssetHash, bytes: &'static [u8], limit: u64) -> Result<bool, BlobError> {
        let chunks = bytes.chunks(3).map(|chunk| Ok::<_, String>(Bytes::from_static(chunk)));
        blobs.put(hash, futures::stream::iter(chunks), limit).await
    }

    #[tokio::test]
    async fn only_bytes_that_match_their_hash_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::folder(folder.path()).unwrap();
        let hash = AssetHash::of(b"some bytes");
        assert!(matches!(put(&blobs, hash, b"other bytes", 100).await, Err(BlobError::OtherHash(_))));
        assert!(matches!(put(&blobs, hash, b"some bytes", 9).await, Err(BlobError::TooLarge(9))));
        assert_eq!(blobs.size(hash).await.unwrap(), None);
        assert!(put(&blobs, hash, b"some bytes", 10).await.unwrap());
        assert!(!put(&blobs, hash, b"some bytes", 10).await.unwrap());
        assert_eq!(blobs.size(hash).await.unwrap(), Some(10));
        assert_eq!(blobs.read(hash, 10).await.unwrap().unwrap(), "some bytes");
        assert!(matches!(blobs.read(hash, 9).await, Err(BlobError::TooLarge(9))));
        let empty = AssetHash::of(b"");
        assert!(put(&blobs, empty, b"", 0).await.unwrap());
        assert_eq!(blobs.size(empty).await.unwrap(), Some(0));
    }

    #[tokio::test]
    async fn a_file_without_a_name_gets_one_from_its_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::folder(folder.path()).unwrap();
        let keep = |bytes: &'static [u8], limit| {
            let blobs = blobs.clone();
            let chunks = bytes.chunks(3).map(|chunk| Ok::<_, String>(Bytes::from_static(chunk)));
            async move { blobs.keep(futures::stream::iter(chunks), limit).await }
        };
        let hash = AssetHash::of(b"some bytes");
        assert!(matches!(keep(b"some bytes", 9).await, Err(BlobError::TooLarge(9))));
        assert_eq!(blobs.size(hash).await.unwrap(), None);
        for _ in 0..2 {
            assert_eq!(keep(b"some bytes", 10).await.unwrap(), (hash, 10));
            assert_eq!(blobs.read(hash, 10).await.unwrap().unwrap(), "some bytes");
        }
        let left = std::fs::read_dir(folder.path().join("incoming")).map_or(0, Iterator::count);
        assert_eq!(left, 0, "nothing stays on its way");
    }

    #[tokio::test]
    async fn an_upload_that_breaks_off_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::folder(folder.path()).unwrap();
        let hash = AssetHash::of(b"half");
        let chunks = futures::stream::iter([Ok(Bytes::from_static(b"ha")), Err("connection reset")]);
        assert!(matches!(blobs.put(hash, chunks, 100).await, Err(BlobError::BrokenOff(_))));
        assert_eq!(blobs.size(hash).await.unwrap(), None);
    }
}
