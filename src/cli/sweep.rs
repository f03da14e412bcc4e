//! `sweep`: one parameter over a range.

use super::{ConditionArgs, ModelArgs};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig sweep`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig sweep sessions/street --knob contrast-sensitivity=1..10\n  \
    evrig sweep sessions/street --knob dark-noise-floor=1e-8..1e-6 --steps 4\n  \
    evrig sweep sessions/street --knob refractory_period.refractory_us=0..5000\n\n\
    One --knob has a range, A..B: a knob's name or EFFECT.PARAMETER. Others keep their value. \
    A range over more than two decades is sampled in equal ratios, another in equal steps.")]
pub struct SweepArgs {
    /// The session
    pub session: PathBuf,

    /// Number of values, 2 to 12
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=12))]
    pub steps: u32,

    /// Seconds of the session to generate, around its middle; for the Pi's frames, from the first
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = super::import::positive)]
    pub seconds: f64,

    /// The frames or scene [default: what the session has]
    #[arg(long, value_name = "STREAM")]
    pub from: Option<String>,

    /// Where the page is written [default: in the session]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// The generator and its other parameters.
    #[command(flatten)]
    pub choice: ModelArgs,

    /// Preparation of the frames and physical effects.
    #[command(flatten)]
    pub conditions: ConditionArgs,
}
