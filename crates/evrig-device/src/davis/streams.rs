//! The streams of an event camera, as they are written again and described in the manifest.

use evrig_format::aedat4::{StreamHeader, StreamSpec};

/// The stream as it is written again.
pub(super) fn spec(stream: &StreamHeader) -> StreamSpec {
    StreamSpec {
        name: stream.name.clone(),
        kind: stream.kind.clone(),
        size: stream.size,
        source: stream.source.clone(),
    }
}

/// The streams, for the manifest.
pub(super) fn describe(source: &str, streams: &[StreamSpec]) -> serde_json::Value {
    let stream = |spec: &StreamSpec| {
        serde_json::json!({
            "name": spec.name, "kind": spec.kind.identifier(), "camera": spec.source,
            "size": spec.size,
        })
    };
    serde_json::json!({"source": source, "streams": streams.iter().map(stream).collect::<Vec<_>>()})
}
