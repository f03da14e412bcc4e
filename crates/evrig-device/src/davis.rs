//! The DAVIS346: events, frames and inertial samples, from a server or a recording.
//!
//! A server is dv-runtime, dv-processing's `NetworkWriter` or [`crate::stream_server`]: AEDAT4 over
//! TCP, one stream a port, so a source has one address a stream. Packets are passed on as they
//! came, with the host's time of its arrival; nothing is sorted, cut or corrected here.

mod network;
mod replay;
mod streams;
#[cfg(feature = "usb")]
mod usb;

pub use network::{NetworkDavis, NetworkDavisTimeouts};
pub use replay::{ReplayDavis, ReplaySpeed};
#[cfg(feature = "usb")]
pub use usb::UsbDavis;
