//! The simulated rig: devices that do not exist on wires that do.
//!
//! What is here stands for reality in tests and trials, so it shares no model
//! with the code that is proven on it: not the generators', not the checker's.

pub mod arm;
pub mod davis;
pub mod live;
pub mod pi;
pub mod progress;
pub mod recorder;
mod simulate;
pub mod world;

pub use simulate::{SimulateError, Simulation, simulate};
