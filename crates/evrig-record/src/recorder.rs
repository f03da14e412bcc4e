//! The trait of a camera, and the bounded queue of its samples.

mod monitor;
mod sample;
mod sample_queue;
mod tally;

pub use monitor::RecorderMonitor;
pub use sample::RecorderSample;
pub use sample_queue::{Received, SampleReceiver, SampleSender, channel};
pub use tally::{RecorderError, RecorderTally};

use crate::{Finding, host_clock};
use evrig_core::time::Stamp;
use evrig_format::aedat4::StreamSpec;
use evrig_session::HostTime;
use evrig_session::trajectory::StepSettings;

/// Now, on both clocks of the host.
#[must_use]
pub fn host_time() -> HostTime {
    let unix = chrono::Utc::now().timestamp_nanos_opt().unwrap_or(i64::MAX);
    HostTime { monotonic: host_clock::now(), unix: Stamp::from_nanos(unix) }
}

/// What a recorder found when it was set up.
#[derive(Debug, Clone, PartialEq)]
pub struct PreparedRecorder {
    /// Who it is and what it reads back, for the manifest.
    pub description: serde_json::Value,
    /// Streams of its packets, for recorders that deliver packets.
    pub streams: Vec<StreamSpec>,
}

/// What a step asks of a camera that cannot be set while it runs.
fn unset(camera: &str, settings: &StepSettings) -> Vec<String> {
    let asked = [
        ("aps", settings.aps.is_some()),
        ("exposure_scale", settings.exposure_scale.is_some()),
        ("biases", !settings.biases.is_empty()),
    ];
    let asked = asked.into_iter().filter(|(_, is_asked)| *is_asked);
    asked.map(|(what, _)| format!("{camera} cannot set {what} while it runs")).collect()
}

/// A camera.
pub trait Recorder: Send {
    /// Its part in the rig, as the manifest names it.
    fn name(&self) -> &'static str;

    /// Checks everything that must hold before a recording. Nothing is set.
    fn check(&mut self) -> Vec<Finding>;

    /// Connects and sets the device up.
    ///
    /// # Errors
    /// Whatever keeps it from recording.
    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError>;

    /// Lets samples flow; returns once the first has arrived.
    ///
    /// # Errors
    /// When none arrives in time.
    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError>;

    /// Sets what a step of the path asks for beside the motion; what this device cannot do of it
    /// comes back in words.
    fn set(&mut self, settings: &StepSettings) -> Vec<String> {
        unset(self.name(), settings)
    }

    /// The tally so far.
    ///
    /// # Errors
    /// When the device is gone and did not come back in the time it has for that.
    fn progress(&mut self) -> Result<RecorderTally, RecorderError>;

    /// Takes no new samples from its first call on; returns the share of the earlier ones that has
    /// come, 0..=1. A device that keeps up has nothing to settle.
    ///
    /// # Errors
    /// When the device was lost.
    fn settle(&mut self) -> Result<f64, RecorderError> {
        Ok(1.0)
    }

    /// Takes the samples still under way, ends, and returns the final tally.
    ///
    /// # Errors
    /// When the device was lost before.
    fn finish(&mut self) -> Result<RecorderTally, RecorderError>;

    /// Ends at once, in any state, as often as called.
    fn abort(&mut self);
}
