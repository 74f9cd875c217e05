//! An example for the help of every command. The tests parse each of them.

use clap::Command;

/// Commands, by their words, and lines that show their use.
const EXAMPLES: &[(&str, &[&str])] = &[
    (
        "render",
        &[
            "tessera render scenes/cornell-box.json -o out",
            "tessera render scenes/shells.json -o shells.png --noise 0.05 --resolution 640x480",
            "tessera render --resume out-data -o out",
        ],
    ),
    (
        "coordinator",
        &[
            "tessera coordinator --listen 127.0.0.1:7878 --data farm-data",
            "tessera coordinator --listen 0.0.0.0:7878 --data farm-data --token-file token",
        ],
    ),
    ("worker", &["tessera worker --coordinator http://farm:7878 --threads 8 --token-file token"]),
    (
        "submit",
        &[
            "tessera submit scenes/cornell-box.json --watch -o out",
            "tessera submit scene.json --frames 1-100 --noise 0.05 --priority 80 --tag film",
        ],
    ),
    ("jobs", &["tessera jobs --status active", "tessera jobs --json"]),
    ("job", &["tessera job j17"]),
    ("cancel", &["tessera cancel j17"]),
    ("pause", &["tessera pause j17"]),
    ("resume", &["tessera resume j17"]),
    ("continue", &["tessera continue j17 --noise 0.02 --watch -o out"]),
    ("workers", &["tessera workers"]),
    ("plan", &["tessera plan scenes/mesh-light.json", "tessera plan scenes/mesh-light.json --light-pick power --json"]),
    ("scene check", &["tessera scene check scenes/cornell-box.json"]),
    ("scene convert", &["tessera scene convert bunny.obj bunny.json"]),
    ("scene schema", &["tessera scene schema"]),
    ("chart", &["tessera chart scenes/cornell-box.json --methods hemisphere,light,mis -o chart"]),
    (
        "compare",
        &["tessera compare out/frame-0001.exr reference.exr", "tessera compare a.png b.png -o difference.png --json"],
    ),
    ("stability", &["tessera stability -o stability"]),
    ("soak", &["tessera soak --samples 1e8"]),
    ("coverage", &["tessera coverage -o accuracy --quick"]),
    ("bench render", &["tessera bench render scenes/cornell-box.json --samples 64"]),
    ("bench rays", &["tessera bench rays scenes/shells.json --json"]),
    ("bench auto", &["tessera bench auto scenes/cornell-box.json scenes/metals.json --seeds 4"]),
    ("config", &["tessera config", "tessera config --json"]),
    ("completions", &["tessera completions bash"]),
];

/// The command line with an example below the help of each command.
#[must_use]
pub fn shown(command: Command) -> Command {
    EXAMPLES.iter().fold(command, |command, (words, lines)| {
        let lines = lines.iter().map(|line| format!("  {line}\n")).collect::<String>();
        let words: Vec<&str> = words.split(' ').collect();
        add(command, &words, format!("Examples:\n{}", lines.trim_end()))
    })
}

fn add(command: Command, words: &[&'static str], text: String) -> Command {
    match words {
        [] => command.after_help(text),
        [first, rest @ ..] => command.mut_subcommand(first, |inner| add(inner, rest, text)),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::args::Cli;

    #[test]
    fn every_command_has_an_example_that_parses() {
        let commands = crate::reference::names();
        let with: Vec<&str> = EXAMPLES.iter().map(|(words, _)| *words).collect();
        assert_eq!(commands, with, "every command, in the order of the help, has an entry in EXAMPLES");
        for (words, lines) in EXAMPLES {
            for line in *lines {
                let parsed = shown(Cli::command()).try_get_matches_from(line.split(' '));
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
                assert!(line.starts_with(&format!("tessera {words}")), "{line} is an example of {words}");
            }
        }
    }
}
