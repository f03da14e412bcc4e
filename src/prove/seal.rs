//! The seal: the truth is stored apart, and only its checksum is kept with the session.

use super::truth::SealedTruth;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The file kept with a session before it is diagnosed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// `evrig.seal/1`.
    pub schema: String,
    /// SHA-256 of the truth's file, byte for byte.
    pub truth_sha256: String,
}

/// Why a seal cannot be set or opened.
#[derive(Debug, thiserror::Error)]
pub enum SealError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is no seal or no truth.
    #[error("{}: {what}; was the file changed?", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The truth is not the one that was sealed.
    #[error(
        "{}: its SHA-256 is {found}, the sealed one is {sealed}; this trial does not count",
        path.display()
    )]
    Broken {
        /// The truth's file.
        path: PathBuf,
        /// Checksum of what is there.
        found: String,
        /// Checksum that was sealed.
        sealed: String,
    },
}

/// Writes the truth to `truth_path` and its seal to `seal_path`.
///
/// # Errors
/// When the disk refuses.
pub fn seal(truth: &SealedTruth, truth_path: &Path, seal_path: &Path) -> Result<Seal, SealError> {
    let text = json(truth, truth_path)?;
    let seal = Seal { schema: "evrig.seal/1".into(), truth_sha256: sha256(text.as_bytes()) };
    write(truth_path, &text)?;
    write(seal_path, &json(&seal, seal_path)?)?;
    Ok(seal)
}

/// Reads a truth and checks it against its seal.
///
/// # Errors
/// When a file is missing or no such file, or the truth is not the one that was sealed.
pub fn open(truth_path: &Path, seal_path: &Path) -> Result<SealedTruth, SealError> {
    let seal = read_seal(seal_path)?;
    let text = read(truth_path)?;
    let (found, sealed) = (sha256(text.as_bytes()), seal.truth_sha256);
    if found != sealed {
        return Err(SealError::Broken { path: truth_path.to_owned(), found, sealed });
    }
    parse(&text, truth_path)
}

/// Reads a seal.
///
/// # Errors
/// When the file is missing or is no seal.
pub(super) fn read_seal(seal_path: &Path) -> Result<Seal, SealError> {
    parse(&read(seal_path)?, seal_path)
}

/// SHA-256 in hexadecimal digits.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn json<T: Serialize>(value: &T, path: &Path) -> Result<String, SealError> {
    serde_json::to_string_pretty(value).map_err(|e| format_error(path, &e))
}

fn parse<T: serde::de::DeserializeOwned>(text: &str, path: &Path) -> Result<T, SealError> {
    serde_json::from_str(text).map_err(|e| format_error(path, &e))
}

fn format_error(path: &Path, error: &serde_json::Error) -> SealError {
    SealError::Format { path: path.to_owned(), what: error.to_string() }
}

fn read(path: &Path) -> Result<String, SealError> {
    std::fs::read_to_string(path).map_err(|source| SealError::Io { path: path.to_owned(), source })
}

fn write(path: &Path, text: &str) -> Result<(), SealError> {
    let io = |source| SealError::Io { path: path.to_owned(), source };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    std::fs::write(path, text).map_err(io)
}

#[cfg(test)]
mod tests {
    use super::super::{Family, TrialMix, draw};
    use super::*;

    #[test]
    fn a_truth_comes_back_and_a_changed_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (truth_path, seal_path) =
            (folder.path().join("truth/a.json"), folder.path().join("a.seal.json"));
        let mix = TrialMix { single: 1, ..TrialMix::none(Family::World) };
        let truth = draw(mix, 5).remove(0).truth;
        seal(&truth, &truth_path, &seal_path).unwrap();
        assert_eq!(open(&truth_path, &seal_path).unwrap(), truth);
        let seal_text = std::fs::read_to_string(&seal_path).unwrap();
        assert!(!seal_text.contains(&truth.effects[0].id), "the seal gives nothing away");
        let text = std::fs::read_to_string(&truth_path).unwrap();
        std::fs::write(&truth_path, text.replacen("strength", "strongth", 1)).unwrap();
        let error = open(&truth_path, &seal_path).unwrap_err();
        assert!(matches!(error, SealError::Broken { .. }), "{error}");
    }
}
