//! A frame of intensities, read between its pixels.

use super::bilinear::BilinearWeights;
use evrig_core::geometry::Size;

/// A frame's intensities, row-major.
#[derive(Clone, Copy)]
pub(super) struct FrameView<'a> {
    pub(super) size: Size,
    pub(super) values: &'a [f32],
}

impl FrameView<'_> {
    pub(super) const fn width(&self) -> usize {
        self.size.width as usize
    }

    pub(super) const fn height(&self) -> usize {
        self.size.height as usize
    }

    /// Bilinear weights at a position in pixels from the centre of the first.
    pub(super) fn corners(&self, place: [f32; 2]) -> BilinearWeights {
        BilinearWeights::at([self.width(), self.height()], place)
    }

    pub(super) fn at(&self, place: [f32; 2]) -> f32 {
        self.corners(place).value(self.values)
    }
}
