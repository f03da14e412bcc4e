//! Errors, and their position in the file.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// A position in a file or stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FilePosition {
    /// The file's path or the stream's name.
    pub name: String,
    /// Bytes before it.
    pub offset: u64,
    /// Number of the packet, from 0; none within the header.
    pub packet: Option<u64>,
    /// Number of the packet's stream, where it is known.
    pub stream: Option<u32>,
}

impl fmt::Display for FilePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: byte {}", self.name, self.offset)?;
        match self.packet {
            Some(packet) => write!(f, ", packet {packet}")?,
            None => write!(f, ", header")?,
        }
        self.stream.map_or(Ok(()), |stream| write!(f, " of stream {stream}"))
    }
}

/// Why an AEDAT4 source could not be read on.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file could not be opened.
    #[error("{}: cannot be opened: {source}; check the path and its permissions", path.display())]
    Open {
        /// The path as given.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The bytes are not what AEDAT4 has at this place: another format, a cut, or damage.
    #[error("{place}: expected {expected}, found {found}; {advice}")]
    Malformed {
        /// Where.
        place: FilePosition,
        /// What the format has there.
        expected: String,
        /// What is there instead.
        found: String,
        /// What to do about it.
        advice: &'static str,
    },
    /// The source failed; more bytes may exist.
    #[error(
        "{place}: reading failed: {source}; what came before is complete, read again for the rest"
    )]
    Io {
        /// Where.
        place: FilePosition,
        /// The system's reason.
        source: io::Error,
    },
}

impl ReadError {
    /// Where it happened; none when the file could not be opened.
    #[must_use]
    pub fn place(&self) -> Option<&FilePosition> {
        match self {
            Self::Open { .. } => None,
            Self::Malformed { place, .. } | Self::Io { place, .. } => Some(place),
        }
    }
}

/// Why an AEDAT4 file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file could not be created.
    #[error("{}: cannot be created: {source}; check the folder and its permissions", path.display())]
    Create {
        /// The path as given.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The destination failed.
    #[error("{name}: writing packet {packet} failed: {source}; the packets before it can be read")]
    Io {
        /// The file's path or the stream's name.
        name: String,
        /// Number of the packet, from 0.
        packet: u64,
        /// The system's reason.
        source: io::Error,
    },
    /// The stream does not carry this.
    #[error("{name}: stream {stream} {found}; give the number of a stream of {expected}")]
    WrongStream {
        /// The file's path or the stream's name.
        name: String,
        /// The number given.
        stream: u32,
        /// What was to be written.
        expected: &'static str,
        /// What the stream carries.
        found: String,
    },
    /// AEDAT4 cannot represent this.
    #[error("{name}: stream {stream}: {found} cannot be written, AEDAT4 holds {limit}")]
    Unrepresentable {
        /// The file's path or the stream's name.
        name: String,
        /// The stream it was meant for.
        stream: u32,
        /// What was to be written.
        found: String,
        /// What the format can hold.
        limit: &'static str,
    },
}
