//! The `evrig` program: reads the command line, runs one command, exits with its code.

use std::process::ExitCode;

fn main() -> ExitCode {
    evrig::commands::main()
}
