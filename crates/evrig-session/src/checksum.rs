//! SHA-256 of files.

use super::SessionError;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Bytes of a file that are hashed at once: they stay in a core's cache.
const HASHED_BYTES: usize = 1 << 18;

/// A SHA-256 as 64 lower-case hexadecimal digits.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Sha256Hex(String);

impl Sha256Hex {
    fn finish(hasher: Sha256) -> Self {
        Self(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// The digits.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for Sha256Hex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The checksum of bytes in memory.
#[must_use]
pub fn sha256_of_bytes(bytes: &[u8]) -> Sha256Hex {
    let mut hasher = Sha256::new();
    hasher.update(bytes);
    Sha256Hex::finish(hasher)
}

/// The checksum and length of a file.
///
/// # Errors
/// When it cannot be read.
pub fn sha256_of_file(path: &Path) -> Result<(Sha256Hex, u64), SessionError> {
    hash_blocks(path, |_| Ok(true))
}

/// Copies a file and gives its checksum and length, of one reading; of its beginning only where
/// `is_stopped` becomes true.
///
/// # Errors
/// When a file cannot be read or written.
pub(crate) fn copy_with_sha256(
    from: &Path,
    to: &Path,
    is_stopped: &AtomicBool,
) -> Result<(Sha256Hex, u64), SessionError> {
    let mut copy = std::fs::File::create(to).map_err(SessionError::io(to))?;
    hash_blocks(from, |block| {
        copy.write_all(block).map_err(SessionError::io(to))?;
        Ok(!is_stopped.load(Ordering::Relaxed))
    })
}

/// Gives the blocks of a file to `take` until that returns false; returns their checksum and
/// length.
fn hash_blocks(
    path: &Path,
    mut take: impl FnMut(&[u8]) -> Result<bool, SessionError>,
) -> Result<(Sha256Hex, u64), SessionError> {
    let mut file = std::fs::File::open(path).map_err(SessionError::io(path))?;
    let mut hasher = Sha256::new();
    let mut chunk = vec![0; HASHED_BYTES];
    let mut n_bytes = 0;
    loop {
        let n = file.read(&mut chunk).map_err(SessionError::io(path))?;
        hasher.update(&chunk[..n]);
        n_bytes += n as u64;
        if n == 0 || !take(&chunk[..n])? {
            return Ok((Sha256Hex::finish(hasher), n_bytes));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_of_abc_is_the_one_in_the_standard() {
        // FIPS 180-4, example "abc".
        let standard = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256_of_bytes(b"abc").as_str(), standard);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        assert_eq!(sha256_of_file(&path).unwrap(), (sha256_of_bytes(b"abc"), 3));
        let copy = directory.path().join("copy");
        let copied = copy_with_sha256(&path, &copy, &AtomicBool::new(false)).unwrap();
        assert_eq!(copied, (sha256_of_bytes(b"abc"), 3));
        assert_eq!(std::fs::read(&copy).unwrap(), b"abc");
        std::fs::write(&path, vec![7; 3 * HASHED_BYTES]).unwrap();
        let (_, n_bytes) = copy_with_sha256(&path, &copy, &AtomicBool::new(true)).unwrap();
        assert_eq!(n_bytes, HASHED_BYTES as u64);
    }
}
