//! Long work on a thread of its own, while the calling thread waits without Python's lock: an
//! interrupt stops the work, and progress is passed on.

use crate::errors::Failure;
use crate::pool;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between two looks at Python's signals: short for a person, long for a processor.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// The payload of the unwinding by which cancelled work ends.
struct Cancelled;

/// One message from the work to the waiting thread.
enum TaskMessage<T> {
    Progress { step: String, done: u64, total: u64 },
    Ended(Result<T, Failure>),
}

/// The link from the work to the waiting thread.
pub(crate) struct TaskLink<T> {
    sender: Sender<TaskMessage<T>>,
    is_cancelled: Arc<AtomicBool>,
    /// Whether anybody wants progress; without, the waiting thread is not woken.
    is_followed: bool,
}

impl<T> TaskLink<T> {
    /// Ends the work, by unwinding, when the waiting thread was interrupted.
    pub(crate) fn check(&self) {
        if self.is_cancelled.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Cancelled));
        }
    }

    /// Reports what is done, of how much; 0 in all where that is not known.
    pub(crate) fn report(&self, step: &str, done: u64, total: u64) {
        self.check();
        if !self.is_followed {
            return;
        }
        // Nobody listens any more only when the task was cancelled.
        let _ = self.sender.send(TaskMessage::Progress { step: step.to_owned(), done, total });
    }

    fn run(&self, work: impl FnOnce(&Self) -> Result<T, Failure> + Send)
    where
        T: Send,
    {
        let ended = catch_unwind(AssertUnwindSafe(|| pool::run(|| work(self))));
        let ended = ended.unwrap_or_else(|payload| {
            let what = if payload.is::<Cancelled>() { "cancelled" } else { "it panicked" };
            Err(Failure::Internal(format!("the work did not end: {what}; please report this")))
        });
        let _ = self.sender.send(TaskMessage::Ended(ended));
    }
}

fn link<T>(is_followed: bool) -> (TaskLink<T>, Mutex<Receiver<TaskMessage<T>>>) {
    let (sender, receiver) = channel();
    (TaskLink { sender, is_cancelled: Arc::default(), is_followed }, Mutex::new(receiver))
}

/// Runs work that borrows from the caller. After an interrupt the call returns once the work has
/// come to its next check.
pub(crate) fn run_borrowing<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&TaskLink<T>) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let (link, receiver) = link(progress.is_some());
    let is_cancelled = Arc::clone(&link.is_cancelled);
    std::thread::scope(|scope| {
        let thread = scope.spawn(move || link.run(work));
        let ended = wait(py, progress, &receiver);
        is_cancelled.store(true, Ordering::Relaxed);
        py.detach(|| thread.join()).ok();
        ended
    })
}

/// Runs work on values of its own. After an interrupt the call returns immediately, and the work ends
/// at its next check.
pub(crate) fn run_owning<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&TaskLink<T>) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let (link, receiver) = link(progress.is_some());
    let is_cancelled = Arc::clone(&link.is_cancelled);
    std::thread::spawn(move || link.run(work));
    let ended = wait(py, progress, &receiver);
    is_cancelled.store(true, Ordering::Relaxed);
    ended
}

fn wait<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    receiver: &Mutex<Receiver<TaskMessage<T>>>,
) -> PyResult<T> {
    loop {
        let received = py.detach(|| {
            receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(SIGNAL_INTERVAL)
        });
        py.check_signals()?;
        match received {
            Ok(TaskMessage::Ended(ended)) => return Ok(ended?),
            Ok(TaskMessage::Progress { step, done, total }) => {
                if let Some(progress) = progress {
                    progress.call1((step, done, total))?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::Internal("the work ended without a result".into()).into());
            }
        }
    }
}
