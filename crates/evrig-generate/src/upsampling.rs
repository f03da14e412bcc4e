//! Temporal upsampling of frames before a generator sees them.

use crate::interpolate::Interpolator;
use crate::plane::PlaneInterpolator;
use crate::rows::RowTimes;
use evrig_core::frame::Luminance;

/// Temporal upsampling of a frame stream.
pub enum FrameUpsampling {
    /// None: frames as they are.
    Nothing,
    /// Linear in log brightness, pixel by pixel.
    Pixels(Interpolator),
    /// Along the motion of a plane (motion-compensated interpolation).
    Plane(Box<PlaneInterpolator>),
}

impl FrameUpsampling {
    /// Sets the exposure times of the rows of the following frames.
    pub fn set_rows(&mut self, rows: RowTimes) {
        if let Self::Plane(between) = self {
            between.set_rows(rows);
        }
    }

    /// Whether output frames are of one instant, whatever the row times of the input.
    #[must_use]
    pub const fn is_of_one_instant(&self) -> bool {
        matches!(self, Self::Plane(_))
    }

    /// Intervals filled pixel by pixel because the plane's motion was unknown.
    #[must_use]
    pub fn n_in_place(&self) -> u64 {
        if let Self::Plane(between) = self { between.n_in_place() } else { 0 }
    }

    /// Passes the frames after the previous one up to this one to `take`.
    ///
    /// # Errors
    /// Errors of `take`.
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
