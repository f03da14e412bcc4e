//! Rates and drops, once per second.

use serde::Serialize;

/// Rates and losses since the last one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveStatus {
    /// Events a second.
    pub events_per_s: f64,
    /// Share of On events; none without events.
    pub on_share: Option<f64>,
    /// Frames of the event camera a second.
    pub davis_frames_per_s: f64,
    /// Frames of the Pi's camera a second.
    pub pi_frames_per_s: f64,
    /// Samples that devices lost since the beginning.
    pub n_dropped_by_devices: u64,
    /// Writes that viewers were too slow for since the beginning.
    pub n_dropped_for_viewers: u64,
    /// Longest time from a sample's arrival to its way out, ms.
    pub longest_delay_ms: f64,
    /// The tag's corners in the event camera's last frame, pixels; none where it was not seen.
    pub tag_px: Option<[[f64; 2]; 4]>,
    /// The Pi's wall clock minus the host's, µs, by the last exchange; half of its round trip is
    /// the error.
    pub pi_clock_offset_us: Option<f64>,
    /// Half of that round trip, µs.
    pub pi_clock_error_us: Option<f64>,
    /// Where the tool is: x, y, z in mm and r in degrees.
    pub pose: Option<[f64; 4]>,
}

impl std::fmt::Display for LiveStatus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{:>9.0} events/s  {:>5.1} + {:>5.1} frames/s  dropped {} + {}  delay {:.0} ms",
            self.events_per_s,
            self.davis_frames_per_s,
            self.pi_frames_per_s,
            self.n_dropped_by_devices,
            self.n_dropped_for_viewers,
            self.longest_delay_ms,
        )?;
        f.write_str(if self.tag_px.is_some() { "  tag detected" } else { "" })?;
        if let Some(offset) = self.pi_clock_offset_us {
            write!(f, "  Pi clock {offset:+.0} us")?;
        }
        Ok(())
    }
}
