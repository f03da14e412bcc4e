//! `sweep`: one knob through a range.

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
    A range over more than two decades is gone through in equal ratios, another in equal steps.")]
pub struct SweepArgs {
    /// The session
    pub session: PathBuf,

    /// Number of values, 2 to 12
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=12))]
    pub steps: u32,

    /// Seconds of the session that are generated, about its middle; of the Pi's frames, from the first
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = super::import::positive)]
    pub seconds: f64,

    /// The light [default: what the session has]
    #[arg(long, value_name = "LIGHT")]
    pub from: Option<String>,

    /// Where the page is written [default: in the session]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// What decides the events beside the knob.
    #[command(flatten)]
    pub choice: ModelArgs,

    /// What is done to the light, and what acts beside the model.
    #[command(flatten)]
    pub conditions: ConditionArgs,
}
