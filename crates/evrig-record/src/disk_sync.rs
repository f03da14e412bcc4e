//! What was recorded is on the disk soon: a thread beside the writers syncs their files.
//!
//! A writer flushes its bytes to the system several times a second; this thread then makes the
//! system put them on the disk. No writer waits for that, so a slow disk delays disk_sync, not
//! recording. What is on the disk since long the system need not hold in memory any more: a
//! recording of tens of gigabytes would push out all else, and what writes it would wait for memory
//! to be found.

use std::fs::File;
#[cfg(target_os = "linux")]
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Of a file that is synced so many last bytes stay in the system's memory, so that what seals a
/// short recording need not read it from the disk.
const KEPT_BYTES: u64 = 512 << 20;

/// From the end of one sync to the next.
const BETWEEN_SYNCS: Duration = Duration::from_millis(250);

/// What the thread and the writers share.
#[derive(Debug, Default)]
struct SyncMonitor {
    state: Mutex<SyncState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct SyncState {
    files: Vec<(PathBuf, File)>,
    is_ending: bool,
    /// The first refusal.
    failed: Option<String>,
    n_rounds: u64,
}

impl SyncMonitor {
    fn lock(&self) -> MutexGuard<'_, SyncState> {
        // Whole between any two statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread that syncs.
#[derive(Debug)]
pub(super) struct DiskSync {
    shared: Arc<SyncMonitor>,
    thread: Option<JoinHandle<()>>,
}

impl DiskSync {
    /// Starts it; before each round it calls `flush`, and ends once that returns false.
    pub(super) fn start(flush: impl Fn() -> bool + Send + 'static) -> std::io::Result<Self> {
        let shared: Arc<SyncMonitor> = Arc::default();
        let its = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("sync".to_owned())
            .spawn(move || while its.round(&flush) {})?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Syncs this file too from now on, and its name in the folder at once.
    pub(super) fn keep(&self, path: &Path, file: File) -> std::io::Result<()> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        File::open(folder.unwrap_or(Path::new(".")))?.sync_all()?;
        self.shared.lock().files.push((path.to_owned(), file));
        Ok(())
    }

    /// Ends it; what it could not sync comes back in words.
    pub(super) fn finish(&mut self) -> Option<String> {
        self.shared.lock().is_ending = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
        self.shared.lock().failed.take()
    }
}

impl Drop for DiskSync {
    fn drop(&mut self) {
        let _ = self.finish();
    }
}

impl SyncMonitor {
    /// One round; false when it was the last.
    fn round(&self, flush: &impl Fn() -> bool) -> bool {
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), BETWEEN_SYNCS, |state| !state.is_ending)
            .unwrap_or_else(PoisonError::into_inner);
        let (state, _) = waited;
        if state.is_ending {
            return false;
        }
        let handles: Vec<_> =
            state.files.iter().map(|(path, file)| (path.clone(), file.try_clone())).collect();
        drop(state);
        let goes_on = flush();
        for (path, file) in handles {
            if let Err(error) = file.and_then(|file| sync(&file, KEPT_BYTES)) {
                let text = format!("{}: not synced to the disk: {error}", path.display());
                self.lock().failed.get_or_insert(text);
            }
        }
        self.lock().n_rounds += 1;
        self.changed.notify_all();
        goes_on
    }
}

/// Puts a file on the disk and lets go of the memory of all but so many last bytes.
fn sync(file: &File, kept: u64) -> std::io::Result<()> {
    file.sync_data()?;
    #[cfg(target_os = "linux")]
    if let Some(past) = NonZeroU64::new(file.metadata()?.len().saturating_sub(kept)) {
        // An advice: where it is not taken, nothing is lost.
        let _ = rustix::fs::fadvise(file, 0, Some(past), rustix::fs::Advice::DontNeed);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// The type of a file system in memory (statfs(2)).
    #[cfg(target_os = "linux")]
    const TMPFS: i64 = 0x0102_1994;

    #[test]
    fn files_are_flushed_and_synced_again_and_again_until_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let n_flushed: Arc<AtomicU64> = Arc::default();
        let its = Arc::clone(&n_flushed);
        let flush = move || {
            its.fetch_add(1, Ordering::SeqCst);
            true
        };
        let mut disk_sync = DiskSync::start(flush).unwrap();
        disk_sync.keep(&path, File::create(&path).unwrap()).unwrap();
        let state = disk_sync.shared.lock();
        let waited = disk_sync.shared.changed.wait_while(state, |state| state.n_rounds < 2);
        drop(waited.unwrap());
        assert_eq!(disk_sync.finish(), None);
        assert!(n_flushed.load(Ordering::SeqCst) >= 2);
    }

    /// How much of a file the system holds in memory, by `fincore` of util-linux; `None` where
    /// there is none.
    #[cfg(target_os = "linux")]
    fn in_memory(path: &Path) -> Option<u64> {
        let mut fincore = std::process::Command::new("fincore");
        let output =
            fincore.args(["--bytes", "--noheadings", "--output", "RES"]).arg(path).output();
        String::from_utf8(output.ok()?.stdout).ok()?.trim().parse().ok()
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_on_the_disk_is_let_go_of_but_for_its_end() {
        const WRITTEN: u64 = 48 << 20;
        const KEPT: u64 = 16 << 20;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, vec![7; WRITTEN as usize]).unwrap();
        let (file, Some(before)) = (File::open(&path).unwrap(), in_memory(&path)) else {
            return eprintln!("skipped: no fincore (util-linux)");
        };
        sync(&file, WRITTEN).unwrap();
        assert_eq!(in_memory(&path), Some(before), "a short file is kept whole");
        sync(&file, KEPT).unwrap();
        let after = in_memory(&path).unwrap();
        if after == before && rustix::fs::fstatfs(&file).unwrap().f_type == TMPFS {
            return eprintln!("skipped: {} is memory itself", folder.path().display());
        }
        assert!(after < before - (WRITTEN - KEPT) / 2, "{before} before, {after} after");
        assert!(after >= KEPT / 2, "{after} of the last {KEPT} bytes");
    }

    #[test]
    fn a_file_that_cannot_be_synced_is_reported() {
        let (_reader, pipe) = std::io::pipe().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mut disk_sync = DiskSync::start(|| true).unwrap();
        let file = File::from(std::os::fd::OwnedFd::from(pipe));
        disk_sync.keep(&folder.path().join("pipe"), file).unwrap();
        let state = disk_sync.shared.lock();
        drop(disk_sync.shared.changed.wait_while(state, |state| state.n_rounds < 1).unwrap());
        assert!(disk_sync.finish().unwrap().contains("not synced"));
    }
}
