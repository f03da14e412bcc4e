//! Serving a camera until a signal ends it, as `evrig-pi` and `evrig pi` do.

use crate::agent::{Agent, AgentError, Service, Spool};
use crate::cli::ServeOptions;
use crate::keys::{Keys, KeysError};
use crate::source::SourceError;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io;
use std::path::PathBuf;

/// What users read once the address is known.
pub const SERVING: &str = "serves the camera there to one recorder at a time; Ctrl-C ends it";

/// Why no camera is served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The size of the spool is out of range.
    #[error("--spool-gb is {found}; expected above 0, at most 100000")]
    SpoolSize {
        /// What was asked for.
        found: f64,
    },
    /// The spool does not exist.
    #[error("--spool {} is no directory", path.display())]
    NoSpool {
        /// What was asked for.
        path: PathBuf,
    },
    /// The keys.
    #[error(transparent)]
    Keys(#[from] KeysError),
    /// The agent.
    #[error(transparent)]
    Agent(#[from] AgentError),
    /// Signals cannot be received.
    #[error("cannot receive signals: {0}")]
    Signals(#[from] io::Error),
}

impl ServeError {
    /// Whether the command line is wrong (exit code 2), not the system (1).
    #[must_use]
    pub const fn is_wrong_use(&self) -> bool {
        matches!(
            self,
            Self::SpoolSize { .. }
                | Self::NoSpool { .. }
                | Self::Agent(AgentError::NotLoopback { .. })
        )
    }
}

/// Checks the size of the spool, which is stated even where nothing is spooled.
///
/// # Errors
/// When it is not above 0 and at most 1e5 gigabytes.
pub fn check_spool_size(options: &ServeOptions) -> Result<(), ServeError> {
    let found = options.spool_gb;
    let is_valid = found > 0.0 && found <= 1e5;
    if is_valid { Ok(()) } else { Err(ServeError::SpoolSize { found }) }
}

/// A camera that is served until [`ServedCamera::wait`] returns.
#[derive(Debug)]
pub struct ServedCamera {
    /// `tcp://` or `tls://`, and where the agent listens.
    pub address: String,
    /// What the camera is, or why it cannot be used now. It can be plugged in later: each host that
    /// connects checks it again.
    pub camera: Result<String, SourceError>,
    agent: Agent,
    signals: Signals,
}

impl ServedCamera {
    /// Checks the camera and serves it.
    ///
    /// # Errors
    /// Wrong options, unusable keys, or an address that is taken or needs keys.
    pub fn open(options: &ServeOptions) -> Result<Self, ServeError> {
        let ServeOptions { listen, keys, spool, spool_gb, .. } = options;
        check_spool_size(options)?;
        let mut camera = options.source();
        let mut service = Service::local(*listen);
        service.keys = keys.as_deref().map(Keys::read).transpose()?;
        if let Some(directory) = spool {
            if !directory.is_dir() {
                return Err(ServeError::NoSpool { path: directory.clone() });
            }
            let limit_bytes = (spool_gb * 1e9) as u64;
            service.limits.spool = Some(Spool { directory: directory.clone(), limit_bytes });
        }
        let checked = camera.check();
        // Signals are received before the address is known to anybody, so that none is lost.
        let signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        let scheme = if service.keys.is_some() { "tls" } else { "tcp" };
        let agent = Agent::open(service, camera)?;
        let address = format!("{scheme}://{}", agent.address());
        Ok(Self { address, camera: checked, agent, signals })
    }

    /// Serves until SIGINT, SIGTERM or SIGHUP.
    pub fn wait(mut self) {
        self.signals.forever().next();
        drop(self.agent);
    }
}
