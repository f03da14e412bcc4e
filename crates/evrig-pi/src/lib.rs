//! The agent that serves a Raspberry Pi's camera, and its wire protocol.
//!
//! # The wire
//! One TCP connection. Both sides first send twelve bytes: `EVRIGPI` and a zero, then the
//! protocol's version as a little-endian `u32`; this never changes, so that any two versions
//! recognise each other. Then messages: a `u32` of bytes that follow, a `u32` length of the head,
//! the head as JSON, and the images. The host requests (configure, start, clock, stop), the agent
//! answers, and between start and stop it sends frames.
//!
//! Beyond one machine the connection is TLS 1.3 and each side proves that it has its half of a pair
//! of keys (`evrig pair`); without keys the agent listens on the loopback interface only.

pub mod agent;
pub mod cli;
pub mod coding;
pub mod discipline;
pub mod keys;
pub mod order;
pub mod picamera;
pub mod serve;
pub mod source;
pub mod wire;

use evrig_core::pi_camera::{ClockSandwich, RawClockSandwich};
use evrig_core::time::{Span, Stamp};
use rustix::time::{ClockId, clock_gettime};

fn read_clock(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec)
}

/// The wall clock of this machine between two readings of its boot clock.
#[must_use]
pub fn read_clocks() -> ClockSandwich {
    ClockSandwich {
        boottime_before: Stamp::from_nanos(read_clock(ClockId::Boottime)),
        realtime: Stamp::from_nanos(read_clock(ClockId::Realtime)),
        boottime_after: Stamp::from_nanos(read_clock(ClockId::Boottime)),
    }
}

/// The same, and once more between two readings of the clock that nothing steers.
#[must_use]
pub fn read_all_clocks() -> wire::PiClockReading {
    wire::PiClockReading {
        boot: read_clocks(),
        raw: RawClockSandwich {
            monotonic_raw_before: Span::from_nanos(read_clock(ClockId::MonotonicRaw)),
            realtime: Stamp::from_nanos(read_clock(ClockId::Realtime)),
            monotonic_raw_after: Span::from_nanos(read_clock(ClockId::MonotonicRaw)),
        },
    }
}
