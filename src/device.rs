//! The devices of the rig, and their simulated twins.

pub mod dobot;
pub mod host_clock;
pub mod sim;
