//! The service on a real socket: it answers, refuses an open address without a token, and leaves when told.

mod support;

use std::time::Duration;

use coordinator::{Config, serve};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::oneshot,
};

async fn request(stream: &mut TcpStream, path: &str) {
    let text = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n");
    stream.write_all(text.as_bytes()).await.unwrap();
}

async fn until(stream: &mut TcpStream, words: &str) -> String {
    let mut heard = Vec::new();
    let mut buffer = [0; 4096];
    loop {
        let n = stream.read(&mut buffer).await.unwrap();
        assert!(n > 0, "closed after {:?}", String::from_utf8_lossy(&heard));
        heard.extend(&buffer[..n]);
        let text = String::from_utf8_lossy(&heard);
        if text.contains(words) {
            return text.into_owned();
        }
    }
}

#[tokio::test]
async fn it_answers_and_leaves_when_told_though_somebody_listens() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let config = Config::new(folder.path());
    let service = tokio::spawn(serve(config.clone(), listener, async { drop(stopped.await) }));

    let mut stream = TcpStream::connect(address).await.unwrap();
    request(&mut stream, "/healthz").await;
    assert!(until(&mut stream, "ok\n").await.starts_with("HTTP/1.1 200"));
    request(&mut stream, "/").await;
    assert!(until(&mut stream, "</html>").await.contains("ui/app.js"));
    let mut listening = TcpStream::connect(address).await.unwrap();
    request(&mut listening, "/api/v1/events").await;
    until(&mut listening, "event: workers").await;

    stop.send(()).unwrap();
    tokio::time::timeout(Duration::from_secs(20), service).await.expect("it leaves").unwrap().unwrap();
    // And the folder is free for the next one.
    support::open(&config.data).await;
}

#[tokio::test]
async fn an_address_that_others_reach_is_refused_without_a_token() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("0.0.0.0:0").await.unwrap();
    let error = serve(Config::new(folder.path()), listener, std::future::pending()).await.unwrap_err();
    assert!(error.to_string().contains("set a token"), "{error}");
}

#[tokio::test]
async fn what_a_pass_takes_on_disk_is_less_than_what_it_is_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let app = support::open(folder.path()).await;
    let job = serde_json::json!({
        "scene": support::scene(), "resolution": [256, 256], "quality": { "target": "samples", "samples": 256 },
        "method": { "direct": "mis" },
    });
    support::submit(&app, job).await;
    support::Worker::register(&app, "a").await.work(&app, usize::MAX).await;
    let path = folder.path().join("tessera.sqlite");
    let wal = std::fs::metadata(path.with_extension("sqlite-wal")).map_or(0, |file| file.len());
    let bytes = std::fs::metadata(path).unwrap().len() + wal;
    let pixels = 256 * 256;
    println!("{:.1} bytes a pixel, the log of four passes included", bytes as f64 / f64::from(pixels));
    // Random pixels hardly compress: 24 to 40 bytes a pixel and pass, and pages that are rewritten.
    assert!(bytes < 300 * u64::from(pixels as u32), "{bytes}");
}
