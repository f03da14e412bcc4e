//! `import`: recordings of other software become sessions.

use clap::{Args, Subcommand};
use evrig_core::geometry::Size;
use evrig_session::import::{
    ColumnOrder, EpochChoice, EventTableOptions, PolarityRule, RawFrameOptions, SamplePacking,
    TimeUnit,
};
use std::path::PathBuf;

/// Arguments of `evrig import`.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Examples:\n  \
    evrig import davis346-street.aedat4 --out sessions/street\n  \
    evrig import shapes_rotation/ --out sessions/shapes\n  \
    evrig import events.csv --time-unit s --size 346x260 --out sessions/events\n\n\
    What had to be decided about the files (units, columns, polarity) is printed and kept in the \
    manifest."
)]
pub struct ImportArgs {
    /// Kind of recording, where it is not to be found out
    #[command(subcommand)]
    pub what: Option<ImportCommand>,

    /// A recording of any kind that is read; see docs/how-to/import-recordings.md
    #[command(flatten)]
    pub any: ImportAnyArgs,
}

/// Arguments of `evrig import PATH`.
#[derive(Debug, Args)]
pub struct ImportAnyArgs {
    /// A recording, a table of events, frames, or a folder of them
    #[arg(required = true)]
    pub path: Option<PathBuf>,

    /// The session directory to create
    #[arg(long, value_name = "SESSION", required = true)]
    pub out: Option<PathBuf>,

    /// Size of the sensor, where the file does not state it
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub size: Option<Size>,

    /// Frames per second of frames without times, as 120 or 30000/1001
    #[arg(long, value_parser = rate, conflicts_with = "timestamps")]
    pub fps: Option<f64>,

    /// Time of each frame, for frames without times; see `evrig import frames --help`
    #[arg(long, value_name = "FILE")]
    pub timestamps: Option<PathBuf>,

    /// What the user states about the events
    #[command(flatten)]
    pub events: EventArgs,

    /// What the user states about frames without a description
    #[command(flatten)]
    pub raw: RawFrameArgs,
}

/// What the user states about frames without a description.
#[derive(Debug, Clone, Args)]
pub struct RawFrameArgs {
    /// Samples of frames in .raw or .bin: 8, raw10 or raw12 (packed as MIPI CSI-2), 16 [default: the
    /// only one that fits the length of the file]
    #[arg(long, value_name = "PACKING")]
    pub packing: Option<SamplePacking>,

    /// Bytes of a row of such frames, with its padding [default: the only one that fits]
    #[arg(long, value_name = "BYTES", value_parser = clap::value_parser!(u32).range(1..))]
    pub stride: Option<u32>,
}

impl RawFrameArgs {
    /// The options of the importing function.
    pub(crate) fn options(&self, size: Option<Size>) -> RawFrameOptions {
        RawFrameOptions { size, stride: self.stride, packing: self.packing }
    }
}

/// What the user states about events.
#[derive(Debug, Clone, Args)]
pub struct EventArgs {
    /// Unit of the times of events in tables: s, ms, us or ns [default: stated by the file, or the
    /// only one that fits]
    #[arg(hide_short_help = true, long, value_name = "UNIT")]
    pub time_unit: Option<TimeUnit>,

    /// Order of the columns of a table, as txyp or -xypt; - is a column to ignore [default: by their
    /// names, or the only order that fits]
    #[arg(hide_short_help = true, long, value_name = "ORDER", allow_hyphen_values = true)]
    pub columns: Option<ColumnOrder>,

    /// Values of ON and OFF in a table, as 1,0 or 1,-1 [default: by the values]
    #[arg(hide_short_help = true, long, value_name = "ON,OFF", allow_hyphen_values = true)]
    pub polarity: Option<PolarityRule>,

    /// Which table, topic or event stream of a file with several; of a ROS recording also the frames
    /// and inertial samples beside the topic
    #[arg(hide_short_help = true, long, value_name = "NAME", visible_alias = "topic")]
    pub table: Option<String>,

    /// Which epoch, where the device's clock restarted: longest, a number from 1, or all
    #[arg(hide_short_help = true, long, value_name = "EPOCH", default_value = "longest")]
    pub epoch: EpochChoice,

    /// Time of the first event on the frames' clock, µs
    #[arg(hide_short_help = true, long, value_name = "US", allow_hyphen_values = true)]
    pub events_begin: Option<i64>,
}

impl EventArgs {
    /// The options of the importing functions.
    pub(crate) fn options(&self) -> EventTableOptions {
        EventTableOptions {
            time_unit: self.time_unit,
            columns: self.columns.clone(),
            polarity: self.polarity,
            table: self.table.clone(),
            epoch: self.epoch,
            begin_us: self.events_begin,
        }
    }
}

