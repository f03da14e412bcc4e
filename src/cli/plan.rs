//! `plan`: a trajectory checked before anything moves.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig plan`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig plan circle\n  \
    evrig plan protocol --without-optional --plot protocol.svg\n  \
    evrig plan mine.toml --rig rig/lab.toml --json\n\n\
    Bundled trajectories: circle, line, figure-eight, speed-sweep, protocol, protocol-short.\n\
    Exit code 4 when the arm cannot run it: the first point beyond each limit is printed.")]
pub struct PlanArgs {
    /// The trajectory: a file, or the name of a bundled one
    pub trajectory: String,

    /// The rig: a file, or the name of a bundled one (sim, magician)
    #[arg(long, default_value = "sim")]
    pub rig: String,

    /// Leave out the segments that need the operator
    #[arg(long)]
    pub without_optional: bool,

    /// Plot path, speed and joint angles into this SVG file
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
}
