//! From brightness on a pixel grid to events. Pure: no files, no devices.
//!
//! A [`Generator`] takes frames in ascending time and emits the events between
//! the previous frame and this one. Generators are seeded; the same seed gives
//! the same events, whatever the number of threads.

use crate::event::Events;
use crate::frame::Luminance;
use crate::geometry::Size;

/// A model that makes events from frames.
pub trait Generator {
    /// The model's name on the command line.
    fn name(&self) -> &'static str;

    /// Takes in the next frame and appends the events since the previous one to `out`,
    /// in ascending time; the first frame only sets the starting brightness.
    ///
    /// # Errors
    /// A frame that is not later than the previous one, has another size, or holds
    /// brightness that is not finite or negative.
    fn push(&mut self, frame: &Luminance, out: &mut Events) -> Result<(), GenerateError>;
}

/// Why frames cannot be turned into events.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// Time must ascend from frame to frame.
    #[error(
        "frame {index} at {t_us} us is not later than the frame before it ({previous_us} us); \
         remove the duplicate or sort the frames by time"
    )]
    TimeNotAscending {
        /// Number of the frame, from 0.
        index: u64,
        /// Its time.
        t_us: i64,
        /// Time of the frame before it.
        previous_us: i64,
    },
    /// All frames of a stream have one size.
    #[error("frame {index} is {found}, the frames before it are {expected}; a stream has one size")]
    SizeChanged {
        /// Number of the frame, from 0.
        index: u64,
        /// Size of the first frame.
        expected: Size,
        /// Size of this frame.
        found: Size,
    },
    /// Brightness is a finite number that is not negative.
    #[error(
        "frame {index} has brightness {value} at pixel ({x}, {y}); expected a finite value >= 0"
    )]
    BadBrightness {
        /// Number of the frame, from 0.
        index: u64,
        /// Pixel column.
        x: u16,
        /// Pixel row.
        y: u16,
        /// What stands there.
        value: f32,
    },
}
