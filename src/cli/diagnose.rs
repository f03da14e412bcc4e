//! `evrig diagnose`.

use clap::{Args, ValueEnum};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Source of the log-intensity signal of the event pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BaselineChoice {
    /// The reconstructed target and the camera path over it
    Scene,
    /// Frames of the event camera with motion-compensated interpolation
    Motion,
    /// Frames of the event camera with linear interpolation, as the published generators take them
    Frames,
}

/// Arguments of `evrig diagnose`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig diagnose sessions/street\n  \
    evrig diagnose sessions/street --from aps --json\n  \
    evrig diagnose sessions/street -v      (what is computed, line by line)\n  \
    evrig generate sessions/street --diagnosed   (events of the whole sensor by the diagnosed \
    camera)\n\n\
    A mismatch is a result, not a failure: the exit code is 0.")]
pub struct DiagnoseArgs {
    /// The session
    pub session: PathBuf,

    /// Source of the log-intensity signal [default: scene where the session has one, else motion]
    #[arg(long)]
    pub baseline: Option<BaselineChoice>,

    /// The frames: aps (the DAVIS's own frames) or frames (imported ones) [default: what the
    /// session has]
    #[arg(long, value_name = "STREAM")]
    pub from: Option<String>,

    /// The events to explain
    #[arg(long, value_name = "NAME", default_value = "real")]
    pub real: String,

    /// Pixels to evaluate; more where they hold few events [default: 120]
    #[arg(long, value_name = "N")]
    pub pixels: Option<NonZeroUsize>,

    /// Seed of all draws
    #[arg(long, default_value_t = 0)]
    pub seed: u64,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}
