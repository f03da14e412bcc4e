//! The interface of all generators and why they refuse frames.

use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;

/// A model that makes events from frames.
pub trait Generator: Send {
    /// The model's name on the command line.
    fn name(&self) -> &'static str;

    /// Takes in the next frame and appends the events since the previous one to `out`:
    /// after the previous frame's time, up to and including this frame's, in ascending
    /// time, within a microsecond by row and column. The first frame sets size and
    /// starting brightness. A refused frame changes nothing; the next may follow.
    ///
    /// # Errors
    /// A frame that is not later than the previous one, is too late, has another size, or
    /// holds brightness that is not finite or negative.
    fn push(&mut self, frame: &Luminance, out: &mut Events) -> Result<(), GenerateError>;

    /// Restarts pixels (row-major numbers) with the last frame as their first: for a signal that
    /// was not known before.
    fn restart(&mut self, pixels: &[u32]);
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
    /// A pause that no recording has: the times are in another unit.
    #[error(
        "frame {index} at {t_us} us comes more than a day after the frame before it \
         ({previous_us} us); check the unit of the time stamps, or split the stream at the gap"
    )]
    GapTooLong {
        /// Number of the frame, from 0.
        index: u64,
        /// Its time.
        t_us: i64,
        /// Time of the frame before it.
        previous_us: i64,
    },
    /// Parameters that give an unbounded event rate.
    #[error(
        "in the {span_us} us before frame {index} a pixel may fire {expected:.0} times, more than \
         {limit}; check the unit of the time stamps and the generator's parameters"
    )]
    TooManyEvents {
        /// Number of the frame, from 0.
        index: u64,
        /// Time since the frame before it.
        span_us: u32,
        /// Bound of a pixel's mean number of events in it.
        expected: f64,
        /// The most that is allowed.
        limit: f64,
    },
    /// As many brightness values as pixels.
    #[error("frame {index} is {size} and holds {found} values; expected {expected}")]
    WrongLength {
        /// Number of the frame, from 0.
        index: u64,
        /// Its size.
        size: Size,
        /// Pixels of that size.
        expected: usize,
        /// Values found.
        found: usize,
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
        /// The value.
        value: f32,
    },
}
