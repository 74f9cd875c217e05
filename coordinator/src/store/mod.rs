//! What must survive a restart: jobs, films, parts of passes, workers.
//!
//! A [`Store`] knows nothing of scheduling or HTTP. A write is durable when its future resolves; writes
//! take effect in the order of the calls. Every implementation passes the suite in [`conformance`].

#[cfg(test)]
mod conformance;
pub mod film;
#[cfg(test)]
mod memory;
mod record;
mod sqlite;

use bytes::Bytes;
use common::{
    job::{JobId, WorkerId},
    protocol::{AttemptView, FarmMoment, Outcome},
    tile::Rect,
};
use futures::future::BoxFuture;

#[cfg(test)]
pub use memory::MemoryStore;
pub use record::{JobRecord, Once, TileRecord, TileSummary, WorkRecord, WorkerRecord};
pub use sqlite::SqliteStore;

use crate::farm::TileKey;

/// Why a store could not do its work.
#[derive(Debug, Clone, thiserror::Error)]
pub enum StoreError {
    /// The store itself failed: disk full, file gone.
    #[error("the store failed: {0}")]
    Failed(String),
    /// What is stored cannot be read.
    #[error("the store holds something that cannot be read: {0}")]
    Damaged(String),
    /// The store is shut down.
    #[error("the store is closed")]
    Closed,
}

/// Attempts at units that are kept of a job, at least.
pub const KEPT_ATTEMPTS: usize = 50_000;
/// Attempts between two times that the oldest go.
const TRIMMED_EVERY: u64 = 1024;

/// Something to be written.
#[derive(Debug, Clone)]
pub enum Write {
    /// A job, new or changed.
    Job(Box<JobRecord>),
    /// Forget a job, its tiles, parts and attempts.
    DeleteJob(JobId),
    /// The merged film of a tile; the parts of earlier passes are dropped. Ignored when its job is gone, and
    /// when the tile has as many passes or more.
    Tile {
        /// The tile.
        key: TileKey,
        /// How far it is and what it cost.
        record: Box<TileRecord>,
        /// Its film, as [`film::encode`] makes it.
        film: Bytes,
        /// The border of its film one pass ago, where the job's rule looks across borders.
        ring: Option<Bytes>,
    },
    /// The rule said that a tile is finished.
    Finished(TileKey),
    /// The tiles of a finished frame in short, in place of what their records say.
    Summaries(Vec<(TileKey, TileSummary)>),
    /// A higher fixed count: no tile of the job is finished any more.
    Reopen(JobId),
    /// A finer target, or another round of a frame: its tiles stand at the end of the same pass, none is
    /// finished, and no pixel has stopped.
    Resume {
        /// The job.
        job: JobId,
        /// The frame.
        frame: u32,
        /// Passes that its tiles count as having from now on.
        passes: u32,
    },
    /// A part of a pass, as it was sent. Ignored when its job is gone.
    Part {
        /// The tile.
        key: TileKey,
        /// The pass.
        pass: u32,
        /// The part's pixels.
        rect: Rect,
        /// Size of the split, pixels.
        split: usize,
        /// The result, compressed.
        result: Bytes,
    },
    /// An attempt at a unit; attempts of a job have ascending numbers. Ignored when its job is gone. Of each job the
    /// last [`KEPT_ATTEMPTS`] are kept, and perhaps some more.
    Attempt(u64, Box<AttemptView>),
    /// Moments of the farm, and when the oldest was that is kept, Unix seconds.
    Moments(Vec<FarmMoment>, f64),
    /// A worker, new or changed.
    Worker(WorkerId, Box<WorkerRecord>),
    /// Nothing: durable when everything before it is.
    Barrier,
}

impl Write {
    /// Bytes of the payload, for the size of a group.
    fn size(&self) -> usize {
        match self {
            Write::Tile { film, ring, .. } => film.len() + ring.as_ref().map_or(0, Bytes::len),
            Write::Part { result, .. } => result.len(),
            Write::Summaries(summaries) => 512 * summaries.len(),
            Write::Moments(moments, _) => 128 * moments.len(),
            _ => 256,
        }
    }
}

/// A tile as it is stored, without its film.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredTile {
    /// The tile.
    pub key: TileKey,
    /// How far it is and what it cost.
    pub record: TileRecord,
}

/// Which part of a pass is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredPart {
    /// The tile.
    pub key: TileKey,
    /// The pass.
    pub pass: u32,
    /// The part's pixels.
    pub rect: Rect,
    /// Size of the split, pixels.
    pub split: usize,
}

/// Which attempts at a job's units are wanted: all that fit, newest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttemptQuery {
    /// The job.
    pub job: JobId,
    /// Only of this frame.
    pub frame: Option<u32>,
    /// Only of tiles with this index.
    pub tile: Option<u32>,
    /// Only those that ended so.
    pub outcome: Option<Outcome>,
    /// Only those with a lower number.
    pub before: Option<u64>,
    /// Most of them.
    pub limit: usize,
}

/// Everything but films and results.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Snapshot {
    /// The jobs, oldest first.
    pub jobs: Vec<JobRecord>,
    /// The workers, oldest first.
    pub workers: Vec<(WorkerId, WorkerRecord)>,
    /// The number of the next job: no number is given twice.
    pub next_job: u64,
    /// How often the store was begun, this time included.
    pub epoch: u64,
    /// How the farm was, oldest first.
    pub moments: Vec<FarmMoment>,
}

/// The film of a tile as it is stored.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredFilm {
    /// How far it is and what it cost.
    pub record: TileRecord,
    /// The film, as [`film::encode`] makes it.
    pub film: Bytes,
    /// The border of the film one pass ago.
    pub ring: Option<Bytes>,
}

/// A store's answer.
pub type Answer<T> = BoxFuture<'static, Result<T, StoreError>>;

/// A durable record of the farm.
pub trait Store: Send + Sync + 'static {
    /// Count this start, and read everything but films and results.
    fn begin(&self) -> Answer<Snapshot>;

    /// Queue a write. It takes effect even if the future is dropped; it is durable when the future is ready.
    fn write(&self, write: Write) -> Answer<()>;

    /// The tiles of a job, in order of frame and index.
    fn tiles(&self, job: JobId) -> Answer<Vec<StoredTile>>;

    /// The parts of a job's passes that are not merged, in order of frame, tile, pass, row.
    fn parts(&self, job: JobId) -> Answer<Vec<StoredPart>>;

    /// A tile's film.
    fn film(&self, key: TileKey) -> Answer<Option<StoredFilm>>;

    /// The results of the parts of a tile's pass, in row order.
    fn results(&self, key: TileKey, pass: u32) -> Answer<Vec<(Rect, Bytes)>>;

    /// Attempts at units, newest first, with their numbers.
    fn attempts(&self, query: AttemptQuery) -> Answer<Vec<(u64, AttemptView)>>;

    /// Finish what is queued and let go of the files.
    fn close(&self) -> Answer<()>;
}
