//! Temporal upsampling of frames before a generator sees them.

use crate::interpolate::Interpolator;
use crate::plane::PlaneInterpolator;
use crate::rows::RowTimes;
use evrig_core::frame::Luminance;

/// What is put between frames.
pub enum FrameUpsampling {
    /// Nothing: frames as they are.
    Nothing,
    /// Frames in which every pixel is straight in log brightness.
    Pixels(Interpolator),
    /// Frames in which the plane that is seen moves on.
    Plane(Box<PlaneInterpolator>),
}

impl FrameUpsampling {
    /// Rows of the frames to come saw their light at these times.
    pub fn set_rows(&mut self, rows: RowTimes) {
        if let Self::Plane(between) = self {
            between.set_rows(rows);
        }
    }

    /// Whether what is handed on is of one instant, whatever the rows' times were.
    #[must_use]
    pub const fn is_of_one_instant(&self) -> bool {
        matches!(self, Self::Plane(_))
    }

    /// Intervals that were to be filled along the plane's way and were filled pixel by pixel.
    #[must_use]
    pub fn n_in_place(&self) -> u64 {
        if let Self::Plane(between) = self { between.n_in_place() } else { 0 }
    }

    /// Hands on the frames after the previous one up to this one.
    ///
    /// # Errors
    /// What `take` refuses.
    pub fn push<E>(
        &mut self,
        frame: Luminance,
        mut take: impl FnMut(&Luminance) -> Result<(), E>,
    ) -> Result<(), E> {
        match self {
            Self::Nothing => take(&frame),
            Self::Pixels(between) => between.push(frame, take),
            Self::Plane(between) => between.push(frame, take),
        }
    }
}
