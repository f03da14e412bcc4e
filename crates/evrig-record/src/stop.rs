//! How a recording is ended early, and the arm stopped at once.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// How the operator wants a recording to end; a stronger request is never replaced by a weaker one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum StopRequest {
    /// Go on.
    No = 0,
    /// End at the next corner of the path, with the tail that belongs to a recording.
    AfterStep = 1,
    /// Stop the arm immediately, then drive it home.
    Park = 2,
    /// Stop the arm immediately.
    AtOnce = 3,
}

impl std::fmt::Display for StopRequest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::No => "go on",
            Self::AfterStep => "end after the current step",
            Self::Park => "stop and park",
            Self::AtOnce => "stop immediately",
        })
    }
}

/// Stops an arm immediately from any thread, without a lock or an allocation.
pub trait EmergencyStop: Send + Sync + std::fmt::Debug {
    /// Stops the arm; nothing moves it afterwards. May be called repeatedly.
    ///
    /// # Errors
    /// When the arm's guard is gone, which stopped the arm before it ended.
    fn halt(&self) -> std::io::Result<()>;
}

/// Why the guard process of an arm ended. The stop command was sent in every case but the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GuardEnd {
    /// The port could not be opened.
    NotBegun(String),
    /// The host process closed the pipe or died.
    HostGone,
    /// The host process hangs or was suspended.
    HeartbeatLate,
}

/// Carries the request from any thread to the engine.
#[derive(Debug, Clone, Default)]
pub struct StopToken {
    shared: Arc<StopMonitor>,
}

#[derive(Debug, Default)]
struct StopMonitor {
    request: AtomicU8,
    lock: Mutex<()>,
    changed: Condvar,
}

impl StopToken {
    /// Requests an end.
    pub fn request(&self, stop: StopRequest) {
        self.shared.request.fetch_max(stop as u8, Ordering::SeqCst);
        // A wait that has just read the request is woken: the lock orders the two.
        drop(self.shared.lock.lock().unwrap_or_else(PoisonError::into_inner));
        self.shared.changed.notify_all();
    }

    /// The strongest request so far.
    #[must_use]
    pub fn requested(&self) -> StopRequest {
        match self.shared.request.load(Ordering::SeqCst) {
            0 => StopRequest::No,
            1 => StopRequest::AfterStep,
            2 => StopRequest::Park,
            _ => StopRequest::AtOnce,
        }
    }

    /// Waits for `time`, or until more than [`StopRequest::AfterStep`] is requested.
    pub fn wait(&self, time: Duration) -> StopRequest {
        let guard = self.shared.lock.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self
            .shared
            .changed
            .wait_timeout_while(guard, time, |()| self.requested() < StopRequest::Park);
        drop(waited);
        self.requested()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stronger_request_stays() {
        let token = StopToken::default();
        token.request(StopRequest::AtOnce);
        token.clone().request(StopRequest::AfterStep);
        assert_eq!(token.requested(), StopRequest::AtOnce);
        // Returns at once, or this test never ends.
        assert_eq!(token.wait(Duration::from_secs(3600)), StopRequest::AtOnce);
    }
}
