//! Settings by file, environment and options, with one precedence: an option, else the variable, else the
//! file, else the default. The file becomes the defaults of the command line, so that there is one place
//! where a value is read.

use std::{
    io::ErrorKind,
    net::SocketAddr,
    path::{Path, PathBuf},
};

use clap::Command;
use serde::{Deserialize, Serialize};

use crate::{args::ConfigArgs, error::Failure, print};

/// Names the file where the option `--config` does not.
const VARIABLE: &str = "TESSERA_CONFIG";

/// What the file may hold.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    coordinator: Option<String>,
    token_file: Option<PathBuf>,
    listen: Option<SocketAddr>,
    data: Option<PathBuf>,
    threads: Option<std::num::NonZeroU16>,
    cache: Option<PathBuf>,
    worker_name: Option<String>,
    log: Option<String>,
}

/// A setting of the file.
struct Setting {
    /// Its name in the file.
    name: &'static str,
    /// The option it is the default of.
    option: &'static str,
    /// Commands that take it; empty for all that have the option.
    commands: &'static [&'static str],
    /// The variable that goes before it.
    variable: &'static str,
    /// What holds without either, for people.
    default: &'static str,
    /// Its value in a file.
    of: fn(&File) -> Option<String>,
}

const SETTINGS: [Setting; 8] = [
    Setting {
        name: "coordinator",
        option: "coordinator",
        commands: &[],
        variable: "TESSERA_COORDINATOR",
        default: "http://127.0.0.1:7878",
        of: |file| file.coordinator.clone(),
    },
    Setting {
        name: "token_file",
        option: "token_file",
        commands: &[],
        variable: "TESSERA_TOKEN_FILE",
        default: "none: the variable TESSERA_TOKEN",
        of: |file| file.token_file.as_deref().map(shown),
    },
    Setting {
        name: "listen",
        option: "listen",
        commands: &["coordinator"],
        variable: "TESSERA_LISTEN",
        default: "127.0.0.1:7878",
        of: |file| file.listen.map(|address| address.to_string()),
    },
    Setting {
        name: "data",
        option: "data",
        commands: &["coordinator"],
        variable: "TESSERA_DATA",
        default: "tessera-data",
        of: |file| file.data.as_deref().map(shown),
    },
    Setting {
        name: "threads",
        option: "threads",
        commands: &["render", "worker"],
        variable: "TESSERA_THREADS",
        default: "all cores",
        of: |file| file.threads.map(|threads| threads.to_string()),
    },
    Setting {
        name: "cache",
        option: "cache",
        commands: &["worker"],
        variable: "TESSERA_CACHE",
        default: "none",
        of: |file| file.cache.as_deref().map(shown),
    },
    Setting {
        name: "worker_name",
        option: "name",
        commands: &["worker"],
        variable: "TESSERA_WORKER_NAME",
        default: "the host name",
        of: |file| file.worker_name.clone(),
    },
    Setting {
        name: "log",
        option: "log",
        commands: &[],
        variable: "RUST_LOG",
        default: "info for services, warn otherwise",
        of: |file| file.log.clone(),
    },
];

fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// A configuration file that was read, or the place where there is none.
#[derive(Debug)]
pub struct Config {
    path: Option<PathBuf>,
    read: bool,
    file: File,
}

impl Config {
    /// The file that the option or the variable names, else that of the user where there is one.
    ///
    /// # Errors
    /// A named file that is not there, or one that holds something else than settings.
    pub fn read(named: Option<&Path>) -> Result<Self, Failure> {
        let variable = std::env::var_os(VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from);
        let named = named.map(Path::to_path_buf).or(variable);
        let must_be = named.is_some();
        let path = named.or_else(|| Some(folder()?.join("tessera").join("config.toml")));
        let Some(path) = path else { return Ok(Self { path: None, read: false, file: File::default() }) };
        match std::fs::read_to_string(&path) {
            Ok(text) => Ok(Self { file: parse(&text, &path)?, path: Some(path), read: true }),
            Err(error) if error.kind() == ErrorKind::NotFound && !must_be => {
                Ok(Self { path: Some(path), read: false, file: File::default() })
            }
            Err(error) => Err(Failure::file(&path, &error)),
        }
    }

    /// The command line with the settings of the file as defaults.
    #[must_use]
    pub fn defaults(&self, mut command: Command) -> Command {
        for setting in &SETTINGS {
            let Some(value) = (setting.of)(&self.file) else { continue };
            if setting.option == "log" {
                command = command.mut_arg(setting.option, |arg| arg.default_value(value));
                continue;
            }
            let takes = |command: &Command| {
                (setting.commands.is_empty() || setting.commands.contains(&command.get_name()))
                    && command.get_arguments().any(|arg| arg.get_id() == setting.option)
            };
            let names: Vec<String> =
                command.get_subcommands().filter(|c| takes(c)).map(|c| c.get_name().into()).collect();
            for name in names {
                let value = value.clone();
                command =
                    command.mut_subcommand(name, |inner| inner.mut_arg(setting.option, |arg| arg.default_value(value)));
            }
        }
        command
    }

