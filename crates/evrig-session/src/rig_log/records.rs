//! The records of the rig's log.

use evrig_core::pi_camera::{ClockSandwich, RawClockSandwich};
use evrig_core::time::{HostMonotonic, Stamp, Unix};
use serde::{Deserialize, Serialize};

/// One instant on both clocks of the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostTime {
    /// The clock that never steps.
    #[serde(rename = "monotonic_ns")]
    pub monotonic: Stamp<HostMonotonic>,
    /// The wall clock.
    #[serde(rename = "unix_ns")]
    pub unix: Stamp<Unix>,
}

/// Arrival time at the host.
pub type Arrival = HostTime;

/// The Pi's clocks, read between two readings of the host's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockExchange {
    /// When the host asked.
    pub asked: HostTime,
    /// What the Pi read.
    pub pi: ClockSandwich,
    /// What it read of its unsteered clock at the same time; none from an agent that reads none.
    #[serde(default)]
    pub pi_raw: Option<RawClockSandwich>,
    /// When the host had the answer.
    pub answered: HostTime,
}

/// One packet of the event camera as it reached the host.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PacketArrival {
    /// Number of its stream in `davis.aedat4`.
    pub stream: u32,
    /// Events, frames or samples in it.
    pub count: u64,
    /// First stamp in it, µs of the camera's clock.
    pub first_us: i64,
    /// Last stamp in it, µs of the camera's clock.
    pub last_us: i64,
    /// When it was whole.
    pub arrived: Arrival,
}

/// Severity of a log line; the numbers are Foxglove's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Information.
    Info = 2,
    /// Something was lost or is doubtful.
    Warning = 3,
    /// The recording could not go on.
    Error = 4,
}
