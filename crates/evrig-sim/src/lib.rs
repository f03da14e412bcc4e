//! The simulated rig: simulated devices on real serial lines and sockets.
//!
//! It is the ground truth of tests and trials, so it shares no model with the code that is
//! validated on it: neither with the generators nor with the path checker.

pub mod arm;
pub mod davis;
pub mod live;
pub mod pi;
pub mod progress;
pub mod recorder;
mod simulate;
pub mod world;

pub use simulate::{SimulateError, Simulation, simulate};
