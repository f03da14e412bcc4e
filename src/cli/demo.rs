//! `demo`: from the recording to the report without hardware.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig demo\n  \
    evrig demo --out sessions/demo --seed 7\n  \
    evrig demo --world rig/world.toml\n\n\
    The session is recorded by the same engine, with the same protocols and into the same files\n\
    as on a real rig; the devices are simulated.")]
pub struct DemoArgs {
    /// The session's directory, missing or empty [default: evrig-demo, with a number if it is
    /// taken]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// The trajectory: a file, or the name of a bundled one
    #[arg(long, value_name = "TRAJECTORY", default_value = "protocol-short")]
    pub trajectory: String,

    /// Description of the simulated world (see rig/world.toml) [default: the nominal world]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,

    /// Seed of all random draws of the simulated world
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}
