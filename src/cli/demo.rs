//! `demo`: a concealed effect, from the recording to the report, without hardware.

use clap::Args;
use std::path::PathBuf;

/// Effects that can be concealed: each was named in the demo's short session at the strengths at
/// which it is drawn, and the generator reproduces it.
pub const CONCEALABLE: [&str; 3] = ["clock_offset", "fixed_pole", "refractory_period"];

/// Arguments of `evrig demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig demo\n  \
    evrig demo --seed 7\n  \
    evrig demo --effect fixed_pole\n  \
    evrig demo --world none                (conceals nothing)\n\n\
    The drawn effect acts in the simulated camera and is sealed after the recording. The\n\
    diagnosis reads the session only; then the seal is opened and the answer is judged. The\n\
    devices are simulated in virtual time; `evrig record sim circle` runs the recording engine\n\
    with simulated devices on its real protocols.")]
pub struct DemoArgs {
    /// The session's directory, missing or empty [default: evrig-demo, with a number if it is
    /// taken]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// The concealed effect [default: drawn]
    #[arg(long, value_name = "EFFECT", conflicts_with = "world",
        value_parser = CONCEALABLE)]
    pub effect: Option<String>,

    /// `none` conceals nothing; a file describes another simulated world (see rig/world.toml)
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,

    /// Seed of all random draws
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}
