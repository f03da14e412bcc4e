//! The stages that put a session on one clock and one target: `sync`, `track`, `filter`.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig sync`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig sync sessions/street\n\n\
    Estimates the map from the Pi's SensorTimestamp to Unix time and to the event timestamps, by \
    every method that the session's clock readings and frames allow, and reports their \
    disagreements. Where both cameras have a track (`evrig track`), their common motion refines \
    the map.")]
pub struct SyncArgs {
    /// The session
    pub session: PathBuf,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// Arguments of `evrig track`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  evrig track sessions/street\n  \
    evrig track sessions/street --stream raw\n  \
    evrig track sessions/imported --stream aps --rig rig/lab.toml")]
pub struct TrackArgs {
    /// The session
    pub session: PathBuf,

    /// The frames: aps, raw, rgb or frames [default: all that the session has]
    #[arg(long, value_name = "NAME")]
    pub stream: Option<String>,

    /// The rig with target and lenses, for sessions that state none
    #[arg(long, value_name = "RIG")]
    pub rig: Option<String>,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// Arguments of `evrig scene`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig scene sessions/street\n\n\
    Needs `evrig track` (raw and aps) and `evrig sync`. Reconstructs the target from the Pi's raw \
    frames, the path of the cameras over it, and the pose of the event camera relative to the Pi \
    camera; from these follows the log-intensity signal of each event pixel at any time.")]
pub struct SceneArgs {
    /// The session
    pub session: PathBuf,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// Arguments of `evrig filter`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  evrig filter sessions/street\n  \
    evrig filter sessions/street --stream real --crop 88 --hot-pixel\n  \
    evrig filter sessions/plain --no-region --background-us 5000 --refractory-us 500\n\n\
    Order: hot pixels, background, refractory, region, rate. The same settings apply to real and \
    generated streams; filtering only one would introduce a difference.")]
pub struct FilterArgs {
    /// The session
    pub session: PathBuf,

    /// The event stream [default: every one the session has]
    #[arg(long, value_name = "NAME")]
    pub stream: Option<String>,

    /// Which filters run.
    #[command(flatten)]
    pub choice: FilterChoice,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// Which filters run.
#[derive(Debug, Clone, Copy, Args)]
pub struct FilterChoice {
    /// Keep the whole sensor instead of the tracked target
    #[arg(long, conflicts_with_all = ["margin", "crop"])]
    pub no_region: bool,

    /// Margin around the target, as a share of its side
    #[arg(long, value_name = "SHARE", default_value_t = 0.03)]
    pub margin: f64,

    /// Transform events to target coordinates: a square of this many pixels
    #[arg(long, value_name = "PX")]
    pub crop: Option<u16>,

    /// Remove hot pixels
    #[arg(long)]
    pub hot_pixel: bool,

    /// Drop events without an event of a neighbouring pixel within this many microseconds before
    #[arg(long, value_name = "US")]
    pub background_us: Option<i64>,

    /// Drop events within this many microseconds after the last kept one of the pixel
    #[arg(long, value_name = "US")]
    pub refractory_us: Option<i64>,

    /// Limit the stream to this many events per millisecond
    #[arg(long, value_name = "N")]
    pub max_events_per_ms: Option<u64>,
}
