//! A page in the browser, and what to wait for in it. Every wait is for a condition.

use std::{
    net::TcpListener,
    process::{Child, Command, Stdio},
    sync::Arc,
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use tempfile::TempDir;
use thirtyfour::prelude::*;

/// Longest wait for anything; far more than it takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// chromedriver, and where it listens.
pub struct Driver {
    process: Child,
    url: String,
}

impl Driver {
    /// Start chromedriver; `None` where there is none.
    pub async fn start() -> Option<Self> {
        let port = TcpListener::bind("127.0.0.1:0").ok()?.local_addr().ok()?.port();
        let mut command = Command::new("chromedriver");
        command.arg(format!("--port={port}")).stdout(Stdio::null()).stderr(Stdio::null());
        let process = command.spawn().ok()?;
        Some(Driver { process, url: format!("http://127.0.0.1:{port}") })
    }

    /// A fresh browser with a profile of its own.
    pub async fn open(&self) -> Page {
        let profile = tempfile::tempdir().unwrap();
        let mut wishes = DesiredCapabilities::chrome();
        for flag in [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--disable-dev-shm-usage",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--window-size=1600,1000",
            &format!("--user-data-dir={}", profile.path().display()),
        ] {
            wishes.add_arg(flag).unwrap();
        }
        let began = Instant::now();
        loop {
            match WebDriver::new(&self.url, wishes.clone()).await {
                Ok(browser) => return Page { browser, _profile: Arc::new(profile) },
                Err(error) => assert!(began.elapsed() < PATIENCE, "no browser: {error}"),
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    pub fn stop(mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A browser with the dashboard in it.
#[derive(Clone)]
pub struct Page {
    browser: WebDriver,
    _profile: Arc<TempDir>,
}

impl Page {
    pub async fn goto(&self, url: &str) {
        self.browser.goto(url).await.unwrap();
    }

    /// Run a script; `arguments[0]`, ... are the arguments, and what it returns is returned.
    pub async fn run(&self, script: &str, arguments: Vec<Value>) -> Value {
        self.browser.execute(script, arguments).await.unwrap_or_else(|error| panic!("{script}: {error}")).json().clone()
    }

    /// Wait until a JavaScript expression is true; the last value, and the page, are told if it never is.
    pub async fn until(&self, expression: &str) {
        let began = Instant::now();
        loop {
            let found = self.run(&format!("return {expression}"), vec![]).await;
            if found == json!(true) {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "never true: {expression}: {found}\n{}", self.text("body").await);
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Text of the first element that a selector finds; empty where there is none.
    pub async fn text(&self, selector: &str) -> String {
        let found =
            self.run("return document.querySelector(arguments[0])?.innerText ?? ''", vec![json!(selector)]).await;
        found.as_str().unwrap_or_default().to_owned()
    }

    /// Wait until the text of an element holds these words, in sight or scrolled away.
    pub async fn says(&self, selector: &str, words: &str) {
        let (selector, words) = (json!(selector), json!(words));
        self.until(&format!("!!document.querySelector({selector})?.textContent.includes({words})")).await;
    }

    /// Press what a selector finds, as a person does: it must be there, in sight and not covered.
    pub async fn press(&self, selector: &str) {
        let there = json!(selector);
        self.until(&format!("!!document.querySelector({there}) && document.querySelector({there}).checkVisibility()"))
            .await;
        let found = self.browser.find(By::Css(selector)).await.unwrap();
        found.scroll_into_view().await.unwrap();
        found.click().await.unwrap_or_else(|error| panic!("{selector}: {error}"));
    }

    pub async fn accept(&self) {
        self.browser.accept_alert().await.unwrap();
    }

    pub async fn size(&self, width: u32, height: u32) {
        self.browser.set_window_rect(0, 0, width, height).await.unwrap();
    }

    /// Prefer light or dark colours, as the system would.
    pub async fn scheme(&self, scheme: &str) {
        // Chromium's own command: WebDriver has none for it.
        let features = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        let path = format!("session/{}/goog/cdp/execute", self.browser.session_id());
        let url = self.browser.server_url().join(&path).unwrap();
        let body = json!({ "cmd": "Emulation.setEmulatedMedia", "params": features });
        let answer = reqwest::Client::new().post(url).json(&body).send().await.unwrap();
        assert!(answer.status().is_success(), "{}", answer.text().await.unwrap());
    }

    /// Keep a picture of the page where TESSERA_SCREENSHOTS says.
    pub async fn shoot(&self, name: &str) {
        if let Ok(folder) = std::env::var("TESSERA_SCREENSHOTS") {
            std::fs::create_dir_all(&folder).unwrap();
            self.browser.screenshot(&std::path::Path::new(&folder).join(format!("{name}.png"))).await.unwrap();
        }
    }

    pub async fn close(self) {
        // A browser that crashed is closed already.
        let _ = self.browser.quit().await;
    }
}
