//! `pi` and `pair`: the agent on the Raspberry Pi, and its keys.

use super::live::{LiveGenerationArgs, LiveLight};
use clap::{Args, ValueEnum};
use std::net::SocketAddr;
use std::path::PathBuf;

/// Arguments of `evrig pi`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig pi --listen 0.0.0.0:7766 --keys ~/agent --spool /var/tmp   # on the Pi\n  \
    evrig pi --events 127.0.0.1:7779 --preset Raw2DVS346             # events instead of frames\n  \
    evrig pi --camera synthetic                                      # a pattern, to try the wire\n\n\
    It serves one recorder at a time until Ctrl-C; its address is the first line on stdout.\n\
    Beyond this machine it needs keys: see `evrig pair`. The camera needs Raspberry Pi OS with\n\
    python3-picamera2.")]
pub struct PiArgs {
    /// Where to listen; beyond loopback only with keys
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7766")]
    pub listen: SocketAddr,

    /// The `agent` half of a pair of keys
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,

    /// Where frames wait that the network is too slow for, and RGB frames until the take is over
    #[arg(long, value_name = "DIR")]
    pub spool: Option<PathBuf>,

    /// How much the spool may hold, gigabytes
    #[arg(long, value_name = "GB", default_value_t = 8.0)]
    pub spool_gb: f64,

    /// Where frames come from
    #[arg(long, value_enum, default_value_t = PiCamera::Picamera2)]
    pub camera: PiCamera,

    /// The Python that has picamera2
    #[arg(long, value_name = "PROGRAM", default_value = "/usr/bin/python3")]
    pub python: PathBuf,

    /// Generate events from the camera's frames here and serve them as AEDAT4 over TCP, instead of
    /// serving the frames
    #[arg(long, value_name = "ADDRESS")]
    pub events: Option<SocketAddr>,

    /// Which frames the events are made of
    #[arg(long, value_enum, value_name = "LIGHT", default_value = "raw")]
    pub light: LiveLight,

    /// The rig whose camera settings hold, with --events: a file, or the name of a bundled one
    #[arg(long, value_name = "RIG", default_value = "sim")]
    pub rig: String,

    /// End after so many seconds, with --events
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,

    /// How the events come about.
    #[command(flatten)]
    pub generation: LiveGenerationArgs,
}

/// A camera of the agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PiCamera {
    /// The Pi's own
    Picamera2,
    /// A pattern that tells frame, column and row apart
    Synthetic,
}

/// Arguments of `evrig pair`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig pair\n\n\
    Makes two directories of keys, `host` and `agent`; only they can talk to each other. Run it on\n\
    the host and copy `agent` to the Pi, as it then says. The authority that signed them is thrown\n\
    away: to change either half, pair anew.")]
pub struct PairArgs {
    /// Where to put them (default: the user's configuration, evrig/keys)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
