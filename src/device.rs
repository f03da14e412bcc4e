//! The devices of a rig, real and simulated.

pub mod sim;
