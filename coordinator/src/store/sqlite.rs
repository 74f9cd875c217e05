//! The default store: one SQLite file in write-ahead mode, written by one task that commits in groups.
//!
//! While a group is being committed the next one gathers, so the cost of reaching the disk is shared by
//! all who wait. `synchronous=FULL`: a commit that was acknowledged survives the loss of power.

use std::{path::Path, time::Duration};

use bytes::Bytes;
use common::{
    job::{JobId, WorkerId},
    protocol::{AttemptView, Outcome},
    tile::Rect,
};
use futures::FutureExt;
use serde::{Serialize, de::DeserializeOwned};
use sqlx::{
    Row, SqliteConnection, SqlitePool,
    sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteRow, SqliteSynchronous},
};
use tokio::sync::{mpsc, oneshot};

use super::{
    Answer, AttemptQuery, KEPT_ATTEMPTS, Snapshot, Store, StoreError, StoredFilm, StoredPart, StoredTile,
    TRIMMED_EVERY, TileRecord, Write,
};
use crate::farm::TileKey;

/// Most writes of a group, and about the most bytes.
const GROUP_WRITES: usize = 4096;
const GROUP_BYTES: usize = 32 << 20;

/// See the module's documentation.
#[derive(Debug, Clone)]
pub struct SqliteStore {
    readers: SqlitePool,
    writer: mpsc::UnboundedSender<Queued>,
}

#[derive(Debug)]
struct Queued {
    write: Write,
    close: bool,
    done: oneshot::Sender<Result<(), StoreError>>,
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        StoreError::Failed(error.to_string())
    }
}

impl From<serde_json::Error> for StoreError {
    fn from(error: serde_json::Error) -> Self {
        StoreError::Damaged(error.to_string())
    }
}

impl SqliteStore {
    /// Open the file, make it if need be, and bring its schema up to date.
    ///
    /// # Errors
    /// The file cannot be opened, or was written by a newer version.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(Duration::from_secs(30))
            .pragma("cache_size", "-16384");
        let own = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
        sqlx::migrate!("./migrations").run(&own).await.map_err(|error| StoreError::Failed(error.to_string()))?;
        let readers = SqlitePoolOptions::new().max_connections(4).connect_with(options).await?;
        let (writer, queue) = mpsc::unbounded_channel();
        tokio::spawn(write_groups(own, queue));
        Ok(SqliteStore { readers, writer })
    }

    fn queue(&self, write: Write, close: bool) -> Answer<()> {
        let (done, answer) = oneshot::channel();
        let sent = self.writer.send(Queued { write, close, done });
        async move {
            sent.map_err(|_| StoreError::Closed)?;
            answer.await.unwrap_or(Err(StoreError::Closed))
        }
        .boxed()
    }
}

/// Gather, commit, answer, until told to close or nobody is left to ask.
async fn write_groups(pool: SqlitePool, mut queue: mpsc::UnboundedReceiver<Queued>) {
    while let Some(first) = queue.recv().await {
        let mut bytes = first.write.size();
        let mut group = vec![first];
        while group.len() < GROUP_WRITES
            && bytes < GROUP_BYTES
            && let Ok(next) = queue.try_recv()
        {
            bytes += next.write.size();
            group.push(next);
        }
        let result = commit(&pool, &group).await;
        if let Err(error) = &result {
            tracing::error!(%error, writes = group.len(), "a group of writes could not be committed");
        }
        let close = group.iter().any(|queued| queued.close);
        for queued in group {
            // Nobody may be waiting any more: the write stands all the same.
            let _ = queued.done.send(result.clone());
        }
        if close {
            break;
        }
    }
    pool.close().await;
}

async fn commit(pool: &SqlitePool, group: &[Queued]) -> Result<(), StoreError> {
    if group.iter().all(|queued| matches!(queued.write, Write::Barrier)) {
        return Ok(());
    }
    let mut transaction = pool.begin().await?;
    for queued in group {
        apply(&mut transaction, &queued.write).await?;
    }
    Ok(transaction.commit().await?)
}

