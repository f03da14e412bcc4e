//! What the events alone show of the camera and its readout, without any light signal.
//!
//! [`camera_report`] makes linear passes over the events of one stream. Each section holds its
//! estimates with their errors, or states that the events are too few for it.

mod burst_shape;
mod burst_wake;
mod chance;
mod frame_coupling;
mod frame_fold;
mod shear_search;

pub use burst_wake::BurstWake;
pub use frame_coupling::{CouplingBurst, FrameCoupling, RejectedBurst};
pub use frame_fold::{FrameReference, FrameStarts};

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use serde::Serialize;

/// Schema of the report as JSON.
pub const CAMERA_REPORT_SCHEMA: &str = "evrig.camera-report/1";

/// A section's findings, or why there are none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SectionResult<T> {
    /// What was measured.
    Known(T),
    /// The events or frames are too few.
    TooFew {
        /// For what, how many there are, and how many are needed.
        too_few: String,
    },
}

/// A polarity in words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum PolarityName {
    /// Brightness rose.
    On,
    /// Brightness fell.
    Off,
}

/// Why a stream cannot be reported on.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum CameraReportError {
    /// Nothing to count.
    #[error("there are no events to report on; expected at least one")]
    NoEvents,
    /// Times go back.
    #[error(
        "event {index} is earlier than the one before it; expected ascending times: sort the \
         events, or take one epoch of the camera's clock"
    )]
    Disorder {
        /// The first such event.
        index: usize,
    },
    /// An event is not on the sensor.
    #[error("event {index} is off the {size} grid; expected events on the sensor: state its size")]
    Outside {
        /// The first such event.
        index: usize,
        /// The grid.
        size: Size,
    },
}

/// What the events of one stream show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraReport {
    /// [`CAMERA_REPORT_SCHEMA`].
    pub schema: &'static str,
    /// Events of the stream.
    pub n_events: u64,
    /// The sensor.
    pub size: Size,
    /// Events that follow the camera's own frames.
    pub frame_coupling: SectionResult<FrameCoupling>,
}

impl<T> SectionResult<T> {
    pub(crate) fn too_few(reason: impl Into<String>) -> Self {
        Self::TooFew { too_few: reason.into() }
    }

    /// The findings, where there are any.
    pub fn known(&self) -> Option<&T> {
        match self {
            Self::Known(found) => Some(found),
            Self::TooFew { .. } => None,
        }
    }
}

impl PolarityName {
    /// The polarity of an event.
    #[must_use]
    pub const fn of(on: bool) -> Self {
        if on { Self::On } else { Self::Off }
    }
}

impl std::fmt::Display for PolarityName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if *self == Self::On { "ON" } else { "OFF" })
    }
}

/// Reports on the events of one stream, in ascending time, and on the camera's frames where their
/// times are known.
///
/// # Errors
/// [`CameraReportError`] for no events, events out of order, or events off the sensor.
pub fn camera_report(
    events: EventSlice<'_>,
    size: Size,
    frames: Option<&FrameStarts>,
) -> Result<CameraReport, CameraReportError> {
    if events.is_empty() {
        return Err(CameraReportError::NoEvents);
    }
    if let Some(index) = events.first_disorder() {
        return Err(CameraReportError::Disorder { index });
    }
    if let Some(index) = events.first_outside(size) {
        return Err(CameraReportError::Outside { index, size });
    }
    let frame_coupling = match frames {
        Some(frames) => frame_coupling::coupling(events, size, frames, 1.0),
        None => SectionResult::too_few("no frames"),
    };
    Ok(CameraReport {
        schema: CAMERA_REPORT_SCHEMA,
        n_events: events.len() as u64,
        size,
        frame_coupling,
    })
}
