//! `evrig camera-report`.

use super::import::{EventArgs, size};
use clap::Args;
use evrig_core::geometry::Size;
use std::path::PathBuf;

/// Arguments of `evrig camera-report`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig camera-report davis346-street.aedat4\n  \
    evrig camera-report events.csv --time-unit s --size 346x260 --out camera\n  \
    evrig camera-report sessions/street --json | jq '.frame_coupling.bursts[].row_us'\n\n\
    Every number has its error. Where the events are too few, the report states for what.")]
pub struct CameraReportArgs {
    /// A recording or a table of events, or a session
    #[arg(value_name = "FILE|SESSION")]
    pub path: PathBuf,

    /// The event stream of a session
    #[arg(long, value_name = "NAME", default_value = "real")]
    pub stream: String,

    /// A folder for a page with plots (index.html) and the numbers (camera-report.json)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Size of the sensor, where the file does not state it
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub size: Option<Size>,

    /// What the user states about the events
    #[command(flatten)]
    pub events: EventArgs,
}