async fn apply(db: &mut SqliteConnection, write: &Write) -> Result<(), StoreError> {
    match write {
        Write::Job(record) => {
            let id = record.id.0 as i64;
            sqlx::query(
                "INSERT INTO jobs (id, record) VALUES (?, ?) ON CONFLICT (id) DO UPDATE SET record = excluded.record",
            )
            .bind(id)
            .bind(json(record)?)
            .execute(&mut *db)
            .await?;
            sqlx::query("INSERT INTO meta (name, value) VALUES ('next_job', ?) ON CONFLICT (name) DO UPDATE SET value = max(value, excluded.value)")
                .bind(id + 1)
                .execute(db)
                .await?;
        }
        Write::DeleteJob(id) => {
            let id = id.0 as i64;
            sqlx::query("DELETE FROM jobs WHERE id = ?").bind(id).execute(&mut *db).await?;
            sqlx::query("DELETE FROM tiles WHERE job = ?").bind(id).execute(&mut *db).await?;
            sqlx::query("DELETE FROM attempts WHERE job = ?").bind(id).execute(&mut *db).await?;
            sqlx::query("DELETE FROM parts WHERE job = ?").bind(id).execute(db).await?;
        }
        Write::Tile { key, record, film, ring } => {
            let (job, frame, tile) = columns(key);
            sqlx::query(
                "INSERT INTO tiles (job, frame, tile, record, film, ring)
                 SELECT ?1, ?2, ?3, ?4, ?5, ?6 WHERE EXISTS (SELECT 1 FROM jobs WHERE id = ?1)
                 ON CONFLICT (job, frame, tile) DO UPDATE
                 SET record = excluded.record, film = excluded.film, ring = excluded.ring
                 WHERE tiles.record ->> 'passes' < excluded.record ->> 'passes'",
            )
            .bind(job)
            .bind(frame)
            .bind(tile)
            .bind(json(record)?)
            .bind(&film[..])
            .bind(ring.as_deref())
            .execute(&mut *db)
            .await?;
            sqlx::query("DELETE FROM parts WHERE job = ? AND frame = ? AND tile = ? AND pass < ?")
                .bind(job)
                .bind(frame)
                .bind(tile)
                .bind(i64::from(record.passes))
                .execute(db)
                .await?;
        }
        Write::Finished(key) => {
            let (job, frame, tile) = columns(key);
            sqlx::query("UPDATE tiles SET record = json_set(record, '$.finished', json('true'), '$.share', 1.0) WHERE job = ? AND frame = ? AND tile = ?")
                .bind(job)
                .bind(frame)
                .bind(tile)
                .execute(db)
                .await?;
        }
        Write::Summaries(summaries) => {
            for (key, summary) in summaries {
                let (job, frame, tile) = columns(key);
                sqlx::query("UPDATE tiles SET record = json_set(record, '$.summary', json(?)) WHERE job = ? AND frame = ? AND tile = ?")
                    .bind(json(summary)?)
                    .bind(job)
                    .bind(frame)
                    .bind(tile)
                    .execute(&mut *db)
                    .await?;
            }
        }
        Write::Reopen(job) => {
            sqlx::query("UPDATE tiles SET record = json_set(record, '$.finished', json('false')) WHERE job = ?")
                .bind(job.0 as i64)
                .execute(db)
                .await?;
        }
        Write::Resume { job, frame, passes } => {
            sqlx::query("UPDATE tiles SET record = json_set(record, '$.passes', ?, '$.finished', json('false'), '$.fresh', json('true')) WHERE job = ? AND frame = ?")
                .bind(i64::from(*passes))
                .bind(job.0 as i64)
                .bind(i64::from(*frame))
                .execute(&mut *db)
                .await?;
            sqlx::query("DELETE FROM parts WHERE job = ? AND frame = ?")
                .bind(job.0 as i64)
                .bind(i64::from(*frame))
                .execute(db)
                .await?;
        }
        Write::Part { key, pass, rect, split, result } => {
            let (job, frame, tile) = columns(key);
            sqlx::query(
                "INSERT OR IGNORE INTO parts (job, frame, tile, pass, x, y, w, h, split, result)
                 SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10 WHERE EXISTS (SELECT 1 FROM jobs WHERE id = ?1)",
            )
            .bind(job)
            .bind(frame)
            .bind(tile)
            .bind(i64::from(*pass))
            .bind(i64::from(rect.x))
            .bind(i64::from(rect.y))
            .bind(i64::from(rect.w))
            .bind(i64::from(rect.h))
            .bind(*split as i64)
            .bind(&result[..])
            .execute(db)
            .await?;
        }
        Write::Attempt(number, attempt) => {
            let (job, number) = (attempt.unit.job.0 as i64, *number);
            sqlx::query(
                "INSERT OR IGNORE INTO attempts (job, number, frame, tile, outcome, record)
                 SELECT ?1, ?2, ?3, ?4, ?5, ?6 WHERE EXISTS (SELECT 1 FROM jobs WHERE id = ?1)",
            )
            .bind(job)
            .bind(number as i64)
            .bind(i64::from(attempt.unit.frame))
            .bind(i64::from(attempt.unit.tile))
            .bind(attempt.outcome.name())
            .bind(json(attempt)?)
            .execute(&mut *db)
            .await?;
            if number.is_multiple_of(TRIMMED_EVERY) {
                sqlx::query(
                    "DELETE FROM attempts WHERE job = ?1 AND number <=
                     (SELECT number FROM attempts WHERE job = ?1 ORDER BY number DESC LIMIT 1 OFFSET ?2)",
                )
                .bind(job)
                .bind(KEPT_ATTEMPTS as i64)
                .execute(db)
                .await?;
            }
        }
        Write::Moments(moments, oldest) => {
            for moment in moments {
                sqlx::query("INSERT OR REPLACE INTO moments (at, record) VALUES (?, ?)")
                    .bind(moment.at)
                    .bind(json(moment)?)
                    .execute(&mut *db)
                    .await?;
            }
            sqlx::query("DELETE FROM moments WHERE at < ?").bind(oldest).execute(db).await?;
        }
        Write::Worker(id, record) => {
            sqlx::query("INSERT INTO workers (id, record) VALUES (?, ?) ON CONFLICT (id) DO UPDATE SET record = excluded.record")
                .bind(id.0 as i64)
                .bind(json(record)?)
                .execute(db)
                .await?;
        }
        Write::Barrier => {}
    }
    Ok(())
}

