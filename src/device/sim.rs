//! The simulated rig.

pub mod world;
