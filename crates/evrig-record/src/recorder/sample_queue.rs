//! A queue with a bound in bytes between a device's thread and a writer's.

use super::sample::RecorderSample;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The device's end of the queue.
#[derive(Debug)]
pub struct SampleSender {
    shared: Arc<SampleQueue>,
}

/// The writer's end of the queue.
#[derive(Debug)]
pub struct SampleReceiver {
    shared: Arc<SampleQueue>,
}

/// What a writer received.
#[derive(Debug)]
pub enum Received {
    /// A sample.
    Sample(RecorderSample),
    /// Nothing within the time given.
    Nothing,
    /// The queue is closed.
    Closed,
}

#[derive(Debug)]
struct SampleQueue {
    state: Mutex<QueueState>,
    came: Condvar,
    left: Condvar,
    limit_bytes: usize,
}

#[derive(Debug)]
struct QueueState {
    samples: VecDeque<RecorderSample>,
    n_bytes: usize,
    n_outlets: usize,
    has_inlet: bool,
}

/// A queue that holds at most `limit_bytes`, or a single larger sample.
#[must_use]
pub fn channel(limit_bytes: usize) -> (SampleSender, SampleReceiver) {
    let state = QueueState { samples: VecDeque::new(), n_bytes: 0, n_outlets: 1, has_inlet: true };
    let shared = Arc::new(SampleQueue {
        state: Mutex::new(state),
        came: Condvar::new(),
        left: Condvar::new(),
        limit_bytes,
    });
    (SampleSender { shared: Arc::clone(&shared) }, SampleReceiver { shared })
}

impl SampleQueue {
    fn lock(&self) -> MutexGuard<'_, QueueState> {
        // A queue is whole between any two of its statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn has_room(&self, state: &QueueState, n_bytes: usize) -> bool {
        state.samples.is_empty() || state.n_bytes + n_bytes <= self.limit_bytes
    }

    fn push(&self, state: &mut QueueState, sample: RecorderSample, n_bytes: usize) {
        state.n_bytes += n_bytes;
        state.samples.push_back(sample);
        self.came.notify_one();
    }
}

impl SampleSender {
    /// Queues a sample if it fits; false when it was dropped.
    #[must_use]
    pub fn offer(&self, sample: RecorderSample) -> bool {
        let n_bytes = sample.n_bytes();
        let mut state = self.shared.lock();
        let fits = state.has_inlet && self.shared.has_room(&state, n_bytes);
        if fits {
            self.shared.push(&mut state, sample, n_bytes);
        }
        fits
    }

    /// Waits until a sample fits and queues it; false when the writer is gone. For sources that can
    /// wait.
    #[must_use]
    pub fn put(&self, sample: RecorderSample) -> bool {
        let n_bytes = sample.n_bytes();
        let mut state = self.shared.lock();
        while state.has_inlet && !self.shared.has_room(&state, n_bytes) {
            state = self.shared.left.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if state.has_inlet {
            self.shared.push(&mut state, sample, n_bytes);
        }
        state.has_inlet
    }
}

impl Clone for SampleSender {
    fn clone(&self) -> Self {
        self.shared.lock().n_outlets += 1;
        Self { shared: Arc::clone(&self.shared) }
    }
}

impl Drop for SampleSender {
    fn drop(&mut self) {
        self.shared.lock().n_outlets -= 1;
        self.shared.came.notify_all();
    }
}

impl SampleReceiver {
    /// The next sample, waited for no longer than `patience`.
    #[must_use]
    pub fn take(&self, patience: Duration) -> Received {
        let is_waiting = |state: &mut QueueState| state.samples.is_empty() && state.n_outlets > 0;
        let state = self.shared.lock();
        let (mut state, _) = self
            .shared
            .came
            .wait_timeout_while(state, patience, is_waiting)
            .unwrap_or_else(PoisonError::into_inner);
        match state.samples.pop_front() {
            Some(sample) => {
                state.n_bytes -= sample.n_bytes();
                self.shared.left.notify_one();
                Received::Sample(sample)
            }
            None if state.n_outlets == 0 => Received::Closed,
            None => Received::Nothing,
        }
    }
}

impl Drop for SampleReceiver {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.has_inlet = false;
        state.samples.clear();
        self.shared.left.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};
    use evrig_format::aedat4::Content;

    fn packet(n: i64) -> RecorderSample {
        let events: Events = (0..n).map(|t| Event { t, x: 0, y: 0, on: true }).collect();
        let arrived = crate::recorder::host_time();
        RecorderSample::Packet { stream: 0, arrived, content: Content::Events(events) }
    }

    #[test]
    fn what_does_not_fit_is_refused_and_what_left_makes_space() {
        let (outlet, inlet) = channel(packet(10).n_bytes() * 2);
        assert!(outlet.offer(packet(10)) && outlet.offer(packet(10)));
        assert!(!outlet.offer(packet(10)));
        assert!(matches!(inlet.take(Duration::ZERO), Received::Sample(_)));
        assert!(outlet.offer(packet(10)));
    }

    #[test]
    fn a_sample_larger_than_the_queue_passes_alone() {
        let (outlet, inlet) = channel(16);
        assert!(outlet.offer(packet(100)) && !outlet.offer(packet(1)));
        assert!(matches!(inlet.take(Duration::ZERO), Received::Sample(_)));
        assert!(matches!(inlet.take(Duration::ZERO), Received::Nothing));
    }

    #[test]
    fn a_waiting_source_goes_on_when_its_reader_takes_or_leaves() {
        let (outlet, inlet) = channel(1);
        assert!(outlet.put(packet(1)));
        let waiting = std::thread::spawn(move || [outlet.put(packet(2)), outlet.put(packet(3))]);
        assert!(matches!(inlet.take(Duration::from_secs(10)), Received::Sample(_)));
        assert!(matches!(inlet.take(Duration::from_secs(10)), Received::Sample(_)));
        drop(inlet);
        // The third fits the empty queue or finds nobody there, by who came first.
        assert!(waiting.join().unwrap()[0]);
    }

    #[test]
    fn the_end_comes_after_the_last_sample() {
        let (outlet, inlet) = channel(1000);
        assert!(outlet.clone().offer(packet(1)));
        drop(outlet);
        assert!(matches!(inlet.take(Duration::ZERO), Received::Sample(_)));
        assert!(matches!(inlet.take(Duration::ZERO), Received::Closed));
    }
}
