//! The DAVIS346: events, frames and inertial samples, from a server or a recording.
//!
//! A server is dv-runtime, dv-processing's `NetworkWriter` or [`serve`]: AEDAT4 over TCP, one stream
//! a port, so a source has one address a stream. What arrives is handed on as it came, with
//! the host's time of its arrival; nothing is sorted, cut or corrected here.

mod network;
mod replay;
pub mod serve;
#[cfg(feature = "usb")]
mod usb;

pub use network::{NetworkDavis, Patience};
pub use replay::{Pace, ReplayDavis};
#[cfg(feature = "usb")]
pub use usb::UsbDavis;

use evrig_format::aedat4::{StreamHeader, StreamSpec};

/// The stream as it is written again.
fn spec(stream: &StreamHeader) -> StreamSpec {
    StreamSpec {
        name: stream.name.clone(),
        kind: stream.kind.clone(),
        size: stream.size,
        source: stream.source.clone(),
    }
}

/// The streams, for the manifest.
fn says(source: &str, streams: &[StreamSpec]) -> serde_json::Value {
    let stream = |spec: &StreamSpec| {
        serde_json::json!({
            "name": spec.name, "kind": spec.kind.identifier(), "camera": spec.source,
            "size": spec.size,
        })
    };
    serde_json::json!({"source": source, "streams": streams.iter().map(stream).collect::<Vec<_>>()})
}
