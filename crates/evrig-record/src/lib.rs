//! Device traits and the recording engine: from the preflight check to a sealed session.
//!
//! The engine drives an [`Arm`] and [`Recorder`]s and knows no driver; the simulated rig and a dry
//! run are other devices behind the same traits. Its states follow one another ([`RecordState`]).
//! After any failure the arm stops, the cameras end, the files are counted and sealed, and the
//! manifest states what happened.

mod arm;
mod disk_sync;
mod dry_run;
mod engine;
pub mod files;
pub mod host_clock;
pub mod manifest_entries;
pub mod recorder;
mod runs;
mod state;
mod stop;
mod wall_clock;

pub use arm::{Arm, DeviceError, Finding, PoseReading, Progress, Verdict};
pub use dry_run::{DryRun, DryRunError, DryRunResult, dry_run};
pub use engine::{Dwells, Prompts, RecordError, RecordOutcome, RecordRequest, preflight, record};
pub use runs::{RUNS_SCHEMA, RunAttempt, RunList, RunsError};
pub use state::RecordState;
pub use stop::{EmergencyStop, GuardEnd, StopRequest, StopToken};

use crate::recorder::Recorder;

/// The devices of a rig.
pub struct Devices {
    /// Drives the path.
    pub arm: Box<dyn Arm>,
    /// Cameras and other sources of samples.
    pub recorders: Vec<Box<dyn Recorder>>,
}
