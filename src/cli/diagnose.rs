//! `evrig diagnose`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// What the light of the event pixels comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BaselineChoice {
    /// The map of the print and the path over it
    Scene,
    /// Frames of the event camera, led along with what moves in between
    Motion,
    /// Frames of the event camera, straight in between: the plain generator from frames
    Frames,
}

/// Arguments of `evrig diagnose`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig diagnose sessions/street\n  \
    evrig diagnose sessions/street --from aps --json\n  \
    evrig diagnose sessions/street -v      (what is being looked at, line by line)\n  \
    evrig generate sessions/street --diagnosed   (events of the whole sensor by the camera that was found)\n\n\
    A mismatch that was found is a result, not a failure: the exit code is 0.")]
pub struct DiagnoseArgs {
    /// The session
    pub session: PathBuf,

    /// What the light comes from [default: scene where the session holds one, else motion]
    #[arg(long)]
    pub baseline: Option<BaselineChoice>,

    /// The light: aps (the DAVIS's own frames) or frames (imported ones) [default: what the session has]
    #[arg(long, value_name = "LIGHT")]
    pub from: Option<String>,

    /// The events to explain
    #[arg(long, value_name = "NAME", default_value = "real")]
    pub real: String,

    /// Pixels to look at; more where they hold few events [default: 600; `process` looks at 120]
    #[arg(long, value_name = "N")]
    pub pixels: Option<usize>,

    /// Recordings drawn from the fitted model that show what the search finds by chance
    #[arg(long, value_name = "N")]
    pub null: Option<usize>,

    /// Seed of all draws
    #[arg(long, default_value_t = 0)]
    pub seed: u64,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}
