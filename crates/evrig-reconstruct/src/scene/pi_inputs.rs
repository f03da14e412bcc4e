//! Inputs of the reconstruction from the Pi camera.

use super::error::SceneError;
use super::pi_camera::RawLevels;
use crate::roi::{Lens, Track};
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::time::{PiSensor, Span};
use evrig_session::rig::Mount;

/// Callback for every frame with its index.
pub type FrameVisitor<'a> = dyn FnMut(usize, &Frame<PiSensor>) -> Result<(), SceneError> + 'a;

/// The Pi's raw frames, which can be read more than once.
pub trait RawFrames {
    /// Why a frame cannot be read.
    type Error: From<SceneError>;

    /// Visits every frame in order of time with its index from 0.
    ///
    /// # Errors
    /// When a frame cannot be read, or `visit` rejects one.
    fn replay(&mut self, visit: &mut FrameVisitor<'_>) -> Result<(), Self::Error>;
}

impl RawFrames for &[Frame<PiSensor>] {
    type Error = SceneError;

    fn replay(&mut self, visit: &mut FrameVisitor<'_>) -> Result<(), SceneError> {
        self.iter().enumerate().try_for_each(|(index, frame)| visit(index, frame))
    }
}

/// Known inputs of the reconstruction.
#[derive(Debug, Clone, Copy)]
pub struct PiInputs<'a> {
    /// Size of the frames.
    pub size: Size,
    /// Lens of the camera.
    pub lens: Lens,
    /// Levels of its raw samples.
    pub raw: RawLevels,
    /// Nominal row time.
    pub row_time: Span,
    /// Mount of both cameras.
    pub mount: Mount,
    /// Track of the tag in the frames.
    pub track: &'a Track<PiSensor>,
}
