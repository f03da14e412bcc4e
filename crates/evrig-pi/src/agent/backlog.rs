//! Messages that wait for the network: in memory, and beyond that on disk, always in order.

use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// BacklogLimits for what waits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BacklogLimits {
    /// Bytes in memory at most, or a single larger message.
    pub memory_bytes: usize,
    /// Where what does not fit goes; none to drop it.
    pub spool: Option<Spool>,
}

/// A spool file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spool {
    /// A directory; the file in it has no name, so nothing stays behind, however the agent ends.
    pub directory: PathBuf,
    /// Bytes at most.
    pub limit_bytes: u64,
}

/// Where a message went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stored {
    Memory,
    Disk,
    Nowhere,
}

/// A queue with one reader.
#[derive(Debug)]
pub(super) struct Backlog {
    state: Mutex<BacklogState>,
    changed: Notify,
    limits: BacklogLimits,
}

#[derive(Debug)]
struct BacklogState {
    memory: VecDeque<Vec<u8>>,
    n_memory: usize,
    spill: Option<Spill>,
    is_closed: bool,
}

/// The part on disk: whole messages one after the other in a file that is written round and round;
/// their lengths stay in memory.
#[derive(Debug)]
struct Spill {
    file: Arc<File>,
    lengths: VecDeque<usize>,
    /// Bytes read and written since the file was last empty.
    read_at: u64,
    write_at: u64,
    limit: u64,
}

impl Spill {
    fn has_room(&self, length: usize) -> bool {
        self.write_at - self.read_at + length as u64 <= self.limit
    }

    fn push(&mut self, message: &[u8]) -> io::Result<()> {
        let (place, before_end) = place(self.write_at, message.len(), self.limit);
        let (first, second) = message.split_at(before_end);
        self.file.write_all_at(first, place)?;
        self.file.write_all_at(second, 0)?;
        self.write_at += message.len() as u64;
        self.lengths.push_back(message.len());
        Ok(())
    }
}

/// Where in a round file bytes begin, and how many of them come before its end.
fn place(at: u64, length: usize, limit: u64) -> (u64, usize) {
    let place = at % limit.max(1);
    (place, usize::try_from(limit - place).unwrap_or(usize::MAX).min(length))
}

enum Next {
    Ready(Vec<u8>),
    OnDisk { file: Arc<File>, at: u64, length: usize, limit: u64 },
    Empty,
    Over,
}

impl Backlog {
    /// Opens the spool, if there is one.
    ///
    /// # Errors
    /// When no file can be made there.
    pub(super) fn new(limits: BacklogLimits) -> io::Result<Self> {
        let spill = match &limits.spool {
            None => None,
            Some(spool) => Some(Spill {
                file: Arc::new(nameless(&spool.directory)?),
                lengths: VecDeque::new(),
                read_at: 0,
                write_at: 0,
                limit: spool.limit_bytes,
            }),
        };
        let state = BacklogState { memory: VecDeque::new(), n_memory: 0, spill, is_closed: false };
        Ok(Self { state: Mutex::new(state), changed: Notify::new(), limits })
    }

    fn lock(&self) -> MutexGuard<'_, BacklogState> {
        // Counters and queues are changed together, without a way out between.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a message in; the caller counts what was kept nowhere.
    ///
    /// # Errors
    /// When the disk refuses; the message is then lost.
    pub(super) fn push(&self, message: Vec<u8>) -> io::Result<Stored> {
        let mut state = self.lock();
        let spilled = state.spill.as_ref().is_some_and(|spill| !spill.lengths.is_empty());
        let fits =
            state.memory.is_empty() || state.n_memory + message.len() <= self.limits.memory_bytes;
        let kept = if fits && !spilled {
            state.n_memory += message.len();
            state.memory.push_back(message);
            Stored::Memory
        } else {
            match &mut state.spill {
                Some(spill) if spill.has_room(message.len()) => match spill.push(&message) {
                    Ok(()) => Stored::Disk,
                    // A full disk means no space, not the end of the recording.
                    Err(error) if error.kind() == io::ErrorKind::StorageFull => Stored::Nowhere,
                    Err(error) => return Err(error),
                },
                _ => Stored::Nowhere,
            }
        };
        drop(state);
        self.changed.notify_one();
        Ok(kept)
    }

