//! The Dobot Magician: a robot arm on a serial line.

pub mod alarm;
pub mod arm;
mod check;
pub mod client;
pub mod command;
pub mod fields;
pub mod find;
pub mod frame;
pub mod guard;
pub mod id;
pub mod link;
pub mod params;
pub mod port;
mod prepare;
mod queue;
pub mod reply;
mod steps;

pub use arm::{ArmError, Magician, Marker};
pub use client::{ArmClient, ArmClientError, ArmTimeouts, Identity};
