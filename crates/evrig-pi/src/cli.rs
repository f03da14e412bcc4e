//! Command-line options that `evrig-pi` and `evrig pi` share.

use crate::picamera::Picamera;
use crate::source::{FrameSource, Synthetic};
use clap::{Args, ValueEnum};
use std::net::SocketAddr;
use std::path::PathBuf;

/// How a camera is served: the options that `evrig-pi` and `evrig pi` share.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct ServeOptions {
    /// Where to listen; beyond loopback only with keys
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7766")]
    pub listen: SocketAddr,

    /// The `agent` half of a pair of keys
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,

    /// Buffer for frames that the network cannot carry in time, and for RGB frames until the
    /// recording ends
    #[arg(long, value_name = "DIR")]
    pub spool: Option<PathBuf>,

    /// Size limit of the spool, gigabytes
    #[arg(long, value_name = "GB", default_value_t = 8.0)]
    pub spool_gb: f64,

    /// Where frames come from
    #[arg(long, value_enum, default_value_t = ServedSource::Picamera2)]
    pub camera: ServedSource,

    /// Python interpreter with picamera2
    #[arg(long, value_name = "PROGRAM", default_value = "/usr/bin/python3")]
    pub python: PathBuf,
}

/// A camera of the agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ServedSource {
    /// The Pi's own
    Picamera2,
    /// A test pattern that encodes frame, column and row
    Synthetic,
}

impl ServeOptions {
    /// The camera, which is not started yet.
    #[must_use]
    pub fn source(&self) -> Box<dyn FrameSource> {
        match self.camera {
            ServedSource::Picamera2 => Box::new(Picamera::new(&self.python)),
            ServedSource::Synthetic => Box::new(Synthetic::paced()),
        }
    }
}
