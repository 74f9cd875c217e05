//! The binary people run.

fn main() -> std::process::ExitCode {
    cli::main()
}
