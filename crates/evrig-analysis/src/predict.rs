//! Teacher-forced likelihood of recorded events given the log-intensity signal of their pixels.
//!
//! Each pixel is a point process that depends on its own past. At an event, and after the refractory
//! period, the pixel stores a reference level; the signal `y` is the change of log intensity since
//! then, with leak. Each polarity has a threshold that is drawn anew for every event from a
//! log-logistic distribution. An event occurs when the running maximum of `y` (ON) or of `-y` (OFF)
//! exceeds it. The compensator of a monotone interval is therefore a difference of two values of one
//! cumulative hazard, so that nothing is integrated over a time grid.
//!
//! Two hazards come on top: level crossings by noise, which moves the signal while the light is
//! constant (Rice, Bell Syst. Tech. J. 24, 1945), and background events. Before a pixel's first event
//! its reference level is unknown and lies between the two thresholds, so that silent pixels count
//! too. Where the reference level is ambiguous (events were removed by a filter or lost, or noise
//! events did not reset it) a mixture of a few weighted reference levels is propagated.
//!
//! The score is the log-likelihood of the process, of events and of silences, with time in seconds.
//! Pixels are conditionally independent given the signal.

mod event_loss;
mod leaky_signal;
mod likelihood;
mod noise_crossing;
mod normal;
mod pixel_events;
mod pixel_law;
mod pixel_signal;
mod reference_mixture;
mod reference_reset;
mod reference_state;
mod refractory_filter;
mod residual;
mod signal_knots;
mod simulate;
pub(crate) mod softplus;
mod threshold;
mod time_blocks;
mod unknown_reference;

pub use likelihood::{EventTerm, LikelihoodVisitor, SilentInterval, score_pixel, visit};
pub use pixel_events::{EventsByPixel, Spike};
pub use pixel_law::{PixelLaw, SHOT_NOISE_RMS_SPEED};
pub use pixel_signal::PixelSignal;
pub use residual::{BlockCounts, PreviousEvent, Residual, residuals};
pub use signal_knots::SignalKnots;
pub use simulate::{NextEventPair, SpikeContext, next_events, sample};
pub use time_blocks::{BlockScore, TimeBlocks};

#[cfg(test)]
mod tests;
