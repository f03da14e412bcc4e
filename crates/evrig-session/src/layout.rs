//! Paths of a session's files.

use super::SessionError;
use std::path::{Path, PathBuf};

/// Paths inside one session directory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionLayout {
    root: PathBuf,
}

/// A stream's name, safe as a part of a path: letters, digits, `-` and `_`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct StreamName(String);

impl StreamName {
    /// Checks a name given by a user or read from a file.
    ///
    /// # Errors
    /// When it is empty, longer than 64 bytes, or holds any other character.
    pub fn new(name: &str) -> Result<Self, SessionError> {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if (1..=64).contains(&name.len()) && name.chars().all(is_plain) {
            Ok(Self(name.to_owned()))
        } else {
            Err(SessionError::BadName { name: name.escape_default().to_string() })
        }
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for StreamName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl SessionLayout {
    /// The layout of the session at `root`.
    #[must_use]
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// The session's directory.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The rig's log: Pi frames, poses, clock readings.
    #[must_use]
    pub fn rig_log(&self) -> PathBuf {
        self.root.join("rig.mcap")
    }

    /// The manifest, sealed last.
    #[must_use]
    pub fn manifest(&self) -> PathBuf {
        self.root.join("session.json")
    }

    /// The journal: one JSON object per line.
    #[must_use]
    pub fn journal(&self) -> PathBuf {
        self.root.join("journal.jsonl")
    }

    /// What the DAVIS gave.
    #[must_use]
    pub fn davis(&self) -> PathBuf {
        self.root.join("davis.aedat4")
    }

    /// Directory of imported frames.
    #[must_use]
    pub fn frames(&self) -> PathBuf {
        self.root.join("frames")
    }

    /// Directory of an imported event stream.
    #[must_use]
    pub fn stream(&self, name: &StreamName) -> PathBuf {
        self.root.join("streams").join(name.as_str())
    }

    /// Directory of a stage's results, for one stream or for all.
    #[must_use]
    pub fn derived(&self, stage: &str, stream: Option<&StreamName>) -> PathBuf {
        let folder = stream.map_or_else(|| stage.to_owned(), |name| format!("{stage}-{name}"));
        self.root.join("derived").join(folder)
    }

    /// Events that a generator made.
    #[must_use]
    pub fn generated(&self, name: &StreamName) -> PathBuf {
        self.derived("generate", Some(name)).join("events.aedat4")
    }

    /// The report.
    #[must_use]
    pub fn report(&self) -> PathBuf {
        self.root.join("report.html")
    }

    /// The file named in a manifest, which must be inside the session.
    ///
    /// # Errors
    /// When the name is absolute or climbs out of the directory.
    pub fn inside(&self, file: &str) -> Result<PathBuf, SessionError> {
        let relative = Path::new(file);
        let stays =
            relative.components().all(|part| matches!(part, std::path::Component::Normal(_)));
        if stays && !file.is_empty() {
            Ok(self.root.join(relative))
        } else {
            Err(SessionError::Manifest {
                path: self.manifest(),
                what: format!("file `{}` is outside the session", file.escape_default()),
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_leave_its_directory() {
        for bad in ["", "..", "a/b", "a b", "é", &"x".repeat(65)] {
            assert!(StreamName::new(bad).is_err(), "{bad:?}");
        }
        assert_eq!(StreamName::new("aps-tuned_2").unwrap().as_str(), "aps-tuned_2");
    }

    #[test]
    fn a_manifest_cannot_point_outside_its_session() {
        let layout = SessionLayout::new(Path::new("/data/s"));
        for bad in ["/etc/passwd", "../other/davis.aedat4", "a/../../b", ""] {
            assert!(layout.inside(bad).is_err(), "{bad:?}");
        }
        let good = layout.inside("streams/real/events.aedat4").unwrap();
        assert_eq!(good, Path::new("/data/s/streams/real/events.aedat4"));
    }
}
