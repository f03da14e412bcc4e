//! `evrig filter`: event streams cropped to the target, without noise.

use super::{Ending, Output, stream_name};
use crate::cli::{FilterArgs, FilterChoice};
use crate::pipeline::{self, FilterRequest, FilterSettings, FilteredStream, Freshness};
use evrig_session::Session;
use serde_json::{Value, json};

pub(super) fn run(args: &FilterArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let streams = match &args.stream {
        Some(name) => vec![stream_name(name)?],
        None => pipeline::event_streams(&session),
    };
    if streams.is_empty() {
        anyhow::bail!("{} has no events to filter", args.session.display());
    }
    let settings = settings(&args.choice);
    let mut values = Vec::new();
    let mut text = Vec::new();
    for stream in streams {
        let request = FilterRequest { stream, settings, force: args.force };
        let filtered = pipeline::filter(&session, &request)?;
        values.push(value(&request, &filtered));
        text.push(self::text(&request, &filtered));
    }
    output.result(&json!({ "schema": "evrig.filters/1", "filters": values }), text.join("\n"))?;
    Ok(Ending::Done)
}

fn settings(choice: &FilterChoice) -> FilterSettings {
    FilterSettings {
        region: !choice.no_region,
        margin: choice.margin,
        crop_px: choice.crop,
        hot_pixel: choice.hot_pixel,
        background_us: choice.background_us,
        refractory_us: choice.refractory_us,
        max_events_per_ms: choice.max_events_per_ms,
    }
}

/// The result as consumers of `--json` get it.
pub(super) fn value(request: &FilterRequest, filtered: &FilteredStream) -> Value {
    json!({
        "stream": request.stream.as_str(),
        "fresh": filtered.freshness == Freshness::Fresh,
        "settings": request.settings,
        "tally": filtered.tally,
    })
}

/// The result for people.
pub(super) fn text(request: &FilterRequest, filtered: &FilteredStream) -> String {
    let tally = &filtered.tally;
    let mut text =
        format!("{}: {} of {} events kept", request.stream, tally.events.kept, tally.events.seen);
    for (reason, n) in &tally.events.dropped {
        let json = serde_json::to_value(reason).unwrap_or_default();
        let reason = json.as_str().unwrap_or_default().replace('_', " ");
        text += &format!(", {n} dropped ({reason})");
    }
    if let Some(size) = tally.size {
        text += &format!(", on {size}");
    }
    if filtered.freshness == Freshness::Fresh {
        text += " (fresh)";
    }
    text
}
