//! The devices of the rig, and their simulated twins.

pub mod dobot;
