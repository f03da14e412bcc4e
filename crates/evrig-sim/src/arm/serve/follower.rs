//! The true trajectory of a simulated arm while it is served.

use super::shared::{SharedArm, lock};
use crate::arm::trace::ToolTrace;
use evrig_core::time::Span;
use std::sync::Arc;

/// Follows the true pose of a simulated arm; it may outlive the arm's pseudo-terminal.
#[derive(Debug, Clone)]
pub struct TraceFollower {
    shared: Arc<SharedArm>,
    trace: Arc<ToolTrace>,
}

impl TraceFollower {
    pub(super) fn of(shared: &Arc<SharedArm>) -> Self {
        let trace = lock(&shared.arm).arm.keep_trace();
        Self { shared: Arc::clone(shared), trace }
    }

    /// Advances the arm to now; gives the time up to which its trajectory is known.
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

    /// The trajectory so far.
    #[must_use]
    pub fn trace(&self) -> &ToolTrace {
        &self.trace
    }
}
