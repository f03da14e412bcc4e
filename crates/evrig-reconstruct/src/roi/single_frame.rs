//! Tag detection in single frames, without a track, for live views.

use super::grey_image::{GreyImage, SampleFormat};
use super::tag_detector::TagDetector;
use evrig_core::frame::Frame;
use evrig_core::time::Clock;

/// Decimation of the edge search.
const DECIMATION: f32 = 2.0;

/// Detects one tag in unrelated frames.
pub struct SingleFrameDetector {
    detector: TagDetector,
    format: SampleFormat,
}

impl std::fmt::Debug for SingleFrameDetector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SingleFrameDetector").field("format", &self.format).finish_non_exhaustive()
    }
}

impl SingleFrameDetector {
    /// None when the library does not know the family.
    #[must_use]
    pub fn new(family: &str, id: u32, format: SampleFormat) -> Option<Self> {
        Some(Self { detector: TagDetector::new(family, id)?, format })
    }

    /// The tag's corners from the library, in the frame's pixels: bottom left, bottom right, top
    /// right, top left. None where it is not detected.
    #[must_use]
    pub fn search<C: Clock>(&mut self, frame: &Frame<C>) -> Option<[[f64; 2]; 4]> {
        let grey = GreyImage::to_search(frame, self.format)?;
        let window = grey.whole();
        self.detector.search(&grey, window, DECIMATION).corners
    }
}
