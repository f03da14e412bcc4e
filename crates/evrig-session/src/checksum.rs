//! SHA-256 of files.

use super::SessionError;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::Read;
use std::path::Path;

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
    let mut file = std::fs::File::open(path).map_err(SessionError::io(path))?;
    let mut hasher = Sha256::new();
    let mut chunk = vec![0; 1 << 18];
    let mut n_bytes = 0;
    loop {
        match file.read(&mut chunk).map_err(SessionError::io(path))? {
            0 => return Ok((Sha256Hex::finish(hasher), n_bytes)),
            n => {
                hasher.update(&chunk[..n]);
                n_bytes += n as u64;
            }
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
    }
}
