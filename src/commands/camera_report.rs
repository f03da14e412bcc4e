//! `evrig camera-report`: what the events alone show of the camera.

use super::{Ending, Output, WrongUse};
use crate::cli::CameraReportArgs;
use crate::pipeline::default_light;
use anyhow::Context;
use evrig_analysis::camera_report::{CameraReport, FrameStarts, camera_report};
use evrig_core::event::Events;
use evrig_core::frame::FrameTiming;
use evrig_core::geometry::Size;
use evrig_core::time::Davis;
use evrig_report::camera_report as words;
use evrig_session::import::{EventTableOptions, read_recording};
use evrig_session::{Session, StreamKind};
use serde_json::{Value, json};
use std::path::Path;

/// Events with the frames of their camera, and notes about the reading.
struct ReportInput {
    name: String,
    events: Events,
    size: Size,
    frames: Vec<FrameTiming<Davis>>,
    notes: Vec<String>,
    has_losses: bool,
}

pub(super) fn run(args: &CameraReportArgs, output: &Output) -> anyhow::Result<Ending> {
    let is_session = args.path.join("session.json").exists();
    let input = if is_session { of_session(args)? } else { of_file(args)? };
    let frames = FrameStarts::of_frames(&input.frames);
    let report = camera_report(input.events.as_slice(), input.size, frames.as_ref())
        .with_context(|| args.path.display().to_string())?;
    let value = value(&input, &report)?;
    if let Some(out) = &args.out {
        write_page(out, &input, &report, &value)?;
        output.say(format_args!("wrote {}", out.join("index.html").display()));
    }
    input.notes.iter().for_each(|note| output.say(note));
    output.result(&value, words::text(&input.name, &report))?;
    Ok(if input.has_losses { Ending::WithLosses } else { Ending::Done })
}

fn of_session(args: &CameraReportArgs) -> anyhow::Result<ReportInput> {
    if args.events.options() != EventTableOptions::default() || args.size.is_some() {
        let what = "options of tables have no effect on a session, omit them";
        return Err(WrongUse(format!("{}: {what}", args.path.display())).into());
    }
    let session = Session::open(&args.path)?;
    let (events, tally) = session.events(&args.stream)?;
    let stated = session.stream(StreamKind::Events, &args.stream).ok();
    let size = stated.and_then(|entry| entry.size).or_else(|| session.size());
    let size = size.with_context(|| {
        format!("{}: stream `{}` states no size of the sensor", args.path.display(), args.stream)
    })?;
    let mut frames = Vec::new();
    if let Some(name) = default_light(&session) {
        for frame in session.davis_frames(name)? {
            frames.push(frame?.frame.timing);
        }
    }
    let mut notes = Vec::new();
    if tally.outside > 0 {
        notes.push(format!("left out: {} events off the sensor", tally.outside));
    }
    let name = format!("{}, stream {}", session.manifest().name, args.stream);
    Ok(ReportInput { name, events, size, frames, notes, has_losses: tally.outside > 0 })
}

fn of_file(args: &CameraReportArgs) -> anyhow::Result<ReportInput> {
    let found = read_recording(&args.path, args.size, &args.events.options())?;
    let mut notes: Vec<String> =
        found.decisions.iter().map(|decision| format!("decided: {decision}")).collect();
    notes.extend(found.losses.iter().map(|loss| match loss.count {
        0 => format!("lost: {}", loss.what),
        n => format!("lost: {n} {}", loss.what),
    }));
    let name = args.path.file_name().unwrap_or(args.path.as_os_str()).to_string_lossy();
    Ok(ReportInput {
        name: name.into_owned(),
        events: found.events,
        size: found.size,
        frames: found.frames,
        notes,
        has_losses: !found.losses.is_empty(),
    })
}

fn value(input: &ReportInput, report: &CameraReport) -> anyhow::Result<Value> {
    let mut value = serde_json::to_value(report)?;
    if let Value::Object(fields) = &mut value {
        fields.insert("name".into(), json!(input.name));
        fields.insert("notes".into(), json!(input.notes));
    }
    Ok(value)
}

fn write_page(
    out: &Path,
    input: &ReportInput,
    report: &CameraReport,
    value: &Value,
) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)
        .with_context(|| format!("cannot create the folder {}", out.display()))?;
    let page = words::page(&input.name, report, &input.notes)?.to_html()?;
    let text = serde_json::to_string_pretty(value)?;
    for (name, content) in [("index.html", page), ("camera-report.json", text)] {
        let path = out.join(name);
        std::fs::write(&path, content)
            .with_context(|| format!("cannot write the report to {}", path.display()))?;
    }
    Ok(())
}
