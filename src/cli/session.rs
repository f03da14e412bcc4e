//! Commands about one session: `info`, `verify`, `export`, `report`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Arguments of `evrig info`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  evrig info sessions/street\n  evrig info sessions/street --json | \
        jq '.streams[].count'"
)]
pub struct InfoArgs {
    /// The session
    pub session: PathBuf,
}

/// Arguments of `evrig verify`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  evrig verify sessions/street\n  evrig verify sessions/cut \
        --repair\n\n\
    Exit code 4 when a check fails, 3 when all pass and losses are recorded.")]
pub struct VerifyArgs {
    /// The session
    pub session: PathBuf,

    /// First seal a session whose recording was interrupted (crash, power loss) as recovered
    #[arg(long)]
    pub repair: bool,
}

/// Formats of `evrig export`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormatArg {
    /// NumPy arrays in one file
    Npz,
    /// HDF5 in DSEC's layout, gzip: events/{x,y,t,p}, ms_to_idx, t_offset
    Hdf5,
    /// A table with the columns t, x, y, p
    Parquet,
    /// Text with a heading: t (us), x, y, p
    Csv,
    /// Text in the layout of the Event-Camera Dataset: t (s), x, y, p
    Txt,
    /// A zip of one text, as rpg_e2vid reads it: the sensor's size, then t (s), x, y, p
    Zip,
    /// AEDAT4, for DV and dv-processing
    Aedat4,
    /// EVT 3.0, for Metavision and faery
    Raw,
    /// HDF5 in v2e's layout: events, uint32, N x 4: t (us), x, y, p
    V2e,
    /// MCAP with event_camera_msgs/EventPacket, for ROS 2
    Ros2,
    /// An animation of event images of 20 ms each
    Gif,
    /// The same as a video, which needs ffmpeg
    Mp4,
    /// Event images, frames and the target's outline, for Foxglove and Rerun
    Mcap,
    /// The same in Rerun's own format (in builds with the feature rerun)
    Rrd,
}

/// Which of two streams of one name `evrig export` writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportKind {
    /// The events generated from the frames
    Events,
    /// The frames
    Frames,
}

/// Arguments of `evrig export`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig export sessions/street --stream real --out real.h5\n  \
    evrig export sessions/street --stream aps --kind frames --out aps.npz\n  \
    evrig export sessions/demo --stream raw --canvas 80 --out raw.npz\n  \
    evrig export sessions/demo --stream real --format mcap --out real.mcap\n\n\
    Times are microseconds. FILE.json beside the file holds the event ranges between images, \
    the position of the target, the clocks with their errors, and the seeds.\n\
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

    /// The format [default: by the file name's extension: .npz, .h5, .hdf5, .parquet, .csv, .txt,
    /// .zip, .aedat4, .raw, .mcap, .gif, .mp4, .rrd]
    #[arg(long, value_enum)]
    pub format: Option<ExportFormatArg>,

    /// Events or frames, where both have the name, as frames and the events generated from them
    /// [default: the events]
    #[arg(long, value_enum)]
    pub kind: Option<ExportKind>,

    /// Only the events that `evrig filter` kept, in target coordinates
    #[arg(long)]
    pub filtered: bool,

    /// The filtered events on a square canvas of this many pixels; the paper's has 80
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub canvas: Option<u16>,
}

/// Arguments of `evrig report`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  evrig report sessions/street      # writes \
        sessions/street/report.html\n  evrig report dataset              # a table of its \
        sessions, with links to their reports")]
pub struct ReportArgs {
    /// The session, or a dataset: a folder of sessions
    pub session: PathBuf,

    /// Where to write the page [default: report.html in the session or dataset]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
