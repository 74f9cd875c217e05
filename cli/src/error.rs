//! How a command ends when it does not end well: one sentence and an exit code.

use std::process::ExitCode;

use common::job::FieldError;
use worker::CallError;

/// Why a command did not do what it was asked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The input was wrong: exit code 2.
    #[error("{0}")]
    Input(String),
    /// The work, the network or a port failed: exit code 1.
    #[error("{0}")]
    Work(String),
    /// Ctrl-C: exit code 130, as a shell has it.
    #[error("interrupted{0}")]
    Interrupted(String),
}

impl Failure {
    /// The exit code that goes with it.
    #[must_use]
    pub fn code(&self) -> ExitCode {
        match self {
            Failure::Input(_) => ExitCode::from(2),
            Failure::Work(_) => ExitCode::from(1),
            Failure::Interrupted(_) => ExitCode::from(130),
        }
    }

    /// A file or folder that cannot be used, by what the system says.
    #[must_use]
    pub fn file(path: &std::path::Path, error: &std::io::Error) -> Failure {
        Failure::Input(format!("{}: {}", path.display(), reason(error)))
    }
}

/// What the system says, without its error number.
#[must_use]
pub fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "no such file".into(),
        std::io::ErrorKind::PermissionDenied => "permission denied".into(),
        std::io::ErrorKind::NotADirectory => "a part of the path is a file, not a folder".into(),
        std::io::ErrorKind::IsADirectory => "is a folder, not a file".into(),
        std::io::ErrorKind::AddrInUse => "the address is already in use".into(),
        _ => {
            let text = error.to_string();
            text.split(" (os error").next().unwrap_or(&text).to_lowercase()
        }
    }
}

impl From<CallError> for Failure {
    fn from(error: CallError) -> Self {
        match &error {
            CallError::Refused { status: 400 | 404 | 409 | 413 | 422, error } => {
                let message = match &error.field {
                    Some(field) => {
                        let what = error.message.strip_prefix(&format!("{field}: ")).unwrap_or(&error.message);
                        format!("{}: {what}", option_of(field))
                    }
                    None => error.message.clone(),
                };
                Failure::Input(message)
            }
            CallError::Refused { status: 401 | 403, error } => {
                Failure::Work(format!("{}; give the farm's token by --token-file or TESSERA_TOKEN", error.message))
            }
            _ => Failure::Work(error.to_string()),
        }
    }
}

impl From<FieldError> for Failure {
    fn from(error: FieldError) -> Self {
        Failure::Input(format!("{}: {}", option_of(&error.field), error.message))
    }
}

impl From<crate::stability::Error> for Failure {
    fn from(error: crate::stability::Error) -> Self {
        let kind = if error.exit_code() == 2 { Failure::Input } else { Failure::Work };
        kind(error.to_string())
    }
}

impl From<worker::WorkerError> for Failure {
    fn from(error: worker::WorkerError) -> Self {
        Failure::Work(error.to_string())
    }
}

/// The option behind a field of a request, for people who never wrote that field; the field itself where
/// there is none.
fn option_of(field: &str) -> String {
    match field {
        "quality.relative_error" => "--noise".into(),
        "quality.samples" => "--samples".into(),
        "quality.cpu_seconds" => "--time".into(),
        "quality.max_samples" => "--max-samples".into(),
        "resolution" | "crop" | "tile" | "priority" | "seed" | "frames" => format!("--{field}"),
        _ => match field.strip_prefix("method.") {
            Some(choice) if !choice.contains('.') => format!("--{}", choice.replace('_', "-")),
            _ => field.into(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_named_as_the_user_gave_them() {
        for (field, named) in [
            ("method.light_samples", "--light-samples"),
            ("quality.samples", "--samples"),
            ("scene.shapes[3].material", "scene.shapes[3].material"),
            ("crop", "--crop"),
        ] {
            assert_eq!(option_of(field), named);
        }
    }
}
