//! Why the rig's log cannot be written or read.

use std::path::PathBuf;

/// The system's error where there is one.
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
    #[error(
        "{}: writing message {message} failed: {}; what was written before can be read",
        path.display(), reason(source)
    )]
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
        /// Its topic.
        topic: &'static str,
        /// Why not.
        because: String,
    },
    /// A message is not of its topic's schema.
    #[error(
        "{}: message {message} of those read, on {topic}: {because}; `evrig verify` tests whether \
         the file is as it was sealed",
        path.display()
    )]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Its topic.
        topic: &'static str,
        /// Its number among the messages read, from 1.
        message: u64,
        /// Expected and got.
        because: String,
    },
}
