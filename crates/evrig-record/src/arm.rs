//! The devices of the rig, and their simulated twins.
//!
//! A device is a small trait of lifecycle verbs; each verb ends within a time
//! it is given or states, and `abort` works at once, in any state, as often as
//! it is called.

pub use evrig_core::finding::{Finding, Verdict};

use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_session::rig::{Joints, Pose};
use evrig_session::trajectory::ToolPath;
use serde::Serialize;
use std::ops::Range;

/// A pose of the planner and when it held.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseReading {
    /// Where the arm believes its tool to be.
    pub pose: Pose,
    /// Its joints.
    pub joints: Joints,
    /// Host time before the question.
    pub asked: Stamp<HostMonotonic>,
    /// Host time after the answer.
    pub answered: Stamp<HostMonotonic>,
}

impl PoseReading {
    /// The middle of the exchange, the best single time for the pose.
    #[must_use]
    pub fn time(&self) -> Stamp<HostMonotonic> {
        self.asked + Span::from_nanos((self.answered - self.asked).as_nanos() / 2)
    }

    /// Half the exchange: the pose held within this of [`PoseReading::time`].
    #[must_use]
    pub fn uncertainty(&self) -> Span {
        Span::from_nanos((self.answered - self.asked).as_nanos() / 2 + 1)
    }
}

/// Why a device cannot do what was asked: the driver's own error, which names the device, what was
/// expected and what to do.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct DeviceError(Box<dyn std::error::Error + Send + Sync>);

impl DeviceError {
    /// Wraps a driver's error.
    pub fn new(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self(Box::new(error))
    }
}

/// How far a motion has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Where the planner is, and when.
    pub pose: PoseReading,
    /// The step under way; the last one when all are done.
    pub step: usize,
    /// Whether all steps that were started have ended.
    pub is_done: bool,
    /// How often the arm had no further point of a continuous curve and so had to brake on it.
    pub n_dry: u32,
}

/// An arm that drives a path.
pub trait Arm: Send {
    /// Looks at everything that must hold before `path` is driven. Nothing moves.
    fn check(&mut self, path: Option<&ToolPath>) -> Vec<Finding>;

    /// Sets the arm up for `path` and goes to its start. What it did otherwise than asked
    /// (a circle as arcs, say) comes back in words.
    ///
    /// # Errors
    /// Whatever keeps the arm from its start; it then stands.
    fn prepare(&mut self, path: &ToolPath) -> Result<Vec<String>, DeviceError>;

    /// Starts the given steps of the prepared path, which begin where the arm stands.
    ///
    /// # Errors
    /// Whatever keeps the arm from moving; it then stands.
    fn start(&mut self, steps: Range<usize>) -> Result<(), DeviceError>;

    /// Looks once how far the motion is, and feeds the arm with what it has room for. To be
    /// called at the rate at which poses are wanted.
    ///
    /// # Errors
    /// An alarm, silence, a motion that does not end in time; the arm is stopped before.
    fn progress(&mut self) -> Result<Progress, DeviceError>;

    /// Ends after the last step: the queue is stopped and empty.
    ///
    /// # Errors
    /// When the arm did not confirm.
    fn finish(&mut self) -> Result<(), DeviceError>;

    /// Stops at once, in any state, as often as called.
    ///
    /// # Errors
    /// When the arm did not confirm.
    fn abort(&mut self) -> Result<(), DeviceError>;
}
