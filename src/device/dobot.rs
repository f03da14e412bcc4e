//! The Dobot Magician: a robot arm on a serial line.

pub mod alarm;
pub mod client;
pub mod command;
pub mod fields;
pub mod frame;
pub mod id;
pub mod link;
pub mod port;
pub mod reply;

pub use client::{Client, ClientError, Identity, Patience, TimedPose};
