//! Frames and clock readings of the Raspberry Pi camera, as its agent sends them.

use crate::geometry::Size;
use crate::time::{PiSensor, Span, Stamp, Unix};
use serde::{Deserialize, Serialize};

/// The camera's metadata of one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameMetadata {
    /// Counted by the agent, without gaps before anything was dropped.
    pub sequence: u64,
    /// The sensor's hardware time, ns of the Pi's boot clock: end of the first row's exposure.
    #[serde(rename = "sensor_timestamp_ns")]
    pub sensor_timestamp: Stamp<PiSensor>,
    /// The same instant on the Pi's wall clock, where its library gives it; as it came.
    #[serde(rename = "frame_wall_clock_ns")]
    pub frame_wall_clock: Option<Stamp<Unix>>,
    /// When the agent had the frame, on the Pi's wall clock.
    #[serde(rename = "real_time_ns")]
    pub real_time: Stamp<Unix>,
    /// Exposure time of a row, ns.
    #[serde(rename = "exposure_ns")]
    pub exposure: Span,
    /// Analogue gain.
    pub analogue_gain: f64,
    /// Digital gain.
    pub digital_gain: f64,
    /// Dioptres; none for a lens that cannot move.
    pub lens_position: Option<f64>,
    /// Pedestal of R, Gr, Gb, B in the raw frame's units.
    pub black_levels: [u16; 4],
    /// Columns and rows.
    pub size: Size,
    /// Order of the colours, `RGGB` for the Camera Module 3.
    pub bayer: String,
    /// Frames that the agent dropped because its buffer was full, up to this one.
    pub n_dropped: u64,
}

/// One request of the Pi's camera: raw and RGB of the same exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct PiFrame {
    /// The camera's metadata.
    pub metadata: FrameMetadata,
    /// Raw samples packed as RAW10, rows without padding; none when raw was not asked for.
    pub raw10: Option<Vec<u8>>,
    /// R, G, B bytes, rows without padding; none when RGB was not asked for.
    pub rgb: Option<Vec<u8>>,
}

impl PiFrame {
    /// Bytes of its images.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        let length = |image: &Option<Vec<u8>>| image.as_ref().map_or(0, Vec::len);
        length(&self.raw10) + length(&self.rgb)
    }
}

/// The Pi's wall clock read between two readings of its boot clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockSandwich {
    /// The boot clock before.
    #[serde(rename = "boottime_before_ns")]
    pub boottime_before: Stamp<PiSensor>,
    /// The wall clock.
    #[serde(rename = "realtime_ns")]
    pub realtime: Stamp<Unix>,
    /// The boot clock after.
    #[serde(rename = "boottime_after_ns")]
    pub boottime_after: Stamp<PiSensor>,
}

/// The Pi's wall clock read between two readings of its unsteered clock, so that
/// steering of the wall clock can be distinguished from a drift of the crystal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RawClockSandwich {
    /// The unsteered clock before, ns since some start (`CLOCK_MONOTONIC_RAW`).
    #[serde(rename = "monotonic_raw_before_ns")]
    pub monotonic_raw_before: Span,
    /// The wall clock.
    #[serde(rename = "realtime_ns")]
    pub realtime: Stamp<Unix>,
    /// The unsteered clock after.
    #[serde(rename = "monotonic_raw_after_ns")]
    pub monotonic_raw_after: Span,
}
