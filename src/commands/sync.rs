//! `evrig sync`: the session's clocks, each with its error.

use super::{Ending, Output};
use crate::cli::SyncArgs;
use crate::pipeline::{self, Freshness, Synced};
use evrig_core::time::Span;
use evrig_reconstruct::clock::{MethodResult, SessionClocks, StreamDelay, TimeReference};
use evrig_session::Session;
use serde_json::json;

pub(super) fn run(args: &SyncArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let synced = pipeline::sync(&session, args.force)?;
    output.result(&value(&synced), text(&synced))?;
    let is_whole = synced.tally.n_duplicate == 0 && synced.tally.n_missing == 0;
    Ok(if is_whole { Ending::Done } else { Ending::WithLosses })
}

/// The result as consumers of `--json` get it.
pub(super) fn value(synced: &Synced) -> serde_json::Value {
    json!({
        "schema": "evrig.sync/1",
        "fresh": synced.freshness == Freshness::Fresh,
        "tally": synced.tally,
        "clocks": synced.clocks,
    })
}

/// The result for people.
pub(super) fn text(synced: &Synced) -> String {
    let clocks = &synced.clocks;
    let (tally, map) = (&synced.tally, &clocks.unix_from_sensor);
    let whose = match clocks.reference {
        TimeReference::Host => "the host's Unix time",
        TimeReference::PiWall => "the Pi's wall clock, taken for Unix time",
    };
    let mut lines = vec![format!(
        "SensorTimestamp to {whose} by {}: {} segments, {} steps, from {} frames and {} readings",
        method(map.method),
        map.segments.len(),
        map.n_steps(),
        tally.n_frames,
        tally.n_readings,
    )];
    if let Some(error) = map.segments.first().and_then(|segment| segment.error) {
        let end = |end: Option<Span>| end.map_or("unbounded".into(), |span| span.to_string());
        lines.push(format!(
            "  truth minus map, 95 %: {} to {}; with the latency's unknown part: {} to {}",
            error.statistical95[0],
            error.statistical95[1],
            end(error.absolute95[0]),
            end(error.absolute95[1]),
        ));
    }
    lines.extend(clocks.wall.iter().filter_map(refusal));
    lines.extend(clocks.host.iter().filter_map(refusal));
    for other in &clocks.disagreements {
        lines.push(format!(
            "  {} is off by {} ({} beyond both intervals)",
            method(other.against),
            other.difference,
            other.beyond_intervals
        ));
    }
    if let Some(ahead) = clocks.wall_minus_host {
        lines.push(format!("  the Pi's wall clock is {ahead} ahead of the host's"));
    }
    lines.push(format!("events: {}", clocks.events.reason));
    lines.push(motion(clocks));
    lines.extend(clocks.stream_delays.iter().map(late));
    for (n, what) in [
        (tally.n_duplicate, "with the timestamp of another"),
        (tally.n_missing, "missing between others"),
    ] {
        if n > 0 {
            lines.push(format!("{n} frames {what}"));
        }
    }
    if synced.freshness == Freshness::Fresh {
        lines.push("(fresh)".into());
    }
    lines.join("\n")
}

/// The clock correction from the motion that both cameras saw.
fn motion(clocks: &SessionClocks) -> String {
    match &clocks.motion {
        None => "motion: no tracks of both cameras yet; `evrig track` makes them".into(),
        Some(motion) => match (&motion.estimate, &motion.refused) {
            (_, Some(because)) => format!("motion: not used: {because}"),
            (Some(found), None) => format!(
                "motion: corrects the map by {} us +- {} (standard error); the Pi's frames follow \
                 it",
                rounded(found.correction_us.value),
                rounded(found.correction_us.standard_error)
            ),
            (None, None) => String::new(),
        },
    }
}

/// Delay of a stream whose timestamps belong to another stream's exposure.
fn late(late: &StreamDelay) -> String {
    let StreamDelay { stream, against, delay_us, refused } = late;
    match (delay_us, refused) {
        (Some(us), _) => format!(
            "`{stream}` was exposed {} us +- {} later than its timestamps, which are those of \
             `{against}`; corrected",
            rounded(us.value),
            rounded(us.standard_error)
        ),
        (None, because) => format!(
            "`{stream}` shares the stamps of `{against}` and is a frame late at least; not \
             corrected: {}",
            because.as_deref().unwrap_or("no estimate of the delay")
        ),
    }
}

fn rounded(us: f64) -> String {
    format!("{us:.1}")
}

fn method(method: evrig_reconstruct::clock::Method) -> String {
    let json = serde_json::to_value(method).unwrap_or_default();
    json.as_str().unwrap_or_default().to_owned()
}

fn refusal(attempt: &MethodResult) -> Option<String> {
    let because = attempt.refused.as_ref()?;
    Some(format!("  {} gives no estimate: {because}", method(attempt.method)))
}