fn columns(key: &TileKey) -> (i64, i64, i64) {
    (key.job.0 as i64, i64::from(key.frame), i64::from(key.tile))
}

fn json<T: Serialize>(record: &T) -> Result<String, StoreError> {
    Ok(serde_json::to_string(record)?)
}

fn parse<T: DeserializeOwned>(row: &SqliteRow, column: &str) -> Result<T, StoreError> {
    let text: &str = row.try_get(column)?;
    Ok(serde_json::from_str(text)?)
}

fn number(row: &SqliteRow, column: &str) -> Result<u32, StoreError> {
    let value: i64 = row.try_get(column)?;
    u32::try_from(value).map_err(|_| StoreError::Damaged(format!("{column} {value}")))
}

fn rect(row: &SqliteRow) -> Result<Rect, StoreError> {
    Ok(Rect { x: number(row, "x")?, y: number(row, "y")?, w: number(row, "w")?, h: number(row, "h")? })
}

impl Store for SqliteStore {
    fn begin(&self) -> Answer<Snapshot> {
        let pool = self.readers.clone();
        async move {
            let mut db = pool.begin().await?;
            sqlx::query(
                "INSERT INTO meta (name, value) VALUES ('epoch', 1) ON CONFLICT (name) DO UPDATE SET value = value + 1",
            )
            .execute(&mut *db)
            .await?;
            let mut snapshot = Snapshot { next_job: 1, ..Snapshot::default() };
            for row in sqlx::query("SELECT name, value FROM meta").fetch_all(&mut *db).await? {
                let value: i64 = row.try_get("value")?;
                match row.try_get("name")? {
                    "epoch" => snapshot.epoch = value as u64,
                    "next_job" => snapshot.next_job = value as u64,
                    _ => {}
                }
            }
            for row in sqlx::query("SELECT record FROM jobs ORDER BY id").fetch_all(&mut *db).await? {
                snapshot.jobs.push(parse(&row, "record")?);
            }
            for row in sqlx::query("SELECT id, record FROM workers ORDER BY id").fetch_all(&mut *db).await? {
                let id: i64 = row.try_get("id")?;
                snapshot.workers.push((WorkerId(id as u64), parse(&row, "record")?));
            }
            for row in sqlx::query("SELECT record FROM moments ORDER BY at").fetch_all(&mut *db).await? {
                snapshot.moments.push(parse(&row, "record")?);
            }
            db.commit().await?;
            Ok(snapshot)
        }
        .boxed()
    }

