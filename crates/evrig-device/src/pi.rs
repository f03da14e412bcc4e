//! The Raspberry Pi camera as a recorder: a client of the agent that runs on the Pi.

mod budget;
mod client;
mod connection;
pub mod pairing;

pub use client::{NetworkPi, PiTimeouts};
pub use connection::AgentAddress;
