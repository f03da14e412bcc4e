//! From brightness on a pixel grid to events. Pure: no files, no devices.
//!
//! A [`Generator`] takes frames in ascending time and emits the events between
//! the previous frame and this one. [`forward::ForwardSimulator`] takes a
//! [`Drive`](evrig_core::drive::Drive) instead, with any set of physical effects.
//! Both are seeded; the same seed gives the same events, whatever the number of threads.

#[macro_use]
mod parameter_error;

mod driven;
pub mod effect;
mod esim;
pub mod forward;
mod generator;
mod grid;
pub mod input;
mod interpolate;
mod knobs;
#[cfg(test)]
mod ks;
mod limits;
pub mod live;
mod merge;
mod model;
mod parameters;
mod phase_locking;
mod pixel_model;
mod plane;
mod preset;
mod random;
mod rows;
mod sequence;
mod threads;
mod upsampling;
mod v2e;
pub mod voltmeter;

pub use driven::{DRIVE_STEP_US, DriveFrames, DriveRun};
pub use esim::EsimParameters;
pub use generator::{GenerateError, Generator};
pub use interpolate::Interpolator;
pub use knobs::{Knob, KnobDescription, KnobSetting};
pub use model::{GeneratorModel, ModelParameters};
pub use parameter_error::ParameterError;
pub use parameters::{GenerateParameters, GeneratorChoice, build};
pub use phase_locking::PhaseLocking;
pub use plane::{PlaneInterpolator, PlanePath, PlaneWarper};
pub use preset::Preset;
pub use rows::{RowShift, RowTimes};
pub use upsampling::FrameUpsampling;
pub use v2e::V2eParameters;
pub use voltmeter::VoltmeterLaw;
