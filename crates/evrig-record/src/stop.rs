//! How an operator ends a recording before its end.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// What the operator wants; a stronger wish is never replaced by a weaker one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Stop {
    /// Go on.
    No = 0,
    /// End at the next corner of the path, with the tail that belongs to a recording.
    AfterStep = 1,
    /// Stand at once, then go home.
    Park = 2,
    /// Stand at once.
    AtOnce = 3,
}

/// Carries the wish from any thread to the engine.
#[derive(Debug, Clone, Default)]
pub struct StopToken {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    wish: AtomicU8,
    lock: Mutex<()>,
    changed: Condvar,
}

impl StopToken {
    /// Asks for an end.
    pub fn ask(&self, stop: Stop) {
        self.shared.wish.fetch_max(stop as u8, Ordering::SeqCst);
        // The lock orders this before a wait that looked just now.
        drop(self.shared.lock.lock().unwrap_or_else(PoisonError::into_inner));
        self.shared.changed.notify_all();
    }

    /// What was asked for.
    #[must_use]
    pub fn wish(&self) -> Stop {
        match self.shared.wish.load(Ordering::SeqCst) {
            0 => Stop::No,
            1 => Stop::AfterStep,
            2 => Stop::Park,
            _ => Stop::AtOnce,
        }
    }

    /// Rests for `time`, or until more than [`Stop::AfterStep`] is asked for.
    pub fn rest(&self, time: Duration) -> Stop {
        let guard = self.shared.lock.lock().unwrap_or_else(PoisonError::into_inner);
        let waited =
            self.shared.changed.wait_timeout_while(guard, time, |()| self.wish() < Stop::Park);
        drop(waited);
        self.wish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stronger_wish_stays() {
        let token = StopToken::default();
        token.ask(Stop::AtOnce);
        token.clone().ask(Stop::AfterStep);
        assert_eq!(token.wish(), Stop::AtOnce);
        // Returns at once, or this test never ends.
        assert_eq!(token.rest(Duration::from_secs(3600)), Stop::AtOnce);
    }
}
