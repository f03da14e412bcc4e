//! `pi` and `pair`: the agent on the Raspberry Pi, and its keys.

use super::live::{LiveGenerationArgs, LiveLight};
use clap::Args;
use evrig_pi::cli::ServeOptions;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Arguments of `evrig pi`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig pi --listen 0.0.0.0:7766 --keys ~/agent --spool /var/tmp   # on the Pi\n  \
    evrig pi --events 127.0.0.1:7779 --preset Raw2DVS346             # events instead of frames\n  \
    evrig pi --camera synthetic                                      # a test pattern\n\n\
    It serves one recorder at a time until Ctrl-C; its address is the first line on stdout.\n\
    Beyond this machine it needs keys: see `evrig pair`. The camera needs Raspberry Pi OS with\n\
    python3-picamera2.")]
pub struct PiArgs {
    /// The camera, and where it is served.
    #[command(flatten)]
    pub serve: ServeOptions,

    /// Generate events from the camera's frames here and serve them as AEDAT4 over TCP, instead of
    /// serving the frames
    #[arg(long, value_name = "ADDRESS")]
    pub events: Option<SocketAddr>,

    /// Frames from which events are generated
    #[arg(long, value_enum, value_name = "STREAM", default_value = "raw")]
    pub light: LiveLight,

    /// The rig with the camera settings, for --events: a file, or the name of a bundled one
    #[arg(long, value_name = "RIG", default_value = "sim")]
    pub rig: String,

    /// End after this many seconds, with --events
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// The generator of events.
    #[command(flatten)]
    pub generation: LiveGenerationArgs,
}

/// Arguments of `evrig pair`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig pair\n\n\
    Makes two directories of keys, `host` and `agent`; only they can connect to each other. Run\n\
    it on the host and copy `agent` to the Pi as printed. The certificate authority is deleted:\n\
    to change either half, run `evrig pair` again.")]
pub struct PairArgs {
    /// Output directory (default: evrig/keys in the user's configuration)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
