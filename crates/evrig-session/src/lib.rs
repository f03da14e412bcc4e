//! The on-disk contract: one recording is one directory.
//!
//! ```text
//! <session>/
//!   session.json     manifest: what was recorded with what, streams, checksums, losses
//!   davis.aedat4     events, APS frames, IMU as the camera gave them
//!   rig.mcap         Pi frames and metadata, arm poses, commanded path, clock readings, log
//!   frames/          imported frames (npy) with their timestamps
//!   streams/<name>/  imported events
//!   journal.jsonl    what happened, when
//!   derived/<stage>[-<stream>]/   results with the stage.json that tells how they came about
//! ```
//! Recorded files are never rewritten: whatever is wrong in them (a cut tail, events off
//! the sensor, disorder) is counted when they are read and said in the manifest.

mod census;
mod checksum;
mod heard;
pub mod import;
mod journal;
mod layout;
mod manifest;
mod pictures;
mod read;
mod recording;
mod repair;
pub mod rig;
mod rig_log;
mod stage;
pub mod trajectory;
mod verify;

pub use census::{Census, StreamCensus, census};
pub use checksum::{Sha256Hex, sha256_of_bytes, sha256_of_file};
pub use heard::{EventSum, Heard, PictureSum};
pub use journal::Journal;
pub use layout::{Layout, StreamName};
pub use manifest::write_whole;
pub use manifest::{
    Damage, DeviceEntry, FileEntry, Loss, Manifest, Origin, Recording, SCHEMA, Status, StreamEntry,
    StreamKind,
};
pub use pictures::{DavisPictures, PiPictures, PiStamps, Picture, PictureFacts};
pub use read::{Ascending, EventTally, LuminanceFrames};
pub use recording::seal_recording;
pub use repair::{Repair, repair};
pub use rig_log::{
    Arrival, ClockExchange, HostTime, PacketArrival, RigLogError, RigLogWriter, RigNotes, Severity,
    TimedPose, Topic,
};
pub use rig_log::{picture_message, picture_schema};
pub use stage::{StageRecord, read_stage, write_stage};
pub use verify::{Verification, verify};

use std::path::{Path, PathBuf};

/// A sealed session, opened for reading.
#[derive(Debug, Clone)]
pub struct Session {
    layout: Layout,
    manifest: Manifest,
}

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
        /// What was looked for.
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
        /// Which file, and what the system says.
        what: String,
    },
    /// A name that cannot be a directory.
    #[error("`{name}` cannot name a stream: use 1 to 64 letters, digits, `-` or `_`")]
    BadName {
        /// The name.
        name: String,
    },
    /// The target of an import is taken.
    #[error("{path} is there already and is not empty; choose another --out or remove it", path = path.display())]
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
        /// What the system says.
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

impl Session {
    /// Opens a sealed session.
    ///
    /// # Errors
    /// When the directory is missing or holds no manifest that this version understands.
    pub fn open(root: &Path) -> Result<Self, SessionError> {
        let layout = Layout::new(root);
        let not_a_session =
            |what: &str| SessionError::NotASession { root: root.to_owned(), what: what.to_owned() };
        if root.is_file() {
            return Err(not_a_session(
                "it is a file and a session is a directory; make one of a recording with `evrig import aedat4`",
            ));
        }
        if !root.is_dir() {
            return Err(not_a_session("there is no such directory"));
        }
        let path = layout.manifest();
        if !path.exists() {
            return Err(not_a_session(
                "it has no session.json; make one with `evrig import` or `evrig record`, or seal a \
                 recording that was cut off with `evrig verify --repair`",
            ));
        }
        let manifest = Manifest::read(&path)?;
        Ok(Self { layout, manifest })
    }

    /// Where the session's files are.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// What the session says of itself.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The session's directory.
    #[must_use]
    pub fn root(&self) -> &Path {
        self.layout.root()
    }

    /// The recorded or imported stream of that name and kind.
    ///
    /// # Errors
    /// When there is none; the error lists those there are.
    pub fn stream(&self, kind: StreamKind, name: &str) -> Result<&StreamEntry, SessionError> {
        let of_kind = || self.manifest.streams.iter().filter(move |stream| stream.kind == kind);
        of_kind().find(|stream| stream.name == name).ok_or_else(|| {
            let names: Vec<&str> = of_kind().map(|stream| stream.name.as_str()).collect();
            SessionError::NoSuchStream {
                root: self.root().to_owned(),
                kind,
                name: name.to_owned(),
                known: if names.is_empty() { "none".into() } else { names.join(", ") },
            }
        })
    }
}
