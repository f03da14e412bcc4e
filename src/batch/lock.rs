//! One process at a time: locks that end with the process, however it ends.

use super::BatchError;
use evrig_session::Session;
use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::Path;

/// A lock, held until it is dropped.
#[derive(Debug)]
pub struct LockGuard {
    file: File,
}

/// Locks a dataset against another run over it, on this machine or, where the file system carries
/// locks across, on any.
///
/// # Errors
/// When another process has it, or nothing can be written there.
pub fn lock_dataset(root: &Path) -> Result<LockGuard, BatchError> {
    let folder = root.join("batch");
    std::fs::create_dir_all(&folder).map_err(BatchError::io(&folder))?;
    lock(root, &folder.join("lock"))
}

/// Locks a session against another run of its stages.
///
/// # Errors
/// When another process has it, or nothing can be written there.
pub fn lock_session(session: &Session) -> Result<LockGuard, BatchError> {
    let folder = session.root().join("derived");
    std::fs::create_dir_all(&folder).map_err(BatchError::io(&folder))?;
    lock(session.root(), &folder.join("lock"))
}

fn lock(what: &Path, path: &Path) -> Result<LockGuard, BatchError> {
    let open = File::options().read(true).write(true).create(true).truncate(false).open(path);
    let mut file = open.map_err(BatchError::io(path))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut whom = String::new();
            let _ = (&mut file).take(200).read_to_string(&mut whom);
            let whom = if whom.is_empty() { "another evrig".to_owned() } else { whom };
            return Err(BatchError::Busy { path: what.to_owned(), whom });
        }
        Err(TryLockError::Error(source)) => return Err(BatchError::io(path)(source)),
    }
    file.set_len(0).map_err(BatchError::io(path))?;
    let whom = format!("process {} on {}", std::process::id(), host());
    file.write_all(whom.as_bytes()).map_err(BatchError::io(path))?;
    Ok(LockGuard { file })
}

fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    if name.trim().is_empty() { "this machine".into() } else { name.trim().to_owned() }
}

impl Drop for LockGuard {
    fn drop(&mut self) {
        // An empty file does not describe a run that is over; the lock itself ends with the file.
        let _ = self.file.set_len(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_is_refused_and_names_who_has_the_dataset() {
        let directory = tempfile::tempdir().unwrap();
        let held = lock_dataset(directory.path()).unwrap();
        let error = lock_dataset(directory.path()).unwrap_err().to_string();
        assert!(error.contains(&format!("process {}", std::process::id())), "{error}");
        drop(held);
        lock_dataset(directory.path()).unwrap();
    }
}
