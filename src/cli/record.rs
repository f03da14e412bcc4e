//! `record`: a session on a rig.

use clap::Args;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Arguments of `evrig record`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig record sim circle --out sessions/simulated\n  \
    evrig record rig/lab.toml circle --out sessions/one\n  \
    evrig record rig/lab.toml circle --images images.csv --out dataset\n  \
    evrig record rig/lab.toml protocol --without-optional --out sessions/two\n  \
    evrig record rig/lab.toml circle --repeat 50 --out datasets/monday\n  \
    evrig record rig/lab.toml circle --resume --out datasets/monday\n\n\
    Ctrl-C stops the arm immediately, SIGUSR1 ends at the next corner of the path; both leave a\n\
    sealed session. Exit code 3: recorded with losses; 130: ended by the operator.")]
pub struct RecordArgs {
    /// The rig: a file, or the name of a bundled one
    pub rig: String,

    /// The trajectory: a file, or the name of a bundled one
    pub trajectory: String,

    /// The session's directory, missing or empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Record this many times, each in its own directory below --out, listed in runs.json
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    pub repeat: Option<u32>,

    /// Continue the series of --repeat in --out: incomplete recordings are repeated
    #[arg(long)]
    pub resume: bool,

    /// Leave out the segments that need the operator
    #[arg(long)]
    pub without_optional: bool,

    /// Home the arm first: its base rotates, so clear the table
    #[arg(long)]
    pub home: bool,

    /// Do not prompt, neither before the arm moves nor for the operator's segments; without a
    /// terminal there is no prompt either
    #[arg(long, short = 'y')]
    pub yes: bool,

    /// Description of the simulated world (see rig/world.toml) [default: the nominal world]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,

    /// Seed of all random draws of the simulated world
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Record once for each image of a list (a folder, or lines `image[,label]`), shown in a
    /// browser on the target's screen; --out is then a folder of sessions, and images whose session
    /// is complete are skipped
    #[arg(long, value_name = "LIST", conflicts_with_all = ["repeat", "resume"])]
    pub images: Option<PathBuf>,

    /// Pixels per millimetre of the screen, for --images; calibrated on the page if not given
    #[arg(long, value_name = "X", requires = "images")]
    pub px_per_mm: Option<f64>,

    /// Where the page of --images is served, on this machine alone
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8646")]
    pub stimulus: SocketAddr,

    /// Replay speed of a recording in place of the DAVIS (davis.transport = "file:...")
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub replay_pace: f64,
}
