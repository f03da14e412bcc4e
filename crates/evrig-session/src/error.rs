//! Why a session cannot be made, opened or read.

use super::{RigLogError, StreamKind};
use std::path::{Path, PathBuf};

/// Why a session cannot be made, opened or read.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The directory is not a session.
    #[error("{root} is not a session: {what}", root = root.display())]
    NotASession {
        /// The directory.
        root: PathBuf,
        /// What is missing and what to do.
        what: String,
    },
    /// The manifest cannot be understood.
    #[error("{path}: {what}", path = path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A stream that the session does not have.
    #[error("{root} has no {kind} stream `{name}`; it has: {known}", root = root.display())]
    NoSuchStream {
        /// The session.
        root: PathBuf,
        /// The kind asked for.
        kind: StreamKind,
        /// Its name.
        name: String,
        /// What there is.
        known: String,
    },
    /// A stream whose stamps are not on the events' clock.
    #[error(
        "stream `{name}` of {root} is on the clock `{clock}`, which is not the one asked for; \
         `evrig sync` finds the map between the two",
        root = root.display()
    )]
    OtherClock {
        /// The session.
        root: PathBuf,
        /// The stream.
        name: String,
        /// Its clock.
        clock: String,
    },
    /// Another process has the session.
    #[error(
        "{path} is being recorded by another evrig; wait for its end, or stop that one first",
        path = path.display()
    )]
    Busy {
        /// The journal, which its recorder holds.
        path: PathBuf,
    },
    /// The disk took data and did not keep it.
    #[error("{what}; what was recorded may be lost when the power fails")]
    Unsynced {
        /// The file and the system's error.
        what: String,
    },
    /// A name that cannot be a directory.
    #[error("`{name}` cannot name a stream: use 1 to 64 letters, digits, `-` or `_`")]
    BadName {
        /// The name.
        name: String,
    },
    /// The target of an import is taken.
    #[error(
        "{path} is there already and is not empty; choose another --out or remove it",
        path = path.display()
    )]
    OutputTaken {
        /// The directory.
        path: PathBuf,
    },
    /// What was to be imported is not what it should be.
    #[error("{path}: {what}", path = path.display())]
    Import {
        /// The file or directory.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// The system refused.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// An AEDAT4 file cannot be read.
    #[error(transparent)]
    Aedat4Read(#[from] evrig_format::aedat4::ReadError),
    /// An AEDAT4 file cannot be written.
    #[error(transparent)]
    Aedat4Write(#[from] evrig_format::aedat4::WriteError),
    /// The rig's log cannot be read or written.
    #[error(transparent)]
    RigLog(#[from] RigLogError),
    /// An array file cannot be read or written.
    #[error(transparent)]
    Npy(#[from] evrig_format::npy::NpyError),
    /// A camera's own file cannot be read.
    #[error(transparent)]
    CameraFile(#[from] evrig_format::CameraFileError),
    /// An HDF5 file cannot be read.
    #[error(transparent)]
    Hdf5(#[from] evrig_format::hdf5::Hdf5Error),
}

impl SessionError {
    /// Adds the path to an error of the file system.
    pub fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::Io { path: path.to_owned(), source }
    }

    /// A file that cannot be imported, and why.
    pub fn import(path: &Path, what: impl Into<String>) -> Self {
        Self::Import { path: path.to_owned(), what: what.into() }
    }
}
