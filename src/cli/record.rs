//! `record`: a session on a rig.

use clap::Args;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Arguments of `evrig record`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig record sim circle --out sessions/simulated\n  \
    evrig record rig/lab.toml circle --out sessions/one\n  \
    evrig record rig/lab.toml circle --images pictures.csv --out dataset\n  \
    evrig record rig/lab.toml protocol --without-optional --out sessions/two\n  \
    evrig record rig/lab.toml circle --repeat 50 --out datasets/monday\n  \
    evrig record rig/lab.toml circle --resume --out datasets/monday\n\n\
    Ctrl-C stands the arm at once, SIGUSR1 ends at the next corner of the path; both leave a sealed\n\
    session. Exit code 3: recorded with losses; 130: ended by the operator.")]
pub struct RecordArgs {
    /// The rig: a file, or the name of a bundled one
    pub rig: String,

    /// The trajectory: a file, or the name of a bundled one
    pub trajectory: String,

    /// The session's directory, missing or empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Record so many times, each in its own directory below --out, with a list of them in runs.json
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    pub repeat: Option<u32>,

    /// Take up the series of --repeat in --out where it ended: what is not complete is recorded again
    #[arg(long)]
    pub resume: bool,

    /// Leave out the segments that need the operator's hands
    #[arg(long)]
    pub without_optional: bool,

    /// Home the arm first: its base sweeps, so clear the table
    #[arg(long)]
    pub home: bool,

    /// Ask nothing: neither whether the arm's way is free nor what the trajectory asks of the operator;
    /// where there is no terminal nothing is asked either
    #[arg(long, short = 'y')]
    pub yes: bool,

    /// What simulated cameras see (see rig/world.toml); the rig's nominal world if not given
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,

    /// Seed of everything that is random in the simulated world
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Record once for each picture of a list (a folder, or lines `picture[,label]`), shown by a page
    /// in a browser on the target's screen; --out is then a folder of sessions, and pictures whose
    /// session is complete are left out
    #[arg(long, value_name = "LIST", conflicts_with_all = ["repeat", "resume"])]
    pub images: Option<PathBuf>,

    /// The screen's pixels a millimetre, for --images; calibrated on the page if not given
    #[arg(long, value_name = "X", requires = "images")]
    pub px_per_mm: Option<f64>,

    /// Where the page of --images is served, on this machine alone
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8646")]
    pub stimulus: SocketAddr,

    /// Play a recording that stands in for the DAVIS (davis.transport = "file:...") so many times as fast
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub replay_pace: f64,
}
