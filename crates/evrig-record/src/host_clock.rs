//! The host's monotonic clock, the same in every process of one boot.

use evrig_core::time::{HostMonotonic, Stamp};
use rustix::time::{ClockId, clock_gettime};

/// Now.
#[must_use]
pub fn now() -> Stamp<HostMonotonic> {
    let time = clock_gettime(ClockId::Monotonic);
    Stamp::from_nanos(time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec))
}
