//! `evrig info`: the streams of a session, counted from its files.

use super::{Ending, Output};
use crate::cli::InfoArgs;
use evrig_core::time::{Clock, Davis};
use evrig_session::{Manifest, Session, StreamEntry, StreamKind, count_file};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// One stream as it is in its file now.
#[derive(Debug, Serialize)]
struct StreamInfo {
    name: String,
    kind: StreamKind,
    /// recorded, or the stage that made it.
    made_by: String,
    file: String,
    width: Option<u16>,
    height: Option<u16>,
    count: u64,
    first_us: Option<i64>,
    last_us: Option<i64>,
    clock: String,
    duration_s: Option<f64>,
    rate_hz: Option<f64>,
    longest_gap_us: Option<i64>,
    on_share: Option<f64>,
    n_disordered: Option<u64>,
    n_outside: Option<u64>,
    source: String,
}

pub(super) fn run(args: &InfoArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let manifest = session.manifest();
    let mut streams = Vec::new();
    let mut censuses = BTreeMap::new();
    for entry in &manifest.streams {
        let mut info = StreamInfo::from_manifest(entry);
        if entry.file.ends_with(".aedat4") {
            if !censuses.contains_key(&entry.file) {
                let path = session.layout().inside(&entry.file)?;
                censuses.insert(entry.file.clone(), count_file(&path, &mut |_| {})?);
            }
            let found = censuses[&entry.file].streams.iter();
            if let Some(found) = found.into_iter().find(|s| entry.stream_id == Some(s.stream.id)) {
                info.count_from(found);
            }
        }
        streams.push(info);
    }
    for name in session.generated_names() {
        let path = session.layout().generated(&name);
        let file = format!("derived/generate-{name}/events.aedat4");
        for found in count_file(&path, &mut |_| {})?.streams {
            let mut info = StreamInfo::generated(name.as_str(), &file, &found.stream.source);
            info.count_from(&found);
            streams.push(info);
        }
    }
    let text = text(manifest, &streams);
    let value = serde_json::json!({
        "schema": "evrig.info/1",
        "name": manifest.name,
        "evrig_version": manifest.evrig_version,
        "created": manifest.created,
        "origin": manifest.origin,
        "status": manifest.status,
        "streams": streams,
        "losses": manifest.losses,
        "decisions": manifest.decisions,
    });
    output.result(&value, text)?;
    Ok(Ending::Done)
}

impl StreamInfo {
    fn from_manifest(entry: &StreamEntry) -> Self {
        let mut info = Self {
            name: entry.name.clone(),
            kind: entry.kind,
            made_by: "recorded".into(),
            file: entry.file.clone(),
            width: entry.size.map(|size| size.width),
            height: entry.size.map(|size| size.height),
            count: entry.count,
            first_us: entry.first_us,
            last_us: entry.last_us,
            clock: entry.clock.clone(),
            duration_s: None,
            rate_hz: None,
            longest_gap_us: None,
            on_share: None,
            n_disordered: None,
            n_outside: None,
            source: entry.source.clone(),
        };
        info.derive();
        info
    }

    fn generated(name: &str, file: &str, source: &str) -> Self {
        let entry = StreamEntry {
            name: name.into(),
            kind: StreamKind::Events,
            file: file.into(),
            stream_id: None,
            size: None,
            count: 0,
            first_us: None,
            last_us: None,
            clock: Davis::NAME.into(),
            source: source.into(),
        };
        Self { made_by: "generate".into(), ..Self::from_manifest(&entry) }
    }

    /// Replaces the manifest's counts by those of the file.
    fn count_from(&mut self, found: &evrig_session::StreamCounts) {
        self.width = found.size.map(|size| size.width);
        self.height = found.size.map(|size| size.height);
        self.count = found.count;
        self.first_us = found.first_us;
        self.last_us = found.last_us;
        self.longest_gap_us = Some(found.longest_gap_us);
        self.n_disordered = Some(found.n_disordered);
        if self.kind == StreamKind::Events {
            self.n_outside = Some(found.n_outside);
            self.on_share = (found.count > 0).then(|| found.n_on as f64 / found.count as f64);
        }
        self.derive();
    }

    fn derive(&mut self) {
        let (Some(first), Some(last)) = (self.first_us, self.last_us) else { return };
        let seconds = last.saturating_sub(first) as f64 * 1e-6;
        self.duration_s = Some(seconds);
        if seconds > 0.0 && self.count > 1 {
            self.rate_hz = Some((self.count - 1) as f64 / seconds);
        }
    }
}

fn text(manifest: &Manifest, streams: &[StreamInfo]) -> String {
    let mut text = format!("{} ({}), made {}\n", manifest.name, manifest.status, manifest.created);
    let _ = writeln!(
        text,
        "{:<14} {:<9} {:>12} {:>10} {:>12} {:>12}  {:<9} {:>16} {:>16}  from",
        "stream",
        "kind",
        "count",
        "seconds",
        "per second",
        "longest gap",
        "grid",
        "begin (us)",
        "end (us)"
    );
    for stream in streams {
        let or_dash = |value: Option<String>| value.unwrap_or_else(|| "-".into());
        let grid = stream.width.zip(stream.height).map(|(w, h)| format!("{w} x {h}"));
        let gap = stream.longest_gap_us.map(|us| format!("{:.3} ms", us as f64 * 1e-3));
        let _ = writeln!(
            text,
            "{:<14} {:<9} {:>12} {:>10} {:>12} {:>12}  {:<9} {:>16} {:>16}  {}",
            stream.name,
            stream.kind.to_string(),
            stream.count,
            or_dash(stream.duration_s.map(|s| format!("{s:.3}"))),
            or_dash(stream.rate_hz.map(|hz| format!("{hz:.1}"))),
            or_dash(gap),
            or_dash(grid),
            or_dash(stream.first_us.map(|us| us.to_string())),
            or_dash(stream.last_us.map(|us| us.to_string())),
            stream.made_by,
        );
    }
    for loss in &manifest.losses {
        let _ = writeln!(text, "lost: {}: {} ({})", loss.stream, loss.what, loss.count);
    }
    text.trim_end().to_owned()
}
