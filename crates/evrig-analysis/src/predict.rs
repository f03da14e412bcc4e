//! Likelihood of recorded events given the log-intensity signal of their pixels.
//!
//! Each pixel is a point process conditioned on its own recorded past; given the signal, pixels are
//! independent. The hazard is smooth in all parameters (`law`).

mod band;
mod burst_window;
mod bursts;
mod draw;
mod hazard;
pub(crate) mod law;
pub(crate) mod pass;
mod pixel_events;
mod residual;
pub(crate) mod signal;
mod softplus;
mod time_blocks;

pub(crate) use burst_window::BurstWindow;
pub(crate) use law::ComparatorLaw;
pub(crate) use pass::{HazardTerm, TermVisitor, visit};
pub use pixel_events::{EventsByPixel, Spike};
pub(crate) use residual::{NextEventPair, PreviousEvent, Residual, SpikeContext};
pub(crate) use signal::SampledSignal;
pub use time_blocks::TimeBlocks;

#[cfg(test)]
mod tests;
