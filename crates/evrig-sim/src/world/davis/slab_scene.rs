//! What all pixels of a slab share, and a worker's buffers.

use super::circuit::StepConstants;
use super::slab::Slab;
use crate::world::illumination::Illumination;
use crate::world::view::CameraView;

/// What all pixels of a slab need.
pub(super) struct SlabScene<'a> {
    pub(super) view: &'a CameraView,
    pub(super) light: &'a Illumination,
    pub(super) slab: &'a Slab,
    pub(super) seed: u64,
    /// The share of reflectance that is called white.
    pub(super) white: f32,
}

/// Buffers that a worker uses again and again.
#[derive(Debug, Default)]
pub(super) struct PixelBuffers {
    /// Reflectance times gain, in shares of white, at each look; one value where it is constant.
    pub(super) seen: Vec<f32>,
    /// Events that come by themselves: seconds of world time.
    pub(super) forced: Vec<(f64, bool)>,
    /// Of the steps that were needed last.
    pub(super) pace: StepConstants,
}
