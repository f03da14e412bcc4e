//! `import`: recordings made elsewhere become sessions.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Arguments of `evrig import`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// What kind of recording
    #[command(subcommand)]
    pub what: ImportCommand,
}

/// Recordings that can be imported.
#[derive(Debug, Subcommand)]
pub enum ImportCommand {
    /// A plain DAVIS recording: events, frames, IMU and triggers in one AEDAT4 file
    Aedat4(ImportAedat4Args),
    /// Frames (npy array or folder of images), with events of the same pixel grid if there are any
    Frames(ImportFramesArgs),
}

/// Arguments of `evrig import aedat4`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  evrig import aedat4 davis346-street.aedat4 --out sessions/street\n\n\
    A cut or damaged file is taken up to the damage (exit code 3); its bytes are kept as they are."
)]
pub struct ImportAedat4Args {
    /// The recording
    pub file: PathBuf,

    /// The session directory to make
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
    /// An npy array of N x H x W (uint8 or uint16), or a folder of images in the order of their names
    pub frames: PathBuf,

    /// Frames per second; the first frame is at 0 µs
    #[arg(long, value_parser = positive, required_unless_present = "timestamps")]
    pub fps: Option<f64>,

    /// Time of each frame in µs: npy, or text with one number a line
    #[arg(long, value_name = "FILE", conflicts_with = "fps")]
    pub timestamps: Option<PathBuf>,

    /// Events of the same pixel grid and clock: npz, npy, csv or HDF5 with columns t (µs), x, y, p; or AEDAT4
    #[arg(long, value_name = "FILE")]
    pub events: Option<PathBuf>,

    /// Name of the events' stream; any name but `real` makes them events simulated elsewhere
    #[arg(long = "as", value_name = "NAME", default_value = "real", requires = "events")]
    pub events_name: String,

    /// The session directory to make
    #[arg(long, value_name = "SESSION")]
    pub out: PathBuf,
}

/// A finite number above zero.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a number above 0".into()),
    }
}
