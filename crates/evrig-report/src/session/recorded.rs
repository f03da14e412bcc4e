//! What the top of the page states of the recording.

use crate::number::count;
use crate::page::Fact;
use evrig_session::{Manifest, StreamKind};

/// Counts and duration.
pub(super) fn facts(manifest: &Manifest) -> Vec<Fact> {
    let streams = manifest.streams.iter();
    let is_shown = |kind| matches!(kind, StreamKind::Events | StreamKind::Frames);
    let mut facts: Vec<Fact> = streams
        .filter(|stream| stream.count > 0 && is_shown(stream.kind))
        .map(|stream| {
            let kind = stream.kind.to_string();
            Fact::new(
                &format!("{kind} “{}”", stream.name),
                format!("{} {kind}", count(stream.count)),
            )
        })
        .collect();
    // Streams on other clocks do not give the duration of the recording.
    let of = |kind| manifest.streams.iter().find(move |stream| stream.kind == kind);
    let clock = of(StreamKind::Events).or_else(|| of(StreamKind::Frames)).map(|main| &main.clock);
    let streams = || manifest.streams.iter().filter(|stream| Some(&stream.clock) == clock);
    let first = streams().filter_map(|stream| stream.first_us).min();
    let last = streams().filter_map(|stream| stream.last_us).max();
    if let Some((first, last)) = first.zip(last) {
        facts.push(Fact::new("duration", format!("{:.3} s", (last - first) as f64 * 1e-6)));
    }
    facts
}

/// A remark on a recording that no real camera made.
pub(super) fn simulated(manifest: &Manifest) -> Option<String> {
    let devices = &manifest.recording.as_ref()?.devices;
    devices.iter().any(|device| device.description["source"] == "sim").then(|| {
        "The rig is simulated: recorded events and frames come from simulated cameras.".to_owned()
    })
}

/// What was lost.
pub(super) fn losses(manifest: &Manifest) -> Vec<String> {
    let loss = |loss: &evrig_session::DataLoss| match loss.count {
        0 => format!("Lost in {}: {}", loss.stream, loss.what),
        n => format!("Lost in {}: {n} {}", loss.stream, loss.what),
    };
    manifest.losses.iter().map(loss).collect()
}
