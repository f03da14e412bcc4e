//! `evrig prove`.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig prove`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig prove --quick\n  \
    evrig prove --out proof --single 48 --double 16 --clean 20 --alien 9\n  \
    evrig prove --recording davis346-street.aedat4 --single 22 --clean 2 --out proof\n\n\
    Each session is made with effects hidden in it; the truth goes into OUT/truth and only its\n\
    SHA-256 stands in the session while it is diagnosed. Then the seals are opened and counted.\n\
    A poor score is a result: the exit code is 0.")]
pub struct ProveArgs {
    /// A few short trials, five minutes on two cores
    #[arg(long)]
    pub quick: bool,

    /// Where sessions, truths and the score go
    #[arg(long, default_value = "evrig-proof")]
    pub out: PathBuf,

    /// Apply effects to this recording (AEDAT4 with frames) instead of simulating sessions
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,

    /// Trials with one effect
    #[arg(long, value_name = "N")]
    pub single: Option<usize>,

    /// Trials with two effects
    #[arg(long, value_name = "N")]
    pub double: Option<usize>,

    /// Trials with nothing hidden
    #[arg(long, value_name = "N")]
    pub clean: Option<usize>,

    /// Trials with an effect that the library does not know
    #[arg(long, value_name = "N")]
    pub alien: Option<usize>,

    /// Seconds of a simulated session
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// Seed of the plan
    #[arg(long, default_value_t = 1)]
    pub seed: u64,

    /// Keep the sessions
    #[arg(long)]
    pub keep: bool,
}
