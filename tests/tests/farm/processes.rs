//! Processes of a farm, and how to look at them. Every wait is for a condition, and fails with the logs.

use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use common::{
    job::JobId,
    protocol::{JobView, WorkerList, WorkerView},
};
use reqwest::Method;
use serde::de::DeserializeOwned;
use worker::Endpoint;

/// Longest wait for anything; far more than it takes, as other tests run beside.
const PATIENCE: Duration = Duration::from_secs(120);
/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(20);

/// A file of the repository.
pub fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The command `tessera`, with nothing taken from the surroundings.
pub fn tessera(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tessera-under-test"));
    for (variable, _) in std::env::vars().filter(|(name, _)| name.starts_with("TESSERA_") || name == "RUST_LOG") {
        command.env_remove(variable);
    }
    // Nor from the user's settings.
    command.env("XDG_CONFIG_HOME", "/nonexistent");
    command.args(arguments);
    command
}

/// Run a command to its end and hold it to success.
pub fn succeed(arguments: &[&str]) -> Output {
    let output = tessera(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Look until there is something to see.
pub async fn wait<T>(what: &str, mut look: impl AsyncFnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = look().await {
            return found;
        }
        assert!(start.elapsed() < PATIENCE, "never came: {what}");
        tokio::time::sleep(LOOK).await;
    }
}

/// A process that is killed when the test is done with it.
pub struct Process {
    child: Child,
    log: Arc<Mutex<String>>,
}

impl Process {
    pub fn start(arguments: &[&str]) -> Self {
        Self::of(tessera(arguments))
    }

    pub fn of(mut command: Command) -> Self {
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let log = Arc::new(Mutex::new(String::new()));
        let (lines, copy) = (BufReader::new(child.stderr.take().unwrap()), Arc::clone(&log));
        std::thread::spawn(move || {
            for line in lines.lines().map_while(Result::ok) {
                *copy.lock().unwrap() += &format!("{line}\n");
            }
        });
        Self { child, log }
    }

    pub fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// SIGKILL.
    pub fn kill(&mut self) {
        assert!(self.child.try_wait().unwrap().is_none(), "it had ended before: {}", self.log());
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Send a signal by name.
    pub fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args(["-s", name, &pid]).status().unwrap().success());
    }

    /// Wait for the end; the exit code.
    pub async fn code(&mut self) -> i32 {
        let status = wait("the end of a process", async || self.child.try_wait().unwrap()).await;
        status.code().unwrap_or_else(|| panic!("{status}: {}", self.log()))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            eprintln!("--- {}", self.log());
        }
    }
}

/// A coordinator in a process of its own.
pub struct Coordinator {
    pub process: Process,
    pub url: String,
    endpoint: Endpoint,
    data: PathBuf,
}

impl Coordinator {
    pub async fn start(data: &Path) -> Self {
        Self::listen(data, "127.0.0.1:0").await
    }

    async fn listen(data: &Path, address: &str) -> Self {
        let process = Process::start(&["coordinator", "--listen", address, "--data", data.to_str().unwrap()]);
        let url = wait("the coordinator's address", async || {
            let log = process.log();
            let address = log.split_once("listening on ")?.1.split_whitespace().next()?;
            Some(address.trim_end_matches('/').to_string())
        })
        .await;
        let endpoint = Endpoint::new(&url, None).unwrap();
        Self { process, url, endpoint, data: data.into() }
    }

    /// SIGKILL, then a new one at the same place.
    pub async fn kill_and_restart(&mut self) {
        self.process.kill();
        self.restart().await;
    }

    /// A new one in the place of one that was killed.
    pub async fn restart(&mut self) {
        let address = self.url.trim_start_matches("http://").to_string();
        *self = Self::listen(&self.data.clone(), &address).await;
    }

    pub fn worker(&self, name: &str) -> Process {
        Process::start(&["worker", "--coordinator", &self.url, "--threads", "1", "--name", name])
    }

    /// What is at a path, if there is anything.
    pub async fn get<T: DeserializeOwned>(&self, path: &str) -> Option<T> {
        self.endpoint.fetch(self.endpoint.request(Method::GET, path)).await.ok()
    }

    pub async fn job(&self, id: JobId) -> JobView {
        wait("the job", async || self.get(&format!("/jobs/{id}")).await).await
    }

    /// The job when it satisfies something.
    pub async fn job_when(&self, id: JobId, what: &str, mut is: impl FnMut(&JobView) -> bool) -> JobView {
        wait(what, async || Some(self.job(id).await).filter(|job| is(job))).await
    }

    /// The worker of that name.
    pub async fn named(&self, name: &str) -> WorkerView {
        wait("the worker", async || {
            let list: WorkerList = self.get("/workers").await?;
            list.workers.into_iter().find(|worker| worker.machine == name)
        })
        .await
    }

    /// The only job there is.
    pub async fn the_job(&self) -> JobId {
        wait("a job", async || {
            let list: common::protocol::JobList = self.get("/jobs").await?;
            list.jobs.first().map(|job| job.id)
        })
        .await
    }
}

/// All channels of an EXR file: their names, and the bits of their pixels.
pub fn pixels(path: &Path) -> Vec<(String, Vec<u32>)> {
    use exr::prelude::{ReadChannels, ReadLayers, read};
    let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let image = image.from_file(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let channels = &image.layer_data.channel_data.list;
    channels
        .iter()
        .map(|channel| {
            let bits = channel.sample_data.values_as_f32().map(f32::to_bits).collect();
            (channel.name.to_string(), bits)
        })
        .collect()
}
