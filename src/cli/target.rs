//! The stages that put a session on one clock and one target: `sync`, `track`, `filter`.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig sync`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig sync sessions/street\n\n\
    Finds the map from the Pi's SensorTimestamp to Unix time and to the events' stamps, by every method \
    that the session's clock readings and frames allow, and says how far they agree. Where both cameras \
    have a track (`evrig track`), the motion that both saw decides.")]
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

    /// The rig whose target and lenses to go by, for sessions that state none
    #[arg(long, value_name = "RIG")]
    pub rig: Option<String>,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// Arguments of `evrig scene`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig scene sessions/street\n\n\
    Needs `evrig track` (raw and aps) and `evrig sync`. Makes a map of the print from the Pi's raw frames, \
    the path of the head over it, and the place of the event camera beside the Pi camera; from these \
    follows the light that each event pixel saw at any time.")]
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
    Order: hot pixels, background, refractory, region, rate. The same settings go over real and \
    generated streams; filtering one only would plant a difference.")]
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
    /// Keep the whole sensor instead of the tracked picture
    #[arg(long, conflicts_with_all = ["margin", "crop"])]
    pub no_region: bool,

    /// How far beyond the picture events are kept, as a share of its side
    #[arg(long, value_name = "SHARE", default_value_t = 0.03)]
    pub margin: f64,

    /// Move events into the picture's own coordinates: a square of so many pixels
    #[arg(long, value_name = "PX")]
    pub crop: Option<u16>,

    /// Leave out pixels that fire far more often than the rest
    #[arg(long)]
    pub hot_pixel: bool,

    /// Drop events without an event of a neighbour in so many microseconds before them
    #[arg(long, value_name = "US")]
    pub background_us: Option<i64>,

    /// Drop events sooner than so many microseconds after the last kept one of their pixel
    #[arg(long, value_name = "US")]
    pub refractory_us: Option<i64>,

    /// Thin the stream to so many events a millisecond
    #[arg(long, value_name = "N")]
    pub max_events_per_ms: Option<u64>,
}
