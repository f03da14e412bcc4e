//! Forward simulation: events from a drive, with any set of effects.
//!
//! The log-intensity signal of each pixel is sampled at a fixed step, changed by the effects before
//! the comparator, and passed through a [`PixelModel`] by the exact law between instants. Random
//! numbers are counter-based per pixel, so neither threads nor the choice of pixels changes a
//! pixel's events.

mod camera;
mod comparator_input;
mod noisy;
mod parameters;
mod quiet;
mod simulator;
#[cfg(test)]
mod tests;

pub use crate::pixel_model::{BandNoise, PixelModel, ThresholdScatter};
pub use camera::CameraConstants;
pub use parameters::{ForwardError, ForwardParameters};
pub use simulator::{ForwardSimulator, SimulatedEvents};
