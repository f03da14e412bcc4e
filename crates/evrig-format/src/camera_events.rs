//! Events of a file whose format states what its bytes mean.

use evrig_core::event::Events;
use evrig_core::geometry::Size;
use std::path::{Path, PathBuf};

/// Events of a camera's own format, up to a cut.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraEvents {
    /// In the file's order.
    pub events: Events,
    /// The sensor, where the file states it.
    pub size: Option<Size>,
    /// What else the file holds and was left out, with its number.
    pub left_out: Vec<(String, u64)>,
    /// Where reading had to stop.
    pub damage: Option<String>,
    /// What had to be decided about the file.
    pub decisions: Vec<String>,
}

/// Why a file gives no events.
#[derive(Debug, thiserror::Error)]
pub enum CameraFileError {
    /// The file cannot be read.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The place that the contents go to refuses them.
    #[error("{0}")]
    Sink(String),
    /// The content is not of the expected format.
    #[error("{path}: {what}", path = path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
}

impl CameraFileError {
    /// Adds the path to an error of the file system.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::Io { path: path.to_owned(), source }
    }

    pub(crate) fn format(path: &Path, what: impl Into<String>) -> Self {
        Self::Format { path: path.to_owned(), what: what.into() }
    }
}

impl CameraEvents {
    /// Counts something that is left out.
    pub(crate) fn leave_out(&mut self, what: &str, count: u64) {
        match self.left_out.iter_mut().find(|(known, _)| known == what) {
            Some((_, n)) => *n += count,
            None if count > 0 => self.left_out.push((what.to_owned(), count)),
            None => {}
        }
    }
}
