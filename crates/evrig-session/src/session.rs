//! A sealed session, opened for reading.

use super::{Manifest, SessionError, SessionLayout, StreamEntry, StreamKind};
use std::path::Path;

/// A sealed session, opened for reading.
#[derive(Debug, Clone)]
pub struct Session {
    layout: SessionLayout,
    manifest: Manifest,
}

impl Session {
    /// Opens a sealed session.
    ///
    /// # Errors
    /// When the directory is missing or holds no manifest that this version understands.
    pub fn open(root: &Path) -> Result<Self, SessionError> {
        let layout = SessionLayout::new(root);
        let not_a_session =
            |what: &str| SessionError::NotASession { root: root.to_owned(), what: what.to_owned() };
        if root.is_file() {
            return Err(not_a_session(
                "it is a file and a session is a directory; make one of a recording with `evrig \
                 import aedat4`",
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
    pub fn layout(&self) -> &SessionLayout {
        &self.layout
    }

    /// The manifest.
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
                known: if names.is_empty() {
                    format!("no stream of {kind}; `evrig info` lists its streams")
                } else {
                    names.join(", ")
                },
            }
        })
    }
}
