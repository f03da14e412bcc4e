//! The command line: clap definitions and nothing else, one file a verb.

use clap::{Args, Parser, Subcommand};

mod about;
mod batch;
mod check;
mod demo;
mod diagnose;
mod emulate;
mod guard;
mod import;
mod live;
mod pi;
mod plan;
mod prove;
mod record;
mod session;
mod stages;
mod stimulus;
mod sweep;
mod target;

pub use about::{CompletionsArgs, ManArgs};
pub use batch::{BatchArgs, Engine, EngineArgs, SplitByArg};
pub use check::CheckArgs;
pub use demo::DemoArgs;
pub use diagnose::{BaselineChoice, DiagnoseArgs};
pub use emulate::{EmulateArgs, EmulateArmArgs, EmulateCameraArgs, EmulatedDevice};
pub use guard::GuardArgs;
pub use import::{
    ImportAedat4Args, ImportArgs, ImportCommand, ImportFramesArgs, ImportRaw2EventArgs,
};
pub use live::{LiveArgs, LiveGenerationArgs, LiveLight};
pub use pi::{PairArgs, PiArgs, PiCamera};
pub use plan::PlanArgs;
pub use prove::ProveArgs;
pub use record::RecordArgs;
pub use session::{ExportArgs, ExportFormat, ExportKind, InfoArgs, ReportArgs, VerifyArgs};
pub use stages::{
    CalibrateArgs, CalibrateObjective, CompareArgs, ConditionArgs, GenerateArgs, ModelArgs,
    ProcessArgs,
};
pub use stimulus::StimulusArgs;
pub use sweep::SweepArgs;
pub use target::{FilterArgs, FilterChoice, SceneArgs, SyncArgs, TrackArgs};

/// Records paired raw, RGB and event-camera data, and explains where simulated and real events differ.
#[derive(Debug, Parser)]
#[command(name = "evrig", version, propagate_version = true, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 done, 1 failed, 2 wrong use or wrong description file, \
    3 done with losses, 4 done and the verdict is negative, 130 aborted by the operator.")]
pub struct Cli {
    /// What every command takes.
    #[command(flatten)]
    pub global: GlobalArgs,

    /// The verb.
    #[command(subcommand)]
    pub command: Command,
}

/// Flags that every command takes.
#[derive(Debug, Clone, Copy, Args)]
pub struct GlobalArgs {
    /// Print one machine-readable JSON value on stdout and nothing else there
    #[arg(long, global = true)]
    pub json: bool,

    /// Say more on stderr (twice: even more)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,

    /// Say nothing on stderr but errors; no progress bars
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
}

/// One verb a variant.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show the whole way on the simulated rig: record five seconds, process them, write the report
    Demo(DemoArgs),
    /// Take in a recording made elsewhere as a session
    Import(ImportArgs),
    /// Say what is in a session, stream by stream, counted from its files
    Info(InfoArgs),
    /// Recompute checksums and counts and say whether they hold
    Verify(VerifyArgs),
    /// Put the Pi's frames and the events on one clock, with its error
    Sync(SyncArgs),
    /// Follow the tag through frames
    Track(TrackArgs),
    /// Map the print and tie the event camera to it: the light signal of its pixels
    Scene(SceneArgs),
    /// Cut event streams to the tracked picture and free them of noise
    Filter(FilterArgs),
    /// Generate events from frames
    Generate(GenerateArgs),
    /// Fit the generator's constants k to a session's real events, each with its error
    Calibrate(CalibrateArgs),
    /// Turn a knob through a range and show heat maps and point clouds side by side
    Sweep(SweepArgs),
    /// Compare simulated events with real ones, each measure with its error
    Compare(CompareArgs),
    /// Say which physics the model leaves out: located, named, fitted, shown on held-out events
    Diagnose(DiagnoseArgs),
    /// Hide effects in sessions, diagnose them blind, open the seals and count
    Prove(ProveArgs),
    /// Run every stage a session has the inputs for
    Process(ProcessArgs),
    /// Write the report: one self-contained HTML file
    Report(ReportArgs),
    /// Write a stream in a format other programs read
    Export(ExportArgs),
    /// Record a session: drive the arm along a trajectory while both cameras run
    Record(RecordArgs),
    /// Explain a trajectory before anything moves: duration, speeds, margins to the limits, disk
    Plan(PlanArgs),
    /// Look at everything that must hold before a recording; nothing moves
    Check(CheckArgs),
    /// Print a completion script for a shell
    Completions(CompletionsArgs),
    /// Serve a simulated device on the real wire, for tests and other programs
    Emulate(EmulateArgs),
    /// Serve the Raspberry Pi's camera to a recorder; runs on the Pi
    Pi(PiArgs),
    /// Make the keys by which host and Pi know each other
    Pair(PairArgs),
    /// Show what the devices see now: rates, frames with the tag, events, to DV and Foxglove
    Live(LiveArgs),
    /// Show the target on a screen: picture and tag to scale in a browser, picture after picture
    Stimulus(StimulusArgs),
    /// Own the arm's port and stop the arm when evrig dies
    #[command(hide = true)]
    Guard(GuardArgs),
    /// Write the man pages into a directory
    Man(ManArgs),
}
