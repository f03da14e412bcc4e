//! The sessions below a directory.

use super::BatchError;
use evrig_session::Session;
use std::path::{Path, PathBuf};

/// Folders between a dataset and its sessions.
const MAX_DEPTH: usize = 4;

/// A directory that should be a session.
#[derive(Debug)]
pub struct FoundSession {
    /// Its path in the dataset, with `/` between the parts: its name in every table.
    pub key: String,
    /// Where it is.
    pub path: PathBuf,
    /// The session, or why it is none.
    pub session: Result<Session, String>,
}

impl FoundSession {
    /// A message with the session's path on this machine replaced by its path in the dataset, so
    /// that results do not depend on the machine.
    #[must_use]
    pub fn relative(&self, text: &str) -> String {
        text.replace(&self.path.display().to_string(), &self.key)
    }
}

/// Whether a directory is a dataset and no session: it holds no manifest, nor anything a recorder
/// leaves, but folders.
#[must_use]
pub fn is_dataset(path: &Path) -> bool {
    path.is_dir() && !is_candidate(path)
}

/// The sessions of a dataset, in the order of their paths, broken ones among them.
///
/// # Errors
/// When the directory cannot be read, or holds no session.
pub fn walk(root: &Path) -> Result<Vec<FoundSession>, BatchError> {
    let mut paths = Vec::new();
    collect(root, MAX_DEPTH, &mut paths)?;
    if paths.is_empty() {
        return Err(BatchError::NoDataset {
            root: root.to_owned(),
            what: "no folder in it holds a session.json; name a session, or a folder of sessions"
                .into(),
        });
    }
    let mut found: Vec<FoundSession> = paths.into_iter().map(|path| open(root, path)).collect();
    found.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(found)
}

fn open(root: &Path, path: PathBuf) -> FoundSession {
    let inside = path.strip_prefix(root).unwrap_or(&path);
    let parts: Vec<_> =
        inside.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    let key = parts.join("/");
    let mut found = FoundSession { key, path, session: Err(String::new()) };
    found.session = Session::open(&found.path).map_err(|error| found.relative(&error.to_string()));
    found
}

fn collect(folder: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> Result<(), BatchError> {
    let entries = std::fs::read_dir(folder).map_err(BatchError::io(folder))?;
    for entry in entries {
        let entry = entry.map_err(BatchError::io(folder))?;
        let (path, name) = (entry.path(), entry.file_name());
        let is_ours = name.to_string_lossy().starts_with('.') || name == "batch";
        if is_ours || !path.is_dir() {
            continue;
        }
        if is_candidate(&path) {
            paths.push(path);
        } else if depth > 1 {
            collect(&path, depth - 1, paths)?;
        }
    }
    Ok(())
}

/// A manifest, or what a recorder leaves that was cut off before it wrote one.
fn is_candidate(path: &Path) -> bool {
    ["session.json", "journal.jsonl", "davis.aedat4", "rig.mcap"]
        .iter()
        .any(|file| path.join(file).is_file())
}
