//! What all cameras have in common: lifecycle verbs, and a bounded way for their samples.

mod account;
mod outlet;

pub use account::Account;
pub use outlet::{Inlet, Outlet, Taken, channel};

use super::{Finding, host_clock};
use evrig_core::pi_camera::PiFrame;
use evrig_core::time::Stamp;
use evrig_format::aedat4::{Content, StreamSpec};
use evrig_session::trajectory::StepSettings;
use evrig_session::{ClockExchange, HostTime};

/// Now, on both clocks of the host.
#[must_use]
pub fn host_time() -> HostTime {
    let unix = chrono::Utc::now().timestamp_nanos_opt().unwrap_or(i64::MAX);
    HostTime { monotonic: host_clock::now(), unix: Stamp::from_nanos(unix) }
}

/// One thing that a recorder delivers.
#[derive(Debug)]
pub enum Sample {
    /// A packet of an event camera, as it came.
    Packet {
        /// Its stream, by the place in [`Prepared::streams`].
        stream: u32,
        /// When it was whole.
        arrived: HostTime,
        /// What it holds.
        content: Content,
    },
    /// A frame of the frame camera.
    Frame {
        /// When it was whole.
        arrived: HostTime,
        /// Its pictures and what the camera says of them.
        frame: Box<PiFrame>,
    },
    /// The RGB picture of a frame that was delivered without it before.
    LateRgb {
        /// When it was whole.
        arrived: HostTime,
        /// The picture and the frame's metadata.
        frame: Box<PiFrame>,
    },
    /// A remark of the device for the rig's log.
    Note {
        /// When it was made.
        at: HostTime,
        /// What it says.
        text: String,
    },
    /// Clocks read side by side.
    Clock(ClockExchange),
}

impl Sample {
    /// Events in it.
    #[must_use]
    pub fn n_events(&self) -> u64 {
        match self {
            Self::Packet { content: Content::Events(events), .. } => events.len() as u64,
            _ => 0,
        }
    }

    /// Bytes it takes in memory, nearly.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        let payload = match self {
            Self::Packet { content, .. } => match content {
                Content::Events(events) => events.len() * 13,
                Content::Frame(frame) => {
                    frame.samples.len() * usize::from(frame.samples.bits()) / 8
                }
                Content::Imu(samples) => samples.len() * 48,
                Content::Triggers(triggers) => triggers.len() * 16,
                Content::Unknown { .. } => 0,
            },
            Self::Frame { frame, .. } | Self::LateRgb { frame, .. } => frame.n_bytes(),
            Self::Note { text, .. } => text.len(),
            Self::Clock(_) => 0,
        };
        payload + 256
    }
}

/// What a recorder found when it was set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// Who it is and what it reads back, for the manifest.
    pub says: serde_json::Value,
    /// Streams of its packets, for recorders that deliver packets.
    pub streams: Vec<StreamSpec>,
}

/// What became of a recorder so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
    /// Samples put into the outlet.
    pub n_samples: u64,
    /// Samples lost because the outlet, or the device's own buffer, was full.
    pub n_dropped: u64,
    /// Interruptions and losses, in words, each with what is known of its length.
    pub gaps: Vec<String>,
    /// Whether a source that has an end, a recording, has reached it.
    pub is_over: bool,
}

/// Why a recorder cannot record.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {because}; {remedy}")]
pub struct RecorderError {
    /// Which, with its address.
    pub device: String,
    /// What happened: expected and got.
    pub because: String,
    /// What to do.
    pub remedy: &'static str,
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

    /// Looks at everything that must hold before a recording. Nothing is set.
    fn check(&mut self) -> Vec<Finding>;

    /// Connects and sets the device up.
    ///
    /// # Errors
    /// Whatever keeps it from recording.
    fn prepare(&mut self) -> Result<Prepared, RecorderError>;

    /// Lets samples flow; returns once the first has arrived.
    ///
    /// # Errors
    /// When none arrives in time.
    fn start(&mut self, outlet: Outlet) -> Result<(), RecorderError>;

    /// Sets what a step of the path asks for beside the motion; what this device cannot do of it
    /// comes back in words.
    fn set(&mut self, settings: &StepSettings) -> Vec<String> {
        unset(self.name(), settings)
    }

    /// Looks how it goes.
    ///
    /// # Errors
    /// When the device is gone and did not come back in the time it has for that.
    fn progress(&mut self) -> Result<Tally, RecorderError>;

    /// Sees no more light from its first call on; the share of what it saw before that has come,
    /// 1 when all has. A device that keeps up has nothing to settle.
    ///
    /// # Errors
    /// When the device was lost.
    fn settle(&mut self) -> Result<f64, RecorderError> {
        Ok(1.0)
    }

    /// Takes what is still under way, ends, and says what became of it all.
    ///
    /// # Errors
    /// When the device was lost before.
    fn finish(&mut self) -> Result<Tally, RecorderError>;

    /// Ends at once, in any state, as often as called.
    fn abort(&mut self);
}