    fn settings(&self) -> Vec<Shown> {
        let shown = SETTINGS.iter().map(|setting| {
            let variable = std::env::var(setting.variable).ok().filter(|value| !value.is_empty());
            let (value, from) = match (variable, (setting.of)(&self.file)) {
                (Some(value), _) => (Some(value), setting.variable),
                (None, Some(value)) => (Some(value), "file"),
                (None, None) => (None, "default"),
            };
            Shown { name: setting.name, value, from, default: setting.default }
        });
        shown.collect()
    }
}

/// The folder in which the user keeps settings.
fn folder() -> Option<PathBuf> {
    use etcetera::BaseStrategy;
    Some(etcetera::choose_base_strategy().ok()?.config_dir())
}

/// A file's settings, or where it is wrong.
fn parse(text: &str, path: &Path) -> Result<File, Failure> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        let what = error.message().lines().collect::<Vec<_>>().join("; ");
        Failure::Input(format!("{}: line {line}: {what}", path.display()))
    })
}

/// A setting as it is shown.
#[derive(Debug, Serialize)]
struct Shown {
    name: &'static str,
    /// `None`: the default.
    value: Option<String>,
    /// `file`, `default`, or the name of the variable.
    from: &'static str,
    default: &'static str,
}

/// Run `tessera config`.
///
/// # Errors
/// Standard output is closed.
pub fn show(args: &ConfigArgs, config: &Config) -> Result<(), Failure> {
    let settings = config.settings();
    if args.json {
        let file = config.path.as_deref().map(shown);
        return print::json(&serde_json::json!({ "file": file, "file_exists": config.read, "settings": settings }));
    }
    let place = match &config.path {
        Some(path) if config.read => format!("file  {}", path.display()),
        Some(path) => format!("file  {} (there is none)", path.display()),
        None => "file  none".into(),
    };
    print::lines([place])?;
    print::table(
        &["setting", "value", "from"],
        settings.into_iter().map(|setting| {
            let value = setting.value.unwrap_or_else(|| setting.default.into());
            vec![setting.name.into(), value, setting.from.into()]
        }),
    )
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::args::Cli;

    #[test]
    fn every_setting_is_the_default_of_an_option_with_its_variable() {
        let text = "coordinator = \"http://h:1\"\ntoken_file = \"t\"\nlisten = \"1.2.3.4:5\"\ndata = \"d\"\nthreads = 3\n\
                    cache = \"c\"\nworker_name = \"n\"\nlog = \"debug\"\n";
        let config = Config { path: None, read: true, file: parse(text, Path::new("f")).unwrap() };
        let command = config.defaults(Cli::command());
        for setting in &SETTINGS {
            let value = (setting.of)(&config.file).unwrap();
            let of = |command: &Command| {
                let arg = command.get_arguments().find(|arg| arg.get_id() == setting.option)?;
                let is_default = arg.get_default_values().first().is_some_and(|v| v.to_str() == Some(value.as_str()));
                let variable = arg.get_env().and_then(|name| name.to_str());
                assert!(!is_default || variable == Some(setting.variable), "{}: {variable:?}", setting.name);
                Some(is_default)
            };
            let found = std::iter::once(&command).chain(command.get_subcommands()).filter_map(of).filter(|d| *d);
            assert!(found.count() >= 1, "{} is the default of an option", setting.name);
        }
        // A folder that `render` keeps its files in is not that of the coordinator.
        let render = command.find_subcommand("render").unwrap();
        let data = render.get_arguments().find(|arg| arg.get_id() == "data").unwrap();
        assert!(data.get_default_values().is_empty());
        command.debug_assert();
    }

    #[test]
    fn a_wrong_file_is_told_by_name_line_and_field() {
        for (text, expected) in [
            ("threads = 4\nthread = 3\n", "c.toml: line 2: unknown field `thread`"),
            ("\nthreads = 0\n", "c.toml: line 2: invalid value"),
            ("listen = \"here\"\n", "c.toml: line 1: invalid socket address"),
            ("coordinator\n", "c.toml: line 1"),
        ] {
            let Err(Failure::Input(message)) = parse(text, Path::new("c.toml")) else { panic!("{text}") };
            assert!(message.starts_with(expected), "{message}");
        }
    }
}
