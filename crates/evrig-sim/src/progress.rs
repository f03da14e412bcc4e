//! Progress of a twin.

use evrig_core::time::Span;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Progress of a twin, shared with its thread.
#[derive(Debug, Clone, Default)]
pub struct TwinProgress(Arc<SharedTwin>);

#[derive(Debug, Default)]
struct SharedTwin {
    state: Mutex<TwinState>,
    changed: Condvar,
}

/// A twin at one moment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TwinState {
    /// World time at which its camera was switched on.
    pub begun: Option<Span>,
    /// World time up to which its output was sent.
    pub position: Span,
    /// Packets sent.
    pub n_sent: u64,
    /// Whether it is to end.
    pub is_ending: bool,
}

impl TwinProgress {
    /// The twin now.
    #[must_use]
    pub fn look(&self) -> TwinState {
        *self.lock()
    }

    /// Switches the camera on at a world time, unless it is on.
    pub fn begin(&self, at: Span) {
        self.change(|twin| {
            if twin.begun.is_none() {
                twin.begun = Some(at);
                twin.position = at;
            }
        });
    }

    /// Requests the thread to end.
    pub fn end(&self) {
        self.change(|twin| twin.is_ending = true);
    }

    pub(super) fn change(&self, change: impl FnOnce(&mut TwinState)) {
        change(&mut self.lock());
        self.0.changed.notify_all();
    }

    /// Waits until something changes, no longer than `patience`.
    pub(super) fn wait(&self, patience: Duration) -> TwinState {
        let waited = self.0.changed.wait_timeout(self.lock(), patience);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Fraction of the output before `closed_at` that was sent, 0 to 1.
    #[must_use]
    pub fn share(&self, closed_at: Span) -> f64 {
        let twin = self.look();
        let begun = twin.begun.unwrap_or(closed_at);
        let whole = (closed_at - begun).as_secs_f64();
        if twin.position >= closed_at || whole <= 0.0 {
            return 1.0;
        }
        ((twin.position - begun).as_secs_f64() / whole).clamp(0.0, 1.0)
    }

    fn lock(&self) -> MutexGuard<'_, TwinState> {
        // Plain numbers: valid after a panic at any point.
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_of_what_was_seen_between_switching_on_and_closing() {
        let progress = TwinProgress::default();
        let ms = |n: i64| Span::from_micros(n * 1_000);
        assert_eq!(progress.share(ms(500)), 1.0, "a camera that was never on owes nothing");
        progress.begin(ms(100));
        progress.begin(ms(400));
        assert_eq!(progress.share(ms(500)), 0.0);
        progress.change(|twin| twin.position = ms(200));
        assert!((progress.share(ms(500)) - 0.25).abs() < 1e-9);
        progress.change(|twin| twin.position = ms(600));
        assert_eq!(progress.share(ms(500)), 1.0);
    }
}