    fn write(&self, write: Write) -> Answer<()> {
        self.queue(write, false)
    }

    fn tiles(&self, job: JobId) -> Answer<Vec<StoredTile>> {
        let pool = self.readers.clone();
        async move {
            let query = sqlx::query("SELECT frame, tile, record FROM tiles WHERE job = ? ORDER BY frame, tile");
            let rows = query.bind(job.0 as i64).fetch_all(&pool).await?;
            let tile = |row: &SqliteRow| {
                let key = TileKey { job, frame: number(row, "frame")?, tile: number(row, "tile")? };
                Ok(StoredTile { key, record: parse::<TileRecord>(row, "record")? })
            };
            rows.iter().map(tile).collect()
        }
        .boxed()
    }

    fn parts(&self, job: JobId) -> Answer<Vec<StoredPart>> {
        let pool = self.readers.clone();
        async move {
            let query = sqlx::query(
                "SELECT frame, tile, pass, x, y, w, h, split FROM parts WHERE job = ? ORDER BY frame, tile, pass, y, x",
            );
            let rows = query.bind(job.0 as i64).fetch_all(&pool).await?;
            let part = |row: &SqliteRow| {
                let key = TileKey { job, frame: number(row, "frame")?, tile: number(row, "tile")? };
                let split: i64 = row.try_get("split")?;
                Ok(StoredPart { key, pass: number(row, "pass")?, rect: rect(row)?, split: split as usize })
            };
            rows.iter().map(part).collect()
        }
        .boxed()
    }

    fn film(&self, key: TileKey) -> Answer<Option<StoredFilm>> {
        let pool = self.readers.clone();
        async move {
            let (job, frame, tile) = columns(&key);
            let query = sqlx::query("SELECT record, film, ring FROM tiles WHERE job = ? AND frame = ? AND tile = ?");
            let Some(row) = query.bind(job).bind(frame).bind(tile).fetch_optional(&pool).await? else {
                return Ok(None);
            };
            let film: Vec<u8> = row.try_get("film")?;
            let ring: Option<Vec<u8>> = row.try_get("ring")?;
            Ok(Some(StoredFilm { record: parse(&row, "record")?, film: film.into(), ring: ring.map(Bytes::from) }))
        }
        .boxed()
    }

    fn results(&self, key: TileKey, pass: u32) -> Answer<Vec<(Rect, Bytes)>> {
        let pool = self.readers.clone();
        async move {
            let (job, frame, tile) = columns(&key);
            let query = sqlx::query(
                "SELECT x, y, w, h, result FROM parts WHERE job = ? AND frame = ? AND tile = ? AND pass = ? ORDER BY y, x",
            );
            let rows = query.bind(job).bind(frame).bind(tile).bind(i64::from(pass)).fetch_all(&pool).await?;
            let part = |row: &SqliteRow| {
                let result: Vec<u8> = row.try_get("result")?;
                Ok((rect(row)?, result.into()))
            };
            rows.iter().map(part).collect()
        }
        .boxed()
    }

    fn attempts(&self, query: AttemptQuery) -> Answer<Vec<(u64, AttemptView)>> {
        let pool = self.readers.clone();
        async move {
            let AttemptQuery { job, frame, tile, outcome, before, limit } = query;
            let rows = sqlx::query(
                "SELECT number, record FROM attempts WHERE job = ?1 AND number < ?2 AND (?3 IS NULL OR frame = ?3)
                 AND (?4 IS NULL OR tile = ?4) AND (?5 IS NULL OR outcome = ?5) ORDER BY number DESC LIMIT ?6",
            )
            .bind(job.0 as i64)
            .bind(before.map_or(i64::MAX, |before| i64::try_from(before).unwrap_or(i64::MAX)))
            .bind(frame)
            .bind(tile)
            .bind(outcome.map(Outcome::name))
            .bind(limit as i64)
            .fetch_all(&pool)
            .await?;
            let attempt = |row: &SqliteRow| {
                let number: i64 = row.try_get("number")?;
                Ok((number as u64, parse(row, "record")?))
            };
            rows.iter().map(attempt).collect()
        }
        .boxed()
    }

    fn close(&self) -> Answer<()> {
        let (pool, closed) = (self.readers.clone(), self.queue(Write::Barrier, true));
        async move {
            closed.await?;
            pool.close().await;
            Ok(())
        }
        .boxed()
    }
}
