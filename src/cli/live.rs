//! `live`: the live view.

use super::ModelArgs;
use clap::{Args, ValueEnum};
use std::net::SocketAddr;

/// Arguments of `evrig live`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig live rig/lab.toml\n  \
    evrig live sessions/street                 # replays a session\n  \
    evrig live rig/lab.toml --foxglove 127.0.0.1:8765\n  \
    evrig live rig/lab.toml --generate raw --preset Raw2DVS346\n\n\
    DV and dv-processing connect to the AEDAT4 addresses; Foxglove to its own (evrig must be\n\
    built with `--features foxglove`). Ctrl-C ends.")]
pub struct LiveArgs {
    /// The rig (a file, or the name of a bundled one), or a session to replay
    pub what: String,

    /// Where the events are served as AEDAT4 over TCP
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7777")]
    pub events: SocketAddr,

    /// Where the event camera's frames are served as AEDAT4 over TCP
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7778")]
    pub frames: SocketAddr,

    /// Where Foxglove connects
    #[arg(long, value_name = "ADDRESS")]
    pub foxglove: Option<SocketAddr>,

    /// Replay speed of a session
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub pace: f64,

    /// End after this many seconds
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// Generate events from the Pi's frames while they arrive
    #[arg(long, value_enum, value_name = "STREAM")]
    pub generate: Option<LiveLight>,

    /// Where the generated events are served as AEDAT4 over TCP
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7779")]
    pub generated: SocketAddr,

    /// The generator of events.
    #[command(flatten)]
    pub generation: LiveGenerationArgs,
}

/// A stream of the Pi's camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LiveLight {
    /// The raw mosaic
    Raw,
    /// The processed colours
    Rgb,
}

/// Generation of events while frames arrive. Exposure time and gain are always divided out, so that
/// automatic exposure generates no events.
#[derive(Debug, Clone, Args)]
pub struct LiveGenerationArgs {
    /// Frames older than this are dropped and counted
    #[arg(long, value_name = "MS", default_value_t = 50.0)]
    pub latency_ms: f64,

    /// The generator and its parameters.
    #[command(flatten)]
    pub choice: ModelArgs,
}
