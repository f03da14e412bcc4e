//! Recorded events against their prediction, and against drawn ones.

use super::pixel_events::Spike;

/// The pixel's event before an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PreviousEvent {
    /// Time since it, seconds.
    pub(crate) ago_s: f64,
    /// Its polarity.
    pub(crate) on: bool,
}

/// One event against its prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Residual {
    /// Pixel column.
    pub(crate) x: u16,
    /// Pixel row.
    pub(crate) y: u16,
    /// Microseconds since the start of the window.
    pub(crate) t_us: i64,
    /// Polarity.
    pub(crate) on: bool,
    /// Change of the signal beyond the threshold at the event, in thresholds: positive for a late
    /// event, negative for an early one. `None` for a first event.
    pub(crate) innovation: Option<f64>,
    /// Logarithm of the predicted hazard, per second.
    pub(crate) log_hazard: f64,
    /// Share of background in that hazard, 0 to 1.
    pub(crate) background_share: f64,
    /// Compensator since the event before: exponential with mean 1 under the true parameters.
    pub(crate) compensator: f64,
    /// Slope of the signal towards the event's polarity, log intensity per second.
    pub(crate) slope_per_s: f64,
    /// Log intensity relative to white.
    pub(crate) level: f64,
    /// The pixel's event before, inside the window.
    pub(crate) previous: Option<PreviousEvent>,
}

/// An event and the signal at that time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SpikeContext {
    /// The event.
    pub(crate) spike: Spike,
    /// Change of the signal since the event before towards the event's polarity, log intensity.
    pub(crate) change: f64,
    /// Slope of the signal towards the event's polarity, log intensity per second.
    pub(crate) slope_per_s: f64,
    /// Log intensity relative to white.
    pub(crate) level: f64,
}

/// The events that followed, and would have followed, an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NextEventPair {
    /// Number of the event that both follow.
    pub(crate) before: usize,
    /// The recorded next event; none at the end of the known signal.
    pub(crate) real: Option<SpikeContext>,
    /// One drawn from the model with the same past.
    pub(crate) drawn: Option<SpikeContext>,
}
