//! `record` and `check`: a session on a rig.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig record`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig record rig/lab.toml circle --out sessions/one\n  \
    evrig record rig/lab.toml protocol --without-optional --out sessions/two\n\n\
    The first Ctrl-C ends at the next corner of the path, the second stands the arm at once; both\n\
    leave a sealed session. Exit code 3: recorded with losses; 130: ended by the operator.")]
pub struct RecordArgs {
    /// The rig: a file, or the name of a bundled one
    pub rig: String,

    /// The trajectory: a file, or the name of a bundled one
    pub trajectory: String,

    /// The session's directory, missing or empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Leave out the segments that need the operator's hands
    #[arg(long)]
    pub without_optional: bool,

    /// Home the arm first: its base sweeps, so clear the table
    #[arg(long)]
    pub home: bool,

    /// Play a recording that stands in for the DAVIS (davis.transport = "file:...") so many times as fast
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub replay_pace: f64,
}

/// Arguments of `evrig check`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig check rig/lab.toml circle\n\n\
    Nothing moves. Exit code 4 when something must be mended first.")]
pub struct CheckArgs {
    /// The rig: a file, or the name of a bundled one
    pub rig: String,

    /// The trajectory: a file, or the name of a bundled one
    #[arg(default_value = "circle")]
    pub trajectory: String,
}