/// Recordings that can be imported.
#[derive(Debug, Subcommand)]
pub enum ImportCommand {
    /// A plain DAVIS recording: events, frames, IMU and triggers in one AEDAT4 file
    Aedat4(ImportAedat4Args),
    /// Frames (npy array or folder of images), with events on the same pixel grid if there are any
    Frames(ImportFramesArgs),
    /// A recording in the layout of the published Raw2Event recorder: DAVIS file and Pi frames
    #[command(name = "raw2event")]
    Raw2Event(ImportRaw2EventArgs),
}

/// Arguments of `evrig import aedat4`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  evrig import aedat4 davis346-street.aedat4 --out sessions/street\n\n\
    A truncated or damaged file is imported up to the damage (exit code 3); its bytes are kept unchanged."
)]
pub struct ImportAedat4Args {
    /// The recording
    pub file: PathBuf,

    /// The session directory to create
    #[arg(long, value_name = "SESSION")]
    pub out: PathBuf,

    /// Which epoch, where the camera's clock restarted: longest, a number from 1, or all
    #[arg(long, value_name = "EPOCH", default_value = "longest")]
    pub epoch: EpochChoice,
}

/// Arguments of `evrig import frames`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig import frames clip.npy --fps 120 --out sessions/clip\n  \
    evrig import frames clip/ --timestamps times.csv --events real.npz --out sessions/clip\n  \
    evrig import frames clip.npy --fps 120 --events v2e.h5 --as v2e --out sessions/clip")]
pub struct ImportFramesArgs {
    /// An npy array of N x H x W (uint8 or uint16), a folder of images in name order, or a .raw or .bin
    /// file of samples without a description, which needs --size
    pub frames: PathBuf,

    /// Size of the frames of a .raw or .bin file
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub size: Option<Size>,

    /// What the user states about frames without a description
    #[command(flatten)]
    pub raw: RawFrameArgs,

    /// Frames per second, as 120 or 30000/1001; the first frame is at 0 µs
    #[arg(long, value_parser = rate, required_unless_present = "timestamps")]
    pub fps: Option<f64>,

    /// Time of each frame: npy, or text with one time per line; `names` takes the numbers in the
    /// names of the images
    #[arg(long, value_name = "FILE", conflicts_with = "fps")]
    pub timestamps: Option<PathBuf>,

    /// Unit of --timestamps: s, ms, us or ns [default: stated by the file, or the only one that fits]
    #[arg(long, value_name = "UNIT", conflicts_with = "fps")]
    pub timestamps_unit: Option<TimeUnit>,

    /// Events on the same pixel grid and clock: npz, npy, text, HDF5 or Parquet with columns t, x, y, p;
    /// or AEDAT4
    #[arg(long, value_name = "FILE")]
    pub events: Option<PathBuf>,

    /// Name of the event stream; any name but `real` marks simulated events
    #[arg(long = "as", value_name = "NAME", default_value = "real", requires = "events")]
    pub events_name: String,

    /// The session directory to create
    #[arg(long, value_name = "SESSION")]
    pub out: PathBuf,

    /// What the user states about the events
    #[command(flatten)]
    pub event_options: EventArgs,
}

/// Arguments of `evrig import raw2event`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  evrig import raw2event recordings/ --id 170406 --timezone Europe/Brussels --out sessions/cat\n\n\
    Files are matched by their tag, then by the nearest time. What had to be decided about them \
    (units, bit positions, partial frames) is printed and kept in the manifest."
)]
pub struct ImportRaw2EventArgs {
    /// Directory with dv_output_*.aedat4, metadata_*.dat, raw_frames_*.dat, rgb_frames_*.dat
    pub directory: PathBuf,

    /// Any part of the files' names that only this recording has
    #[arg(long)]
    pub id: String,

    /// Size of the Pi's frames
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "692x520", value_parser = size)]
    pub size: Size,

    /// Time zone of the Pi's wall clock
    #[arg(long, value_name = "ZONE", default_value = "UTC")]
    pub timezone: String,

    /// The session directory to create
    #[arg(long, value_name = "SESSION")]
    pub out: PathBuf,
}

/// Parses `692x520`.
pub(super) fn size(text: &str) -> Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((width, height)) if width > 0 && height > 0 => Ok(Size::new(width, height)),
        _ => Err("expected WIDTHxHEIGHT, as 692x520".into()),
    }
}

/// Frames per second, also as a fraction: `30000/1001`.
fn rate(text: &str) -> Result<f64, String> {
    match text.split_once('/') {
        Some((n, d)) => Ok(positive(n)? / positive(d)?),
        None => positive(text),
    }
}

/// A finite number above zero.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a number above 0".into()),
    }
}
