//! The simulated Magician: a state machine without I/O on its own clock.
//!
//! It answers frames and moves with time as documented by the vendor, its virtual arm and users'
//! traces; where they leave the firmware's behaviour open, an option of [`ArmOptions`] states the
//! assumption.

mod answer;
mod dynamics;
pub mod fault;
pub mod journal;
mod kinematics;
mod motion;
mod options;
mod path;
mod plan;
mod profile;
mod queue;
mod registers;
mod serve;
mod simulated;
mod trace;

pub use dynamics::Imperfections;
pub use kinematics::SimulatedJointLimits;
pub use options::{AlarmPolicy, ArcSpeed, ArmOptions};
pub use serve::{ArmClock, ArmEmulator, ArmState, EmulatorError, TraceFollower};
pub use simulated::SimulatedArm;
pub use trace::ToolTrace;
