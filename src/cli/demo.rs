//! `demo`: the main job without any hardware.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig demo\n  \
    evrig demo --out sessions/demo --seed 7\n  \
    evrig demo --world rig/world.toml\n\n\
    The session is recorded by the same engine, over the same wires and into the same files as on a\n\
    real rig; the devices are simulated.")]
pub struct DemoArgs {
    /// The session's directory, missing or empty [default: evrig-demo, with a number if it is taken]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// The trajectory: a file, or the name of a bundled one
    #[arg(long, value_name = "TRAJECTORY", default_value = "protocol-short")]
    pub trajectory: String,

    /// What the simulated cameras see (see rig/world.toml); the nominal world if not given
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,

    /// Seed of everything that is random in the simulated world
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}
