//! The recording engine: from the first look at the devices to a sealed session.
//!
//! It knows an [`Arm`] and some [`Recorder`]s and nothing else; the simulated rig and a dry run are
//! other devices behind the same traits. Its states follow one another ([`State`]); whatever goes
//! wrong in any of them ends in the same way: the arm stands, the cameras end, the files are
//! counted and sealed, and the manifest says what happened.

mod arm;
mod durable;
mod engine;
pub mod files;
pub mod host_clock;
pub mod pose_log;
pub mod recorder;
mod rehearse;
mod runs;
mod stop;
pub mod told;
mod wall_clock;

pub use arm::{Arm, DeviceError, Finding, PoseReading, Progress, Verdict};
pub use engine::{Dwells, Outcome, Prompts, RecordError, Request, preflight, record};
pub use rehearse::{Rehearsal, RehearsalError, Rehearsed, rehearse};
pub use runs::{Attempt, RUNS_SCHEMA, RunList, RunsError};
pub use stop::{Stop, StopToken};

use crate::recorder::Recorder;
use serde::Serialize;

/// The devices of a rig.
pub struct Devices {
    /// What moves.
    pub arm: Box<dyn Arm>,
    /// What looks.
    pub recorders: Vec<Box<dyn Recorder>>,
}

/// Where a recording is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Everything is looked at; nothing moves.
    Preflight,
    /// Cameras are set up, and the arm goes to its start.
    StartPose,
    /// Cameras run; their first samples are waited for.
    Cameras,
    /// They run while the arm rests.
    LeadIn,
    /// The arm moves.
    Trajectory,
    /// They run while the arm rests again.
    Tail,
    /// What is under way is taken.
    Drain,
    /// The files are counted and the manifest is written.
    Seal,
}

impl std::fmt::Display for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Preflight => "preflight",
            Self::StartPose => "start pose",
            Self::Cameras => "cameras",
            Self::LeadIn => "lead-in",
            Self::Trajectory => "trajectory",
            Self::Tail => "tail",
            Self::Drain => "drain",
            Self::Seal => "seal",
        })
    }
}
