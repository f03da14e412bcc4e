//! `evrig prove`.

use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Arguments of `evrig prove`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig prove --quick\n  \
    evrig prove --out proof --single 48 --double 12 --clean 20 --alien 9 --local 10\n  \
    evrig prove --out proof --single 48 --double 12 --clean 20 --alien 9 --local 10 --resume\n  \
    evrig prove --recording davis346-street.aedat4 --single 22 --out proof-street\n  \
    evrig prove --sessions made-elsewhere --out proof-elsewhere\n\n\
    Each session is made with hidden effects; the truth is stored in OUT/truth and only its\n\
    SHA-256 in the session, while track, sync, scene and diagnose run on it in processes of\n\
    their own. Then the truth is opened, the trial's record goes to OUT/trials and the score so\n\
    far to OUT/proof-*. A poor score is a result: the exit code is 0. With --quick it is 4 when\n\
    a named effect is wrong.")]
pub struct ProveArgs {
    /// Two short fixed trials whose effects must be named correctly
    #[arg(long, conflicts_with_all = ["recording", "sessions", "single", "double", "clean", "alien", "local"])]
    pub quick: bool,

    /// Output directory for sessions, truths, records and the score
    #[arg(long, default_value = "evrig-proof")]
    pub out: PathBuf,

    /// Continue the run in OUT: trials with a record are not run again
    #[arg(long)]
    pub resume: bool,

    /// Apply effects to this recording (AEDAT4 with frames) instead of simulating sessions
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,

    /// Evaluate sealed sessions made by other software: DIR/sessions/NAME with seal.json,
    /// DIR/truth/NAME.json
    #[arg(long, value_name = "DIR", conflicts_with_all = ["recording", "single", "double", "clean", "alien", "local", "seconds"])]
    pub sessions: Option<PathBuf>,

    /// Trials with one effect
    #[arg(long, value_name = "N")]
    pub single: Option<usize>,

    /// Trials with two effects
    #[arg(long, value_name = "N")]
    pub double: Option<usize>,

    /// Trials without a hidden effect
    #[arg(long, value_name = "N")]
    pub clean: Option<usize>,

    /// Trials with an effect outside the library
    #[arg(long, value_name = "N")]
    pub alien: Option<usize>,

    /// Trials with one effect in a region of the image
    #[arg(long, value_name = "N")]
    pub local: Option<usize>,

    /// Duration of a simulated session, seconds
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// Pixels that a diagnosis evaluates; more where they hold few events [default: 120]
    #[arg(long, value_name = "N")]
    pub pixels: Option<NonZeroUsize>,

    /// Time limit of a diagnosis, seconds; a stopped one counts as none [default: 1800]
    #[arg(long, value_name = "S")]
    pub deadline: Option<f64>,

    /// The evrig program that diagnoses, to compare builds on the same trials [default: this one]
    #[arg(long, value_name = "PROGRAM")]
    pub with: Option<PathBuf>,

    /// Seed of the plan
    #[arg(long, default_value_t = 1)]
    pub seed: u64,

    /// Keep the sessions
    #[arg(long)]
    pub keep: bool,
}
