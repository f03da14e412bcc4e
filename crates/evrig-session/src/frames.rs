//! Frames of a session's cameras with their timing, on their camera's own clock.
//!
//! | stream | clock | from |
//! | --- | --- | --- |
//! | `aps` | davis | `davis.aedat4` |
//! | `frames` | davis | imported arrays |
//! | `raw`, `rgb` of a recording | pi-sensor | `rig.mcap`, each image with its metadata |
//! | `raw`, `rgb` of an import | pi-sensor | arrays with `sensor_timestamp_ns` and `real_time_us` |

mod davis;
mod pi;
mod recorded_frame;

pub use davis::DavisFrames;
pub use pi::PiCameraFrames;
pub use recorded_frame::{FrameProperties, RecordedFrame};

use super::{RigLogContents, Session, SessionError, StreamEntry, StreamKind, rig_log};
use crate::rig::Rig;
use evrig_core::time::{Clock, PiSensor, Stamp, Unix};

#[cfg(test)]
mod tests;

impl Session {
    /// The rig that the session was recorded with; none for what was imported.
    ///
    /// # Errors
    /// When the manifest's copy of it cannot be parsed.
    pub fn rig(&self) -> Result<Option<Rig>, SessionError> {
        let Some(recording) = &self.manifest().recording else { return Ok(None) };
        let rig = Rig::parse("the rig in session.json", &recording.rig);
        rig.map(Some).map_err(|error| SessionError::Manifest {
            path: self.layout().manifest(),
            what: error.to_string(),
        })
    }

    /// The rig's log without images: metadata, clocks, arrivals, arm poses, commanded
    /// path; empty where there is no log. One pass over the file.
    ///
    /// # Errors
    /// When the log cannot be read or a message is not of its topic's schema.
    pub fn rig_log_contents(&self) -> Result<RigLogContents, SessionError> {
        let path = self.layout().rig_log();
        if path.exists() {
            Ok(rig_log::read_contents(&path)?)
        } else {
            Ok(RigLogContents::default())
        }
    }

    /// Whether a frame stream comes from the Pi's camera, so that [`Session::pi_frames`] reads it;
    /// [`Session::davis_frames`] reads the others.
    ///
    /// # Errors
    /// When there is no such stream.
    pub fn is_from_pi(&self, name: &str) -> Result<bool, SessionError> {
        Ok(is_from_pi(self.stream(StreamKind::Frames, name)?))
    }

    /// The frames of a stream of the Pi's camera, in the order in which they came.
    ///
    /// # Errors
    /// When there is no such stream, it is not the Pi's, or its files cannot be opened.
    pub fn pi_frames(&self, name: &str) -> Result<PiCameraFrames, SessionError> {
        let entry = self.stream(StreamKind::Frames, name)?;
        if !is_from_pi(entry) {
            return Err(self.other_clock(entry));
        }
        PiCameraFrames::open(self, entry)
    }

    /// The frames of a stream on the events' clock, in the order in which they came.
    ///
    /// # Errors
    /// When there is no such stream, it is on another clock, or its files cannot be opened.
    pub fn davis_frames(&self, name: &str) -> Result<DavisFrames, SessionError> {
        let entry = self.stream(StreamKind::Frames, name)?;
        if is_from_pi(entry) {
            return Err(self.other_clock(entry));
        }
        DavisFrames::open(self, entry)
    }

    /// SensorTimestamp and RealTime of each frame of an import from the published layout, in the
    /// order of recording; none for a RealTime that could not be read. Empty where there are none.
    ///
    /// # Errors
    /// When the columns cannot be read.
    pub fn imported_pi_stamps(&self) -> Result<Vec<PiStamps>, SessionError> {
        let sensor = self.layout().frames().join("sensor_timestamp_ns.npy");
        if !sensor.exists() {
            return Ok(Vec::new());
        }
        let real = pi::read_column(&self.layout().frames().join("real_time_us.npy"))?;
        let sensor = pi::read_column(&sensor)?;
        let stamps = sensor.into_iter().zip(real);
        Ok(stamps.map(|(ns, us)| (Stamp::from_nanos(ns), pi::real_time(us))).collect())
    }

    pub(super) fn other_clock(&self, entry: &StreamEntry) -> SessionError {
        SessionError::OtherClock {
            root: self.root().to_owned(),
            name: entry.name.clone(),
            clock: entry.clock.clone(),
        }
    }
}

/// SensorTimestamp and RealTime of a frame.
pub type PiStamps = (Stamp<PiSensor>, Option<Stamp<Unix>>);

/// Streams of the log are entered under the host's clock, which orders it.
pub(super) fn is_from_pi(entry: &StreamEntry) -> bool {
    entry.clock == PiSensor::NAME || entry.source.starts_with("/pi/")
}
