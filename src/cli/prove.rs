//! `evrig prove`.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig prove`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig prove --quick\n  \
    evrig prove --out proof --single 48 --double 12 --clean 20 --alien 9 --local 10\n  \
    evrig prove --out proof --single 48 --double 12 --clean 20 --alien 9 --local 10 --resume\n  \
    evrig prove --recording davis346-street.aedat4 --single 22 --out proof-street\n  \
    evrig prove --sessions made-elsewhere --out proof-elsewhere\n\n\
    Each session is made with effects hidden in it; the truth goes into OUT/truth and only its\n\
    SHA-256 stands in the session while track, sync, scene and diagnose run on it, in processes of\n\
    their own. Then the seal is opened, OUT/trials gets the trial's record and OUT/proof-* the score\n\
    so far. A poor score is a result: the exit code is 0. With --quick it is 4 when a name is wrong.")]
pub struct ProveArgs {
    /// Two short trials that are always the same and must be named right
    #[arg(long, conflicts_with_all = ["recording", "sessions", "single", "double", "clean", "alien", "local"])]
    pub quick: bool,

    /// Where sessions, truths, records and the score go
    #[arg(long, default_value = "evrig-proof")]
    pub out: PathBuf,

    /// Go on with the run that OUT holds: trials that have a record are not run again
    #[arg(long)]
    pub resume: bool,

    /// Apply effects to this recording (AEDAT4 with frames) instead of simulating sessions
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,

    /// Judge sealed sessions that were made elsewhere: DIR/sessions/NAME with seal.json, DIR/truth/NAME.json
    #[arg(long, value_name = "DIR", conflicts_with_all = ["recording", "single", "double", "clean", "alien", "local", "seconds"])]
    pub sessions: Option<PathBuf>,

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

    /// Trials with one effect in a part of the picture only
    #[arg(long, value_name = "N")]
    pub local: Option<usize>,

    /// Seconds of a simulated session
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// Pixels a diagnosis looks at; more where they hold few events [default: 120]
    #[arg(long, value_name = "N")]
    pub pixels: Option<usize>,

    /// Null recordings of a diagnosis [default: 1]
    #[arg(long, value_name = "N")]
    pub null: Option<usize>,

    /// Seconds after which a diagnosis is stopped and counts as none [default: 1800]
    #[arg(long, value_name = "S")]
    pub deadline: Option<f64>,

    /// The evrig that diagnoses, to hold another build against the same trials [default: this one]
    #[arg(long, value_name = "PROGRAM")]
    pub with: Option<PathBuf>,

    /// Seed of the plan
    #[arg(long, default_value_t = 1)]
    pub seed: u64,

    /// Keep the sessions
    #[arg(long)]
    pub keep: bool,
}
