//! One tag in one frame, without a track: for a look at what a camera sees now.

use super::detect::TagDetector;
use super::grey::{Grey, Light};
use evrig_core::frame::Frame;
use evrig_core::time::Clock;

/// Half the resolution in which edges are sought, for speed.
const DECIMATION: f32 = 2.0;

/// Finds one tag in frames that have nothing to do with each other.
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

    /// The tag's corners as the library finds them, in the frame's pixels: bottom left, bottom
    /// right, top right, top left. None where it is not seen.
    #[must_use]
    pub fn look<C: Clock>(&mut self, frame: &Frame<C>) -> Option<[[f64; 2]; 4]> {
        let grey = Grey::to_search(frame, self.light)?;
        let window = grey.whole();
        self.detector.look(&grey, window, DECIMATION).corners
    }
}
