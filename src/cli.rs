//! The command line: clap definitions and nothing else, one file per command.

use clap::{Args, Parser, Subcommand};

mod about;
mod batch;
mod camera_report;
mod check;
mod demo;
mod diagnose;
mod emulate;
mod export_camera;
mod groups;
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
pub use camera_report::CameraReportArgs;
pub use check::CheckArgs;
pub use demo::{CONCEALABLE, DemoArgs};
pub use diagnose::{BaselineChoice, DiagnoseArgs};
pub use emulate::{EmulateArgs, EmulateArmArgs, EmulateCameraArgs, EmulatedDevice};
pub use export_camera::{ExportCameraArgs, SimulatorChoice};
pub use groups::command;
pub use guard::GuardArgs;
pub use import::{
    EventArgs, ImportAedat4Args, ImportAnyArgs, ImportArgs, ImportCommand, ImportFramesArgs,
    ImportRaw2EventArgs,
};
pub use live::{LiveArgs, LiveGenerationArgs, LiveLight};
pub use pi::{PairArgs, PiArgs};
pub use plan::PlanArgs;
pub use prove::ProveArgs;
pub use record::RecordArgs;
pub use session::{ExportArgs, ExportFormatArg, ExportKind, InfoArgs, ReportArgs, VerifyArgs};
pub use stages::{
    CalibrateArgs, CalibrateObjective, CompareArgs, ConditionArgs, GenerateArgs, ModelArgs,
    ProcessArgs,
};
pub use stimulus::StimulusArgs;
pub use sweep::SweepArgs;
pub use target::{FilterArgs, FilterChoice, SceneArgs, SyncArgs, TrackArgs};

/// Records paired raw, RGB and event-camera data, and explains where simulated and real events
/// differ.
#[derive(Debug, Parser)]
#[command(name = "evrig", version, propagate_version = true, max_term_width = 100)]
#[command(
    after_help = "`evrig COMMAND -h` shows the options in general use, `--help` all of them.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong use or wrong description file, \
    3 done with losses, 4 done and the verdict is negative, 130 aborted by the operator."
)]
pub struct Cli {
    /// Options of every command.
    #[command(flatten)]
    pub global: GlobalArgs,

    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// Options of every command.
#[derive(Debug, Clone, Copy, Args)]
pub struct GlobalArgs {
    /// Print one machine-readable JSON value on stdout and nothing else there
    #[arg(long, global = true, hide = true)]
    pub json: bool,

    /// More messages on stderr (twice: even more)
    #[arg(short, long, global = true, hide = true, action = clap::ArgAction::Count)]
    pub verbose: u8,

    /// Only errors on stderr; no progress bars
    #[arg(short, long, global = true, hide = true, conflicts_with = "verbose")]
    pub quiet: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Conceal an effect in a simulated session, find it, and write the report
    Demo(DemoArgs),
    /// Import a recording made by other software as a session
    Import(ImportArgs),
    /// List the streams of a session, counted from its files
    Info(InfoArgs),
    /// Recompute checksums and counts and compare them with the manifest
    Verify(VerifyArgs),
    /// Synchronize the Pi's frames with the events, with the error of the clock map
    Sync(SyncArgs),
    /// Track the tag in frames
    Track(TrackArgs),
    /// Reconstruct the target and register the event camera to it: the log-intensity signal of its
    /// pixels
    Scene(SceneArgs),
    /// Crop event streams to the tracked target and remove noise
    Filter(FilterArgs),
    /// Generate events from frames
    Generate(GenerateArgs),
    /// Report what the events alone show of the camera: frame coupling, refractory periods, hot
    /// pixels, noise, flicker, readout
    CameraReport(CameraReportArgs),
    /// Fit the generator's constants k to a session's recorded events, each with its error
    Calibrate(CalibrateArgs),
    /// Vary one parameter over a range; heat maps and point clouds side by side
    Sweep(SweepArgs),
    /// Compare simulated with recorded events, each measure with its error
    Compare(CompareArgs),
    /// Find physical effects that the model lacks: located, named, fitted, tested on held-out
    /// events
    Diagnose(DiagnoseArgs),
    /// Print the diagnosed camera as arguments of another simulator
    ExportCamera(ExportCameraArgs),
    /// Run concealed trials: sessions with hidden effects, diagnosed blind and scored
    Prove(ProveArgs),
    /// Run every stage a session has the inputs for
    Process(ProcessArgs),
    /// Write the report: one self-contained HTML file
    Report(ReportArgs),
    /// Write a stream in the format of another program
    Export(ExportArgs),
    /// Record a session: drive the arm along a trajectory while both cameras run
    Record(RecordArgs),
    /// Check a trajectory without moving: duration, speeds, margins to the limits, disk space
    Plan(PlanArgs),
    /// Check that rig, disk and clock are ready for a recording; nothing moves
    Check(CheckArgs),
    /// Print a completion script for a shell
    Completions(CompletionsArgs),
    /// Serve a simulated device with the protocol of the real one
    Emulate(EmulateArgs),
    /// Serve the Raspberry Pi's camera to a recorder; runs on the Pi
    Pi(PiArgs),
    /// Make the keys with which host and Pi authenticate each other
    Pair(PairArgs),
    /// Live view of the devices: rates, frames with the tag, and events, for DV and Foxglove
    Live(LiveArgs),
    /// Show the target on a screen: image and tag to scale in a browser, one image after another
    Stimulus(StimulusArgs),
    /// Own the arm's port and stop the arm when evrig ends
    #[command(hide = true)]
    Guard(GuardArgs),
    /// Write the man pages into a directory
    Man(ManArgs),
}
