//! `import`: recordings of other software become sessions.

use clap::{Args, Subcommand};
use evrig_core::geometry::Size;
use std::path::PathBuf;

/// Arguments of `evrig import`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// Kind of recording
    #[command(subcommand)]
    pub what: ImportCommand,
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
    A truncated or damaged file is imported up to the damage (exit code 3); its bytes are kept \
    unchanged."
)]
pub struct ImportAedat4Args {
    /// The recording
    pub file: PathBuf,

    /// The session directory to create
    #[arg(long, value_name = "SESSION")]
    pub out: PathBuf,
}

/// Arguments of `evrig import frames`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig import frames clip.npy --fps 120 --out sessions/clip\n  \
    evrig import frames clip/ --timestamps times.csv --events real.npz --out sessions/clip\n  \
    evrig import frames clip.npy --fps 120 --events v2e.npz --as v2e --out sessions/clip")]
pub struct ImportFramesArgs {
    /// An npy array of N x H x W (uint8 or uint16), or a folder of images in name order
    pub frames: PathBuf,

    /// Frames per second; the first frame is at 0 µs
    #[arg(long, value_parser = positive, required_unless_present = "timestamps")]
    pub fps: Option<f64>,

    /// Time of each frame in µs: npy, or text with one number per line
    #[arg(long, value_name = "FILE", conflicts_with = "fps")]
    pub timestamps: Option<PathBuf>,

    /// Events on the same pixel grid and clock: npz, npy, csv or HDF5 with columns t (µs), x, y, p;
    /// or AEDAT4
    #[arg(long, value_name = "FILE")]
    pub events: Option<PathBuf>,

    /// Name of the event stream; any name but `real` marks simulated events
    #[arg(long = "as", value_name = "NAME", default_value = "real", requires = "events")]
    pub events_name: String,

    /// The session directory to create
    #[arg(long, value_name = "SESSION")]
    pub out: PathBuf,
}

/// Arguments of `evrig import raw2event`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig import raw2event recordings/ --id 170406 --timezone \
        Europe/Brussels --out sessions/cat\n\n\
    Files are matched by their tag, then by the nearest time. What had to be decided about them \
    (units, bit positions, partial frames) is printed and kept in the manifest.")]
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
fn size(text: &str) -> Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((width, height)) if width > 0 && height > 0 => Ok(Size::new(width, height)),
        _ => Err("expected WIDTHxHEIGHT, as 692x520".into()),
    }
}

/// A finite number above zero.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a number above 0".into()),
    }
}
