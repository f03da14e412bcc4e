//! `evrig track`: the path of the tag through frames.

use super::{Ending, Output, WrongUse};
use crate::cli::TrackArgs;
use crate::pipeline::{self, Freshness, TrackRequest, Tracked};
use evrig_session::Session;
use evrig_session::rig::Rig;
use serde_json::{Value, json};

pub(super) fn run(args: &TrackArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let rig = match &args.rig {
        Some(named) => {
            let rig = Rig::find(named).map_err(|error| WrongUse(error.to_string()))?;
            Some((named.clone(), rig))
        }
        None => None,
    };
    let streams = match &args.stream {
        Some(stream) => vec![stream.clone()],
        None => pipeline::frame_streams(&session),
    };
    if streams.is_empty() {
        anyhow::bail!("{} has no frames in which to detect the tag", args.session.display());
    }
    let requests: Vec<TrackRequest> = streams
        .into_iter()
        .map(|stream| TrackRequest { stream, rig: rig.clone(), force: args.force })
        .collect();
    let mut values = Vec::new();
    let mut text = Vec::new();
    let n_frames = pipeline::count_frames(&session, requests.iter().map(|r| &r.stream));
    let bar = output.progress("track", n_frames);
    let outcomes = pipeline::track_all(&session, &requests, &|| bar.inc(1));
    bar.finish_and_clear();
    for (request, tracked) in outcomes {
        let tracked = tracked?;
        values.push(value(&request, &tracked));
        text.push(self::text(&request, &tracked));
    }
    output.result(&json!({ "schema": "evrig.tracks/1", "tracks": values }), text.join("\n"))?;
    Ok(Ending::Done)
}

/// The result as consumers of `--json` get it.
pub(super) fn value(request: &TrackRequest, tracked: &Tracked) -> Value {
    json!({
        "stream": request.stream,
        "fresh": tracked.freshness == Freshness::Fresh,
        "summary": tracked.summary,
    })
}

/// The result for people.
pub(super) fn text(request: &TrackRequest, tracked: &Tracked) -> String {
    let summary = &tracked.summary;
    let mut text = format!(
        "{}: {} in {} of {} frames, corners {:.3} px rms from the path, target {:.1} px wide",
        request.stream,
        summary.tag,
        summary.n_used,
        summary.n_seen,
        summary.corner_rms_px,
        summary.picture_px
    );
    if !summary.lost.is_empty() {
        text += &format!("; lost: {}", summary.lost);
    }
    if summary.n_gaps > 0 {
        text += &format!("; {} gaps of {:.3} s together", summary.n_gaps, summary.gaps_s);
    }
    if tracked.freshness == Freshness::Fresh {
        text += " (fresh)";
    }
    text
}
