//! The command `tessera`: options in, the other parts put to work, one sentence and an exit code out.
//!
//! It knows nothing that belongs to the other parts: how light travels, what is rendered next, what a
//! lease is.

mod args;
pub mod bench;
mod bundle;
mod chart;
pub mod compare;
mod config;
mod continued;
pub mod coverage;
mod error;
mod examples;
mod farm;
mod jobs;
mod left_out;
mod output;
mod parallel;
mod plan;
mod print;
mod progress;
pub mod reference;
mod render;
mod replay;
mod report;
mod request;
mod scene;
mod services;
mod signals;
mod soak;
pub mod stability;
mod submit;
mod watch;

use std::{io::IsTerminal, process::ExitCode};

use args::{Cli, Command, LogFormat};
use clap::{CommandFactory, FromArgMatches, error::ErrorKind};
use config::Config;
use error::Failure;
use tracing_subscriber::{EnvFilter, fmt::format::FmtSpan};

/// Run the command that the arguments of this process name.
///
/// Exit codes: 0 done, 1 the work, the network or a port failed, 2 the input was wrong, 130 Ctrl-C.
#[must_use]
pub fn main() -> ExitCode {
    let ended = match parse(examples::shown(Cli::command())) {
        Ok(cli) => Config::read(cli.config.as_deref()).map(|config| {
            // Once more, now that the defaults are known.
            parse(config.defaults(examples::shown(Cli::command()))).map(|cli| run(cli, &config))
        }),
        Err(error) => Ok(Err(error)),
    };
    match ended {
        Ok(Ok(Ok(()))) => ExitCode::SUCCESS,
        Ok(Err(error)) => refuse(&error),
        Ok(Ok(Err(failure))) | Err(failure) => {
            eprintln!("error: {failure}");
            failure.code()
        }
    }
}

/// Whether the words after `tessera` are a command that it takes.
///
/// # Errors
/// What clap says against them.
pub fn parses(words: &[&str]) -> Result<(), String> {
    let words = ["tessera"].iter().chain(words);
    Cli::command().try_get_matches_from(words).map(drop).map_err(|error| error.to_string())
}

fn parse(command: clap::Command) -> Result<Cli, clap::Error> {
    Cli::from_arg_matches(&command.try_get_matches()?)
}

fn run(cli: Cli, config: &Config) -> Result<(), Failure> {
    let service = matches!(cli.command, Command::Coordinator(_) | Command::Worker(_));
    log(cli.log.as_deref(), cli.log_format, service)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = runtime.map_err(|error| Failure::Work(format!("no threads to work with: {error}")))?;
    let ended = runtime.block_on(dispatch(cli.command, config));
    // Rows that are still on the way are of no interest to anybody.
    runtime.shutdown_background();
    ended
}

async fn dispatch(command: Command, config: &Config) -> Result<(), Failure> {
    match command {
        Command::Render(args) => render::render(args).await,
        Command::Coordinator(args) => services::coordinator(args).await,
        Command::Worker(args) => services::worker(args).await,
        Command::Submit(args) => submit::submit(args).await,
        Command::Jobs(args) => jobs::list(args).await,
        Command::Job(args) => jobs::show(args).await,
        Command::Cancel(args) => jobs::act(args, "cancel").await,
        Command::Pause(args) => jobs::act(args, "pause").await,
        Command::Resume(args) => jobs::act(args, "resume").await,
        Command::Continue(args) => continued::go_on(args).await,
        Command::Workers(args) => jobs::workers(args).await,
        Command::Scene(command) => scene::scene(command),
        Command::Chart(args) => chart::command(&args),
        Command::Plan(args) => plan::plan(&args),
        Command::Compare(args) => compare::command(&args),
        Command::Stability(args) => Ok(stability::command(args)?),
        Command::Soak(args) => soak::command(args),
        Command::Coverage(args) => coverage::command(args),
        Command::Bench(command) => bench::command(command),
        Command::Config(args) => config::show(&args, config),
        Command::Completions(args) => {
            let mut script = Vec::new();
            clap_complete::generate(args.shell, &mut Cli::command(), "tessera", &mut script);
            print::lines([String::from_utf8_lossy(&script).trim_end().to_string()])
        }
    }
}

/// Log to standard error: services from `info` on, commands from `warn` on.
fn log(filter: Option<&str>, format: LogFormat, service: bool) -> Result<(), Failure> {
    // What is odd about a scene has been said when it was read, before the worker reads it again.
    let default = if service { "info" } else { "warn,worker::scenes=error" };
    let filter = filter.filter(|filter| !filter.is_empty()).unwrap_or(default);
    let filter = EnvFilter::builder().parse(filter).map_err(|error| Failure::Input(format!("--log: {error}")))?;
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    if format == LogFormat::Json {
        let _ = builder.json().try_init();
        return Ok(());
    }
    let builder = builder.with_ansi(std::io::stderr().is_terminal());
    let builder = builder.with_span_events(FmtSpan::NONE).with_target(false);
    // It can be set once in a process, and this is the once.
    let _ = if service { builder.try_init() } else { builder.without_time().try_init() };
    Ok(())
}

/// What clap has to say: help as it is, a mistake as one sentence.
fn refuse(error: &clap::Error) -> ExitCode {
    if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
        // Nobody reads on if this fails.
        let _ = error.print();
        return ExitCode::SUCCESS;
    }
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let _ = error.print();
        return ExitCode::from(2);
    }
    let text = error.render().to_string();
    let sentence = text.split("\n\n").next().unwrap_or(&text);
    eprintln!("{}", sentence.split_whitespace().collect::<Vec<_>>().join(" "));
    ExitCode::from(2)
}
