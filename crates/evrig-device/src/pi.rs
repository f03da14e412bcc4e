//! The Raspberry Pi camera as a recorder: a client of the agent that runs on the Pi.

mod budget;
mod client;
mod line;

pub use client::{NetworkPi, Patience};
pub use line::Reach;
