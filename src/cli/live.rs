//! `live`: what the devices see now.

use super::ModelArgs;
use clap::{Args, ValueEnum};
use std::net::SocketAddr;

/// Arguments of `evrig live`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig live rig/lab.toml\n  \
    evrig live sessions/street                 # plays a session\n  \
    evrig live rig/lab.toml --foxglove 127.0.0.1:8765\n  \
    evrig live rig/lab.toml --generate raw --preset Raw2DVS346\n\n\
    DV and dv-processing connect to the AEDAT4 addresses; Foxglove to its own (evrig must be built\n\
    with `--features foxglove`). Ctrl-C ends.")]
pub struct LiveArgs {
    /// The rig (a file, or the name of a bundled one), or a session to play
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

    /// Play a session so many times as fast
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub pace: f64,

    /// End after so many seconds
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// Generate events from the Pi's frames while they arrive
    #[arg(long, value_enum, value_name = "LIGHT")]
    pub generate: Option<LiveLight>,

    /// Where the generated events are served as AEDAT4 over TCP
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7779")]
    pub generated: SocketAddr,

    /// How generated events come about.
    #[command(flatten)]
    pub generation: LiveGenerationArgs,
}

/// A picture of the Pi's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LiveLight {
    /// The raw mosaic
    Raw,
    /// The processed colours
    Rgb,
}

/// How events are generated while frames arrive. Exposure time and gain are always divided out, so
/// that a camera that adapts them makes no events by it.
#[derive(Debug, Clone, Args)]
pub struct LiveGenerationArgs {
    /// Frames older than this are left out and counted
    #[arg(long, value_name = "MS", default_value_t = 50.0)]
    pub latency_ms: f64,

    /// What decides the generated events.
    #[command(flatten)]
    pub choice: ModelArgs,
}
