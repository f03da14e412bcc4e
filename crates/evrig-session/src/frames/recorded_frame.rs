//! A frame with its timing and the meaning of its samples.

use crate::{Session, SessionError, StreamEntry};
use evrig_core::frame::{BayerOrder, Frame, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Stamp, Unix};

/// One frame with its properties.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedFrame<C: Clock> {
    /// Number in its stream, from 0, those that could not be used counted too.
    pub number: u64,
    /// Samples and timing. `frame.origin` is the place of the first pixel on the sensor.
    pub frame: Frame<C>,
    /// Properties of the samples.
    pub properties: FrameProperties,
}

/// Properties of a frame's samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameProperties {
    /// Bits of a sample that are used: 8, or 10 for raw frames stored in 16.
    pub bits: u8,
    /// The mosaic's colours; none for grey and colour frames.
    pub bayer: Option<BayerOrder>,
    /// Black level of a sample, digital units: R, green by R, green by B, B of a mosaic,
    /// else four times the same. Zero where nothing is stated.
    pub black_dn: [f32; 4],
    /// Analogue times digital gain, where it is stated.
    pub gain: Option<f64>,
    /// The wall clock of the camera's computer when it received the frame; it may step and lags
    /// the exposure by exposure time, readout and queues.
    pub real_time: Option<Stamp<Unix>>,
}

impl<C: Clock> RecordedFrame<C> {
    /// Brightness of each pixel in the frame's own digital units, pedestal in it: a mosaic's
    /// (R + 2 G + B) / 4, all bits kept; colour weighted as in BT.601; grey as it is.
    #[must_use]
    pub fn luma(&self) -> Vec<f32> {
        match (&self.frame.samples, self.properties.bayer) {
            (Samples::U16(mosaic), Some(_)) => {
                evrig_core::frame::bayer_brightness(mosaic, self.frame.size)
            }
            _ => self.frame.brightness(),
        }
    }
}

/// The size that the manifest states.
pub(super) fn stated_size(session: &Session, entry: &StreamEntry) -> Result<Size, SessionError> {
    entry.size.ok_or_else(|| SessionError::Manifest {
        path: session.layout().manifest(),
        what: format!("stream `{}` states no size", entry.name),
    })
}
