//! `check`: readiness for a recording.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig check`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig check                          # this machine: ports, disk, clock\n  \
    evrig check sim circle               # the simulated rig\n  \
    evrig check rig/lab.toml protocol --out /data\n\n\
    Nothing moves, no setting is changed, no alarm is cleared. Exit code 4 when a recording\n\
    cannot start; each such line states what to do.")]
pub struct CheckArgs {
    /// The rig: a file, or the name of a bundled one (sim, magician)
    pub rig: Option<String>,

    /// The trajectory: a file, or the name of a bundled one
    pub trajectory: Option<String>,

    /// Where the recording would be written
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
}
