//! Where a simulated arm truly was, for those who look at it while it is served.

use super::{Shared, lock};
use crate::arm::Trace;
use evrig_core::time::Span;
use std::sync::Arc;

/// Looks where a simulated arm truly was; it may outlive the arm's wire.
#[derive(Debug, Clone)]
pub struct Follower {
    shared: Arc<Shared>,
    trace: Arc<Trace>,
}

impl Follower {
    pub(super) fn of(shared: &Arc<Shared>) -> Self {
        let trace = lock(&shared.arm).arm.keep_trace();
        Self { shared: Arc::clone(shared), trace }
    }

    /// Lets the arm's time pass up to now; until when its way is known then.
    #[must_use]
    pub fn known_until(&self) -> Span {
        let mut clocked = lock(&self.shared.arm);
        let now = clocked.now(false);
        clocked.arm.advance(now);
        drop(clocked);
        self.trace.known_until()
    }

    /// The arm's clock now.
    #[must_use]
    pub fn now(&self) -> Span {
        lock(&self.shared.arm).now(false)
    }

    /// The way so far.
    #[must_use]
    pub fn trace(&self) -> &Trace {
        &self.trace
    }
}
