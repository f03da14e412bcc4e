//! Verbs about one session: `info`, `verify`, `export`, `report`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Arguments of `evrig info`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  evrig info sessions/street\n  evrig info sessions/street --json | jq '.streams[].count'"
)]
pub struct InfoArgs {
    /// The session
    pub session: PathBuf,
}

/// Arguments of `evrig verify`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  evrig verify sessions/street\n  evrig verify sessions/cut --repair\n\n\
    Exit code 4 when something does not hold, 3 when it holds and losses are recorded."
)]
pub struct VerifyArgs {
    /// The session
    pub session: PathBuf,

    /// First seal a session whose recording was cut off (crash, power loss) as recovered
    #[arg(long)]
    pub repair: bool,
}

/// Formats of `evrig export`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// NumPy arrays in one file
    Npz,
}

/// Arguments of `evrig export`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig export sessions/street --stream real --out real.npz\n  \
    evrig export sessions/street --stream aps --out aps.npz\n\n\
    In Python: events = numpy.load('real.npz')['events']   # int64, columns t_us, x, y, p")]
pub struct ExportArgs {
    /// The session
    pub session: PathBuf,

    /// The stream, recorded or generated (`evrig info` lists them)
    #[arg(long, value_name = "NAME")]
    pub stream: String,

    /// The file to write
    #[arg(long, value_name = "PATH")]
    pub out: PathBuf,

    /// The format to write it in
    #[arg(long, value_enum, default_value = "npz")]
    pub format: ExportFormat,
}

/// Arguments of `evrig report`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  evrig report sessions/street      # writes sessions/street/report.html"
)]
pub struct ReportArgs {
    /// The session
    pub session: PathBuf,

    /// Where to write the page [default: SESSION/report.html]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
