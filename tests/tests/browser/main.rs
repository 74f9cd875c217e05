//! The dashboard in a real browser: headless Chromium, spoken to through chromedriver.
//!
//! Needs `chromedriver` and Chromium (`.ci/browser` installs both); where there is none, it says so and checks nothing.
//! TESSERA_BROWSER=required makes that an error. TESSERA_AXE names axe-core's axe.min.js for the accessibility check,
//! TESSERA_SCREENSHOTS a folder for pictures of the pages.

mod checks;
mod page;
#[path = "../farm/processes.rs"]
#[allow(dead_code, reason = "the tests of the farm use the rest")]
mod processes;

use std::{process::ExitCode, time::Instant};

use page::Driver;

#[tokio::main]
async fn main() -> ExitCode {
    tokio::task::LocalSet::new().run_until(all()).await
}

async fn all() -> ExitCode {
    let required = std::env::var("TESSERA_BROWSER").is_ok_and(|value| value == "required");
    let Some(driver) = Driver::start().await else {
        eprintln!(
            "\n*** SKIPPED: the dashboard was not looked at in a browser, for there is no chromedriver: run .ci/browser\n"
        );
        return ExitCode::from(u8::from(required));
    };
    let only = std::env::args().nth(1).filter(|name| !name.starts_with('-'));
    let (mut passed, mut failed) = (0, 0);
    for (name, check) in checks::ALL {
        if only.as_ref().is_some_and(|only| !name.contains(only.as_str())) {
            continue;
        }
        let (began, page) = (Instant::now(), driver.open().await);
        let ended = tokio::task::spawn_local(check(page.clone())).await;
        let seconds = began.elapsed().as_secs_f64();
        match ended {
            Ok(()) => passed += 1,
            Err(_) => {
                failed += 1;
                page.shoot(&format!("failed-{name}")).await;
                eprintln!("{}", page.text("body").await);
            }
        }
        println!("test browser::{name} ... {} ({seconds:.1} s)", if ended.is_ok() { "ok" } else { "FAILED" });
        page.close().await;
    }
    driver.stop();
    let verdict = if failed == 0 { "ok" } else { "FAILED" };
    println!("\ntest result: {verdict}. {passed} passed; {failed} failed; 0 ignored");
    ExitCode::from(u8::from(failed > 0))
}
