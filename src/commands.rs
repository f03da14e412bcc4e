//! The commands: each reads its arguments, calls the modules below, and prints the typed result
//! once.
//!
//! Only here is anything printed, and only here does an error become a message and an exit code.

use crate::batch::BatchError;
use crate::cli::{self, Cli, Command};
use crate::pipeline::PipelineError;
use clap::{CommandFactory, FromArgMatches};
use evrig_session::StreamName;
use std::ffi::OsString;
use std::process::ExitCode;

mod about;
mod calibrate;
mod camera_report;
mod check;
mod compare;
mod dataset;
mod demo;
mod diagnose;
mod emulate;
mod export;
mod export_camera;
mod filter;
mod generate;
mod guard;
mod import;
mod info;
mod live;
mod output;
mod pi;
mod plan;
mod process;
mod progress;
mod prove;
mod record;
mod report;
mod scene;
mod stimulus;
mod sweep;
mod sync;
mod table;
mod track;
mod verify;

pub use output::{Output, WrongUse, error_text};

/// How a command ended; the program's exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Ending {
    /// Everything was done.
    Done = 0,
    /// It failed: one clear error was printed.
    Failed = 1,
    /// The command line or a description file is wrong.
    WrongUse = 2,
    /// Done, but something was lost; the losses were counted and printed.
    WithLosses = 3,
    /// Done, and the answer is no (not ready, does not verify).
    Negative = 4,
    /// The operator broke it off.
    Aborted = 130,
}

/// Reads the command line, runs the command, reports its end.
#[must_use]
pub fn main() -> ExitCode {
    ExitCode::from(run_arguments(std::env::args_os()))
}

/// Runs the command of a command line, whose first word is the program, and gives its exit code.
pub fn run_arguments(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let parsed = cli::command()
        .try_get_matches_from(arguments)
        .and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = match parsed {
        Ok(cli) => cli,
        Err(error) => {
            // A closed pipe is the reader's choice.
            let _ = error.print();
            return error.exit_code() as u8;
        }
    };
    let output = Output::new(cli.global);
    let ending = match run(cli.command, &output) {
        Ok(ending) => ending,
        Err(error) => {
            output.error(&error);
            if is_wrong_use(&error) { Ending::WrongUse } else { Ending::Failed }
        }
    };
    ending as u8
}

fn is_wrong_use(error: &anyhow::Error) -> bool {
    let is_request = |error: &PipelineError| matches!(error, PipelineError::Request(_));
    error.is::<WrongUse>()
        || error.downcast_ref().is_some_and(is_request)
        || matches!(error.downcast_ref(), Some(BatchError::Pipeline(error)) if is_request(error))
}

/// A stream's name from the command line.
fn stream_name(name: &str) -> Result<StreamName, WrongUse> {
    StreamName::new(name).map_err(|error| WrongUse(error.to_string()))
}

fn run(command: Command, output: &Output) -> anyhow::Result<Ending> {
    match command {
        Command::Import(args) => import::run(&args, output),
        Command::Info(args) => info::run(&args, output),
        Command::Verify(args) => verify::run(&args, output),
        Command::Sync(args) => sync::run(&args, output),
        Command::Scene(args) => scene::run(&args, output),
        Command::Track(args) => track::run(&args, output),
        Command::Filter(args) => filter::run(&args, output),
        Command::Generate(args) => generate::run(&args, output),
        Command::CameraReport(args) => camera_report::run(&args, output),
        Command::Calibrate(args) => calibrate::run(&args, output),
        Command::Sweep(args) => sweep::run(&args, output),
        Command::Compare(args) => compare::run(&args, output),
        Command::Diagnose(args) => diagnose::run(&args, output),
        Command::Process(args) => process::run(&args, output),
        Command::ExportCamera(args) => export_camera::run(&args, output),
        Command::Prove(args) => prove::run(&args, output),
        Command::Report(args) => report::run(&args, output),
        Command::Export(args) => export::run(&args, output),
        Command::Check(args) => check::check(&args, output),
        Command::Record(args) => record::record(&args, output),
        Command::Demo(args) => demo::demo(&args, output),
        Command::Plan(args) => plan::plan(&args, output),
        Command::Completions(args) => about::completions(&args, &mut Cli::command()),
        Command::Emulate(args) => emulate::emulate(&args, output),
        Command::Pi(args) => pi::pi(&args, output),
        Command::Pair(args) => pi::pair(&args, output),
        Command::Live(args) => live::live(&args, output),
        Command::Stimulus(args) => stimulus::stimulus(&args, output),
        Command::Guard(args) => guard::guard(&args, output),
        Command::Man(args) => about::man(&args, Cli::command(), output),
    }
}
