//! Effects between the pixels and the file.
//!
//! Sources: iniVation's DAVIS346 data (12 million events a second); Joubert et al., Front.
//! Neurosci. 15:702765 (2021) for arbiters; issue 166 of inivation/caer for drops at the transfer.

use serde::{Deserialize, Serialize};

/// One server reads the pixels' requests in the order in which they came; none is lost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadoutSaturation {
    /// The DAVIS346 carries 12 million; 1e4..2e7.
    pub max_events_per_s: f64,
}

/// All requests of a row that are pending when the row is granted are read together with one stamp,
/// which takes `row_us` (0.1..20 us).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowReadout {
    /// How long the bus is busy with one row.
    pub row_us: f64,
}

/// Events are lost after the pixel was reset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventDrop {
    /// Share that is lost.
    pub fraction: f64,
    /// Losses come in gaps of this length; 0: each event for itself.
    #[serde(default)]
    pub burst_us: f64,
}

/// Each stamp has a normal error of its own (1..1000 us).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StampJitter {
    /// Its standard deviation.
    pub sigma_us: f64,
}

/// Each frame of the camera kicks its event pixels: `delay_us` after the exposure starts, later by
/// `row_us` a row, a pixel fires with probability `events_fraction`, ON or OFF alike.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApsCoupling {
    /// Share of pixels that fire at each frame, 1e-4..0.1.
    pub events_fraction: f64,
    /// From the exposure's start.
    pub delay_us: f64,
    /// From row to row; 0 for all rows at once.
    pub row_us: f64,
}
