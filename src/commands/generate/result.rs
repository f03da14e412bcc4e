//! A generation for people and as JSON.

use crate::pipeline::{Freshness, GenerateRequest, Generated, VariantRequest};
use evrig_report::number::counted;
use serde_json::{Value, json};

/// The result as consumers of `--json` get it.
pub(in crate::commands) fn value(request: &GenerateRequest, made: &Generated) -> Value {
    let mut value = counts(request.name.as_str(), &request.from, made);
    value["parameters"] = json!(request.parameters);
    value["conditions"] = json!(request.conditions);
    value
}

/// The same of any variant.
pub(super) fn variant_value(request: &VariantRequest, made: &Generated) -> Value {
    match request {
        VariantRequest::Model(request) => value(request, made),
        VariantRequest::External(request) => {
            let simulator = &request.simulator;
            let mut value = counts(&simulator.name, &simulator.from, made);
            value["parameters"] = made.record.parameters.clone();
            value
        }
    }
}

fn counts(stream: &str, from: &str, made: &Generated) -> Value {
    json!({
        "schema": "evrig.generation/1",
        "stream": stream,
        "from": from,
        "fresh": made.freshness == Freshness::Fresh,
        "frames": made.tally.n_frames,
        "events": made.tally.n_events,
        "on": made.tally.n_on,
        "frames_not_later": made.tally.n_frames_not_later,
        "intervals_filled_in_place": made.tally.n_filled_in_place,
        "frame_rhythm": made.tally.frame_rhythm,
        "first_us": made.tally.first_us,
        "last_us": made.tally.last_us,
        "speed": made.speed,
    })
}

/// The result for people.
pub(in crate::commands) fn text(request: &GenerateRequest, made: &Generated) -> String {
    let tally = &made.tally;
    let mut text = format!(
        "{}: {} from {} of {}",
        request.name,
        counted(tally.n_events, "event"),
        counted(tally.n_frames, "frame"),
        request.from
    );
    if tally.n_frames_not_later > 0 {
        text += &format!(", {} frames left out (not later)", tally.n_frames_not_later);
    }
    if tally.n_filled_in_place > 0 {
        text += &format!(
            ", {} intervals interpolated per pixel (no track there)",
            tally.n_filled_in_place
        );
    }
    if let Some(rhythm) = tally.frame_rhythm {
        text += &format!(", frame rhythm {rhythm:.3}");
    }
    text + &speed(made)
}

/// The generator's speed in brackets.
pub(super) fn speed(made: &Generated) -> String {
    match &made.speed {
        Some(speed) => format!(
            " ({:.0} frames/s, {:.1} ns per pixel and frame)",
            speed.frames_per_s, speed.ns_per_pixel_frame
        ),
        None => " (fresh)".to_owned(),
    }
}