    /// No more will be queued; the reader gets the rest, then the end.
    pub(super) fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_one();
    }

    /// Messages and bytes that wait.
    pub(super) fn waiting(&self) -> (u64, u64) {
        let state = self.lock();
        let (n, bytes) = (state.memory.len() as u64, state.n_memory as u64);
        match &state.spill {
            Some(spill) => (n + spill.lengths.len() as u64, bytes + spill.write_at - spill.read_at),
            None => (n, bytes),
        }
    }

    /// The oldest message, waited for; none when the queue is closed and empty.
    pub(super) async fn next(&self) -> io::Result<Option<Vec<u8>>> {
        loop {
            let changed = self.changed.notified();
            match self.look() {
                Next::Ready(message) => return Ok(Some(message)),
                Next::Over => return Ok(None),
                Next::Empty => changed.await,
                Next::OnDisk { file, at, length, limit } => {
                    let read = move || {
                        let mut message = vec![0; length];
                        let (place, before_end) = place(at, length, limit);
                        let (first, second) = message.split_at_mut(before_end);
                        file.read_exact_at(first, place)?;
                        file.read_exact_at(second, 0)?;
                        io::Result::Ok(message)
                    };
                    let message = tokio::task::spawn_blocking(read).await??;
                    self.forget_one_on_disk(length)?;
                    return Ok(Some(message));
                }
            }
        }
    }

    fn look(&self) -> Next {
        let mut state = self.lock();
        if let Some(message) = state.memory.pop_front() {
            state.n_memory -= message.len();
            return Next::Ready(message);
        }
        if let Some(spill) = &state.spill
            && let Some(&length) = spill.lengths.front()
        {
            return Next::OnDisk {
                file: Arc::clone(&spill.file),
                at: spill.read_at,
                length,
                limit: spill.limit,
            };
        }
        if state.is_closed { Next::Over } else { Next::Empty }
    }

    /// Removes the message read last; the file is truncated when it is empty.
    fn forget_one_on_disk(&self, length: usize) -> io::Result<()> {
        let mut state = self.lock();
        if let Some(spill) = &mut state.spill {
            spill.lengths.pop_front();
            spill.read_at += length as u64;
            if spill.lengths.is_empty() {
                (spill.read_at, spill.write_at) = (0, 0);
                spill.file.set_len(0)?;
            }
        }
        Ok(())
    }
}

/// A file without a name: made, and unlinked at once.
fn nameless(directory: &Path) -> io::Result<File> {
    let path = directory.join(format!(".evrig-spool-{}-{}", std::process::id(), serial()));
    let opened = File::options().read(true).write(true).create_new(true).open(&path);
    let unlinked = opened.and_then(|file| std::fs::remove_file(&path).map(|()| file));
    unlinked.map_err(|error| {
        io::Error::new(error.kind(), format!("the spool {}: {error}", directory.display()))
    })
}

fn serial() -> u64 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static SERIAL: AtomicU64 = AtomicU64::new(0);
    SERIAL.fetch_add(1, Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(k: usize) -> Vec<u8> {
        vec![k as u8; 10 + k % 7]
    }

    fn limits(directory: &Path, limit_bytes: u64) -> BacklogLimits {
        let spool = Spool { directory: directory.to_owned(), limit_bytes };
        BacklogLimits { memory_bytes: 50, spool: Some(spool) }
    }

    #[tokio::test]
    async fn messages_come_out_in_order_whether_they_were_on_disk_or_not() {
        let folder = tempfile::tempdir().unwrap();
        // Less than all messages together: the file is written round several times.
        let backlog = Backlog::new(limits(folder.path(), 337)).unwrap();
        let mut expected = 0;
        let mut n_on_disk = 0;
        for round in 0..5 {
            for k in 0..20 {
                n_on_disk +=
                    u32::from(backlog.push(message(20 * round + k)).unwrap() == Stored::Disk);
            }
            // Some stay behind, so that memory and disk are both in use when the next come.
            while expected < 20 * (round + 1) - 3 {
                assert_eq!(backlog.next().await.unwrap(), Some(message(expected)));
                expected += 1;
            }
        }
        backlog.close();
        assert_eq!(backlog.waiting().0, 3);
        for k in expected..100 {
            assert_eq!(backlog.next().await.unwrap(), Some(message(k)));
        }
        assert_eq!(backlog.next().await.unwrap(), None);
        assert!(n_on_disk > 50, "{n_on_disk}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing stays behind");
    }

    #[tokio::test]
    async fn frames_that_fit_nowhere_are_reported_and_what_was_kept_comes_out() {
        let folder = tempfile::tempdir().unwrap();
        let backlog = Backlog::new(limits(folder.path(), 100)).unwrap();
        let kept: Vec<Stored> = (0..30).map(|_| backlog.push(vec![0; 10]).unwrap()).collect();
        let n = |which| kept.iter().filter(|kept| **kept == which).count();
        assert_eq!([n(Stored::Memory), n(Stored::Disk), n(Stored::Nowhere)], [5, 10, 15]);
        assert_eq!(backlog.waiting(), (15, 150));
        backlog.close();
        let mut n_out = 0;
        while backlog.next().await.unwrap().is_some() {
            n_out += 1;
        }
        assert_eq!(n_out, 15);
    }

    #[tokio::test]
    async fn a_waiting_reader_is_woken_by_a_message_and_by_the_end() {
        let backlog =
            Arc::new(Backlog::new(BacklogLimits { memory_bytes: 1, spool: None }).unwrap());
        let reader = Arc::clone(&backlog);
        let read =
            tokio::spawn(
                async move { [reader.next().await.unwrap(), reader.next().await.unwrap()] },
            );
        tokio::task::yield_now().await;
        backlog.push(vec![1]).unwrap();
        backlog.close();
        assert_eq!(read.await.unwrap(), [Some(vec![1]), None]);
    }

    #[test]
    fn a_spool_that_is_no_directory_is_reported_at_once() {
        let text = Backlog::new(limits(Path::new("/nonexistent"), 1)).unwrap_err().to_string();
        assert!(text.contains("/nonexistent"), "{text}");
    }
}
