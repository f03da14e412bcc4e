//! Events from a drive: pixels driven by light at any time, with any set of effects.
//!
//! The light of each pixel is taken at a fixed step, changed by the effects before the
//! comparator, and led through a [`PixelModel`] by the exact law between instants. Random numbers
//! are counted by pixel, so that neither threads nor the choice of pixels changes a pixel's events.

mod camera;
mod comparator_input;
mod noisy;
mod parameters;
mod quiet;
mod simulator;
#[cfg(test)]
mod tests;

pub use crate::pixel_model::{BandNoise, PixelModel, ThresholdScatter};
pub use camera::DiagnosedCamera;
pub use parameters::{ForwardError, ForwardParameters};
pub use simulator::{ForwardSimulator, SimulatedEvents};
