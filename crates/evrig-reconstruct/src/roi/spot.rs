//! Tag detection in single frames, without a track, for live views.

use super::detect::TagDetector;
use super::grey::{Grey, Light};
use evrig_core::frame::Frame;
use evrig_core::time::Clock;

/// Decimation of the edge search.
const DECIMATION: f32 = 2.0;

/// Detects one tag in unrelated frames.
pub struct Spotter {
    detector: TagDetector,
    light: Light,
}

impl std::fmt::Debug for Spotter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Spotter").field("light", &self.light).finish_non_exhaustive()
    }
}

impl Spotter {
    /// None when the library does not know the family.
    #[must_use]
    pub fn new(family: &str, id: u32, light: Light) -> Option<Self> {
        Some(Self { detector: TagDetector::new(family, id)?, light })
    }

    /// The tag's corners from the library, in the frame's pixels: bottom left, bottom right, top
    /// right, top left. None where it is not detected.
    #[must_use]
    pub fn look<C: Clock>(&mut self, frame: &Frame<C>) -> Option<[[f64; 2]; 4]> {
        let grey = Grey::to_search(frame, self.light)?;
        let window = grey.whole();
        self.detector.look(&grey, window, DECIMATION).corners
    }
}
