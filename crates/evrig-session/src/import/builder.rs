//! The directory of a session that an import makes.

use crate::{FileEntry, Manifest, SessionError, SessionLayout, Sha256Hex, sha256_of_file};
use std::path::{Path, PathBuf};

/// A session directory under construction; removed again unless it is sealed.
pub(super) struct SessionBuilder {
    pub(super) layout: SessionLayout,
    was_made_here: bool,
    is_sealed: bool,
}

impl SessionBuilder {
    /// Takes an empty or missing directory.
    pub(super) fn take(root: &Path) -> Result<Self, SessionError> {
        let was_made_here = !root.exists();
        if !was_made_here {
            let mut entries = std::fs::read_dir(root).map_err(SessionError::io(root))?;
            if entries.next().is_some() {
                return Err(SessionError::OutputTaken { path: root.to_owned() });
            }
        }
        std::fs::create_dir_all(root).map_err(SessionError::io(root))?;
        Ok(Self { layout: SessionLayout::new(root), was_made_here, is_sealed: false })
    }

    pub(super) fn make_directory(&self, path: &Path) -> Result<(), SessionError> {
        std::fs::create_dir_all(path).map_err(SessionError::io(path))
    }

    /// Checksum and length of a file, under its path inside the session.
    pub(super) fn file_entry(&self, path: &Path) -> Result<(String, FileEntry), SessionError> {
        Ok(self.named_entry(path, sha256_of_file(path)?))
    }

    /// The same of a known checksum and length.
    pub(super) fn named_entry(
        &self,
        path: &Path,
        (sha256, bytes): (Sha256Hex, u64),
    ) -> (String, FileEntry) {
        let inside = path.strip_prefix(self.layout.root()).unwrap_or(path);
        let name = inside.to_string_lossy().replace('\\', "/");
        (name, FileEntry { bytes, sha256, damage: None })
    }

    pub(super) fn seal(mut self, manifest: &Manifest) -> Result<(), SessionError> {
        manifest.seal(&self.layout.manifest())?;
        self.is_sealed = true;
        Ok(())
    }
}

impl Drop for SessionBuilder {
    fn drop(&mut self) {
        if self.is_sealed {
            return;
        }
        // A failed import leaves no files; a failure to remove them is not reported.
        let entries: Vec<PathBuf> = std::fs::read_dir(self.layout.root())
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path())
            .collect();
        for path in entries {
            let _ = if path.is_dir() {
                std::fs::remove_dir_all(&path)
            } else {
                std::fs::remove_file(&path)
            };
        }
        if self.was_made_here {
            let _ = std::fs::remove_dir(self.layout.root());
        }
    }
}
