//! The Pi's camera: the agent on the Pi, the client on the host, and the wire between them.
//!
//! # The wire
//! One TCP connection. Both sides first send twelve bytes: `EVRIGPI` and a zero, then the protocol's
//! version as a little-endian `u32`; this never changes, so that versions can always tell each
//! other apart. Then messages: a `u32` of bytes that follow, a `u32` length of the head, the head as
//! JSON, and the pictures as they are. The host asks (configure, start, clock, stop), the agent
//! answers, and between start and stop it sends frames.
//!
//! The wire is not encrypted, so the agent listens on the loopback interface only; a tunnel
//! (`ssh -L`) carries it further.

pub mod agent;
mod client;
pub mod source;
pub mod wire;

pub use client::{NetworkPi, Patience};

use crate::session::ClockSandwich;
use crate::time::Stamp;
use rustix::time::{ClockId, clock_gettime};

/// The wall clock of this machine between two readings of its boot clock.
#[must_use]
pub fn read_clocks() -> ClockSandwich {
    let read = |clock| {
        let time = clock_gettime(clock);
        time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec)
    };
    ClockSandwich {
        boottime_before: Stamp::from_nanos(read(ClockId::Boottime)),
        realtime: Stamp::from_nanos(read(ClockId::Realtime)),
        boottime_after: Stamp::from_nanos(read(ClockId::Boottime)),
    }
}
