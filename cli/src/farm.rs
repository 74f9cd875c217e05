//! A farm's REST API as the commands use it.

use std::{collections::BTreeMap, time::Duration};

use bytes::Bytes;
use common::{
    hash::AssetHash,
    job::{JobId, JobRequest},
    protocol::{JobList, JobPatch, JobView, WorkerList},
};
use reqwest::{Method, StatusCode};
use worker::{CallError, Endpoint, endpoint::transfer_timeout, link::Link};

use crate::{args::ConnectArgs, error::Failure};

/// Pause between two looks at a job.
const LOOK: Duration = Duration::from_millis(100);

/// A farm.
#[derive(Debug)]
pub struct Farm {
    link: Link,
}

impl Farm {
    /// The farm that the options name.
    ///
    /// # Errors
    /// An address or token that cannot be used.
    pub fn connect(args: &ConnectArgs) -> Result<Self, Failure> {
        Self::at(&args.coordinator, token(args.token_file.as_deref())?.as_deref())
    }

    /// The farm at `url`.
    ///
    /// # Errors
    /// An address or token that cannot be used.
    pub fn at(url: &str, token: Option<&str>) -> Result<Self, Failure> {
        Ok(Self { link: Link::new(endpoint(url, token)?) })
    }

    /// Address of the status page.
    #[must_use]
    pub fn url(&self) -> &str {
        self.link.endpoint.url()
    }

    /// Send the files that the farm lacks, then the job.
    ///
    /// # Errors
    /// The farm is away, or refuses a file or the job.
    pub async fn submit(&self, request: &JobRequest, assets: &BTreeMap<AssetHash, Bytes>) -> Result<JobView, Failure> {
        for (hash, bytes) in assets {
            if !self.has(*hash).await? {
                self.put(*hash, bytes).await?;
            }
        }
        match self.post(request).await {
            // Files may go between the look and the job: they were not anybody's yet.
            Err(CallError::Refused { status: 409, error }) if !error.missing.is_empty() => {
                for hash in &error.missing {
                    let bytes = assets.get(hash).ok_or_else(|| {
                        Failure::Work(format!("the farm asks for {hash}, which is not a file of the scene"))
                    })?;
                    self.put(*hash, bytes).await?;
                }
                Ok(self.post(request).await?)
            }
            answer => Ok(answer?),
        }
    }

    async fn post(&self, request: &JobRequest) -> Result<JobView, CallError> {
        let endpoint = &self.link.endpoint;
        endpoint.fetch(endpoint.request(Method::POST, "/jobs").json(request)).await
    }

    async fn has(&self, hash: AssetHash) -> Result<bool, Failure> {
        let endpoint = &self.link.endpoint;
        // The answer to HEAD has no body that could say more than the status.
        let answer = endpoint.request(Method::HEAD, &format!("/assets/{hash}")).send().await;
        let status = answer.map_err(|error| endpoint.unreachable(&error))?.status();
        match status {
            StatusCode::NOT_FOUND => Ok(false),
            _ if status.is_success() => Ok(true),
            // Let the upload find out, and say why.
            _ => Ok(false),
        }
    }

    async fn put(&self, hash: AssetHash, bytes: &Bytes) -> Result<(), CallError> {
        let endpoint = &self.link.endpoint;
        let request = endpoint.request(Method::PUT, &format!("/assets/{hash}")).body(bytes.clone());
        endpoint.send(request.timeout(transfer_timeout(bytes.len()))).await.map(drop)
    }

    /// A job as it stands.
    ///
    /// # Errors
    /// The farm is away, or has no such job.
    pub async fn job(&self, id: JobId) -> Result<JobView, CallError> {
        let endpoint = &self.link.endpoint;
        endpoint.fetch(endpoint.request(Method::GET, &format!("/jobs/{id}"))).await
    }

    /// Follow a job to its end. A farm that is away is waited for.
    ///
    /// # Errors
    /// The farm no longer has the job.
    pub async fn follow(&self, id: JobId, mut look: impl FnMut(&JobView)) -> Result<JobView, CallError> {
        loop {
            let job = self.link.persist(|| self.job(id)).await?;
            look(&job);
            if job.state.is_final() {
                return Ok(job);
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// `cancel`, `pause` or `resume` a job.
    ///
    /// # Errors
    /// The farm is away, has no such job, or cannot do this to it now.
    pub async fn act(&self, id: JobId, action: &str) -> Result<JobView, CallError> {
        let endpoint = &self.link.endpoint;
        endpoint.send(endpoint.request(Method::POST, &format!("/jobs/{id}/{action}"))).await?;
        self.job(id).await
    }

    /// Change a job.
    ///
    /// # Errors
    /// The farm is away, has no such job, or refuses the change.
    pub async fn patch(&self, id: JobId, patch: &JobPatch) -> Result<JobView, CallError> {
        let endpoint = &self.link.endpoint;
        endpoint.fetch(endpoint.request(Method::PATCH, &format!("/jobs/{id}")).json(patch)).await
    }

    /// The newest jobs, `limit` at most.
    ///
    /// # Errors
    /// The farm is away.
    pub async fn jobs(&self, status: Option<&str>, limit: u32) -> Result<JobList, CallError> {
        let endpoint = &self.link.endpoint;
        let status = status.map_or(String::new(), |status| format!("&status={status}"));
        endpoint.fetch(endpoint.request(Method::GET, &format!("/jobs?limit={limit}{status}"))).await
    }

    /// The workers.
    ///
    /// # Errors
    /// The farm is away.
    pub async fn workers(&self) -> Result<WorkerList, CallError> {
        let endpoint = &self.link.endpoint;
        endpoint.fetch(endpoint.request(Method::GET, "/workers")).await
    }

    /// An image of a frame: `image.png`, `image.exr`, `samples.png`, `error.png`.
    ///
    /// # Errors
    /// The farm has no such image.
    pub async fn image(&self, id: JobId, frame: u32, name: &str) -> Result<Bytes, CallError> {
        let endpoint = &self.link.endpoint;
        let call = async || {
            let request = endpoint.request(Method::GET, &format!("/jobs/{id}/frames/{frame}/{name}"));
            let response = endpoint.send(request).await?;
            response.bytes().await.map_err(|error| endpoint.unreachable(&error))
        };
        self.link.persist(call).await
    }
}

/// The coordinator at `url`.
///
/// # Errors
/// An address or token that cannot be used.
pub fn endpoint(url: &str, token: Option<&str>) -> Result<Endpoint, Failure> {
    Endpoint::new(url, token).map_err(|error| Failure::Input(error.to_string()))
}

/// The farm's token: of the file, else of the variable TESSERA_TOKEN, else none.
///
/// # Errors
/// A file that cannot be read or is empty.
pub fn token(file: Option<&std::path::Path>) -> Result<Option<String>, Failure> {
    let Some(path) = file else {
        return Ok(std::env::var("TESSERA_TOKEN").ok().filter(|token| !token.is_empty()));
    };
    let text = std::fs::read_to_string(path).map_err(|error| Failure::file(path, &error))?;
    match text.trim() {
        "" => Err(Failure::Input(format!("{}: holds no token", path.display()))),
        token => Ok(Some(token.into())),
    }
}
