//! Why the rig's log cannot be written or read.

use std::path::PathBuf;

/// What the system says where it is the system that says something.
fn reason(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(system) => system.to_string(),
        other => other.to_string(),
    }
}

/// Why the rig's log cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RigLogError {
    /// The file cannot be made or opened.
    #[error("{}: {source}; check the folder and its permissions", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Writing failed.
    #[error("{}: writing message {message} failed: {}; what was written before can be read", path.display(), reason(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// Messages before it.
        message: u64,
        /// The reason.
        source: Box<mcap::McapError>,
    },
    /// A record cannot be put into its encoding.
    #[error("{}: a message for {topic} cannot be encoded: {because}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Where it was to go.
        topic: &'static str,
        /// Why not.
        because: String,
    },
    /// A message is not what its topic says.
    #[error("{}: message {message} of those read, on {topic}: {because}; `evrig verify` says whether the file is as it was sealed", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where it stands.
        topic: &'static str,
        /// Its number among the messages read, from 1.
        message: u64,
        /// Expected and got.
        because: String,
    },
}
