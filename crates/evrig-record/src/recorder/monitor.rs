//! The state that a camera's threads share with the recording: sample counts, the error that ended
//! a thread, and the request to end.

use super::sample::RecorderSample;
use super::sample_queue::SampleSender;
use super::tally::{RecorderError, RecorderTally};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// The shared state of one camera's threads, from start to end.
#[derive(Debug, Default)]
pub struct RecorderMonitor {
    is_ending: AtomicBool,
    state: Mutex<MonitorState>,
    changed: Condvar,
}

/// The shared state.
#[derive(Debug, Default)]
pub struct MonitorState {
    pub tally: RecorderTally,
    /// The first error that ended a thread.
    pub failed: Option<RecorderError>,
    pub n_running: usize,
}

impl RecorderMonitor {
    fn lock(&self) -> MutexGuard<'_, MonitorState> {
        // Counters and words: whole between any two statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `work` on a thread of its own; the error it ends with is the camera's. The outlet is
    /// closed after that error is stored, so that a reader that finds it closed finds the reason.
    pub fn spawn<O: Send + 'static>(
        self: &Arc<Self>,
        name: &str,
        outlet: O,
        work: impl FnOnce(&O, &Self) -> Result<(), RecorderError> + Send + 'static,
    ) -> std::io::Result<JoinHandle<()>> {
        self.lock().n_running += 1;
        let its = Arc::clone(self);
        let started = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            let ended = work(&outlet, &its);
            its.change(|state| {
                state.n_running -= 1;
                if let Err(error) = ended {
                    state.failed.get_or_insert(error);
                }
            });
            drop(outlet);
        });
        if started.is_err() {
            self.lock().n_running -= 1;
        }
        started
    }

    /// Asks all threads to end.
    pub fn end(&self) {
        self.is_ending.store(true, Ordering::Relaxed);
        // The lock orders this before a wait that looked just now.
        drop(self.lock());
        self.changed.notify_all();
    }

    /// Whether the threads were asked to end.
    pub fn is_ending(&self) -> bool {
        self.is_ending.load(Ordering::Relaxed)
    }

    /// Changes the shared state and wakes all waiting threads.
    pub fn change(&self, change: impl FnOnce(&mut MonitorState)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    /// What came so far.
    ///
    /// # Errors
    /// The one that ended a thread.
    pub fn progress(&self) -> Result<RecorderTally, RecorderError> {
        let state = self.lock();
        state.failed.clone().map_or_else(|| Ok(state.tally.clone()), Err)
    }

    /// Waits while `is_waiting` holds, no longer than `patience`.
    pub fn wait(&self, patience: Duration, is_waiting: impl Fn(&MonitorState) -> bool) {
        let waited =
            self.changed.wait_timeout_while(self.lock(), patience, |state| is_waiting(state));
        drop(waited);
    }

    /// Waits for the first sample, no longer than `patience` nor than a thread runs; whether it
    /// came.
    ///
    /// # Errors
    /// The one that ended a thread.
    pub fn wait_for_first(&self, patience: Duration) -> Result<bool, RecorderError> {
        self.wait(patience, |state| {
            state.tally.n_samples == 0 && state.failed.is_none() && state.n_running > 0
        });
        self.progress().map(|tally| tally.n_samples > 0)
    }

    /// Queues and counts a sample; one that does not fit is dropped and counted as dropped.
    pub fn offer(&self, outlet: &SampleSender, sample: RecorderSample) {
        self.count(outlet.offer(sample));
    }

    /// The same for a source that can wait until the sample fits.
    pub fn put(&self, outlet: &SampleSender, sample: RecorderSample) {
        self.count(outlet.put(sample));
    }

    fn count(&self, is_taken: bool) {
        self.change(|state| {
            let tally = &mut state.tally;
            *(if is_taken { &mut tally.n_samples } else { &mut tally.n_dropped }) += 1;
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::{channel, host_time};
    use super::*;

    fn note() -> RecorderSample {
        RecorderSample::Note { at: host_time(), text: "a remark".to_owned() }
    }

    fn lost(because: &str) -> RecorderError {
        RecorderError { device: "it".into(), because: because.into(), remedy: "none" }
    }

    #[test]
    fn what_had_no_room_is_counted_as_dropped() {
        let monitor = RecorderMonitor::default();
        let (outlet, _inlet) = channel(1);
        monitor.offer(&outlet, note());
        monitor.offer(&outlet, note());
        let tally = monitor.progress().unwrap();
        assert_eq!((tally.n_samples, tally.n_dropped), (1, 1));
    }

    #[test]
    fn the_first_error_of_its_threads_is_the_cameras() {
        let monitor: Arc<RecorderMonitor> = Arc::default();
        let first = monitor.spawn("first", (), |(), _| Err(lost("the first"))).unwrap();
        first.join().unwrap();
        monitor.spawn("second", (), |(), _| Err(lost("the second"))).unwrap().join().unwrap();
        assert_eq!(monitor.progress(), Err(lost("the first")));
        assert_eq!(monitor.wait_for_first(Duration::from_secs(3600)), Err(lost("the first")));
    }

    #[test]
    fn a_thread_that_ends_without_a_sample_ends_the_wait_for_it() {
        let monitor: Arc<RecorderMonitor> = Arc::default();
        let waits = |(): &(), monitor: &RecorderMonitor| {
            monitor.wait(Duration::from_secs(3600), |_| !monitor.is_ending());
            Ok(())
        };
        let thread = monitor.spawn("camera", (), waits).unwrap();
        monitor.end();
        // Returns at once, or this test never ends.
        assert_eq!(monitor.wait_for_first(Duration::from_secs(3600)), Ok(false));
        thread.join().unwrap();
    }
}
