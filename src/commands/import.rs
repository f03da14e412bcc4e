//! `evrig import`: recordings of other software become sessions.

use super::{Ending, Output, WrongUse};
use crate::cli::{
    ImportAedat4Args, ImportAnyArgs, ImportArgs, ImportCommand, ImportFramesArgs,
    ImportRaw2EventArgs,
};
use evrig_session::import::{
    FrameTimes, ImportEvents, ImportFrames, ImportRaw2Event, ImportRecording, RecordingKind,
    detect, import_aedat4, import_event_folder, import_events, import_frames, import_raw2event,
    import_recording,
};
use evrig_session::{Manifest, StreamName};
use std::fmt::Write;
use std::path::Path;

pub(super) fn run(args: &ImportArgs, output: &Output) -> anyhow::Result<Ending> {
    match &args.what {
        Some(ImportCommand::Aedat4(args)) => aedat4(args, output),
        Some(ImportCommand::Frames(args)) => frames(args, output),
        Some(ImportCommand::Raw2Event(args)) => raw2event(args, output),
        None => any(&args.any, output),
    }
}

/// Finds out what a path holds and imports it.
fn any(args: &ImportAnyArgs, output: &Output) -> anyhow::Result<Ending> {
    let (Some(path), Some(out)) = (&args.path, &args.out) else {
        return Err(WrongUse("give the recording to import, and --out".into()).into());
    };
    if !path.exists() {
        let what = format!("{}: there is no such file or folder; check the path", path.display());
        return Err(WrongUse(what).into());
    }
    let events = args.events.clone();
    match detect(path)? {
        RecordingKind::Aedat4 => {
            let (file, out) = (path.clone(), out.clone());
            aedat4(&ImportAedat4Args { file, out, epoch: events.epoch }, output)
        }
        RecordingKind::Frames => {
            let args = ImportFramesArgs {
                frames: path.clone(),
                fps: args.fps,
                timestamps: args.timestamps.clone(),
                timestamps_unit: None,
                events: None,
                events_name: "real".into(),
                out: out.clone(),
                event_options: events,
                size: args.size,
                raw: args.raw.clone(),
            };
            frames(&args, output)
        }
        RecordingKind::Raw2Event => {
            let what = "it holds recordings of the Raw2Event recorder; choose one with \
                        `evrig import raw2event DIRECTORY --id PART-OF-THE-NAME`";
            Err(WrongUse(format!("{}: {what}", path.display())).into())
        }
        RecordingKind::EventFolder => {
            let options = events.options();
            let manifest = import_event_folder(path, args.size, &options, out)?;
            finish(&manifest, out, output)
        }
        RecordingKind::Recording => {
            let options = events.options();
            let request = ImportRecording { file: path, size: args.size, options };
            let manifest = import_recording(&request, out)?;
            finish(&manifest, out, output)
        }
        RecordingKind::Events => {
            let options = events.options();
            let request = ImportEvents { file: path, size: args.size, options };
            let manifest = import_events(&request, out)?;
            finish(&manifest, out, output)
        }
    }
}

fn aedat4(args: &ImportAedat4Args, output: &Output) -> anyhow::Result<Ending> {
    let n_bytes = std::fs::metadata(&args.file).map(|meta| meta.len()).unwrap_or(0);
    let bar = output.progress("import", 2 * n_bytes);
    let mut progress = |done| bar.set_position(done);
    let manifest = import_aedat4(&args.file, &args.out, args.epoch, &mut progress)?;
    bar.finish_and_clear();
    finish(&manifest, &args.out, output)
}

fn frames(args: &ImportFramesArgs, output: &Output) -> anyhow::Result<Ending> {
    let times = match (&args.timestamps, args.fps) {
        (Some(path), _) if path.as_os_str() == "names" => FrameTimes::Names,
        (Some(path), _) => FrameTimes::File(path.clone()),
        (None, Some(fps)) => FrameTimes::Fps(fps),
        (None, None) => return Err(WrongUse("give --fps or --timestamps".into()).into()),
    };
    let events_name =
        StreamName::new(&args.events_name).map_err(|error| WrongUse(error.to_string()))?;
    let options = args.event_options.options();
    if args.events.is_none() && options != Default::default() {
        return Err(WrongUse("options of events have no effect without --events".into()).into());
    }
    let request = ImportFrames {
        frames: &args.frames,
        times,
        frame_time_unit: args.timestamps_unit,
        events: args.events.as_deref(),
        events_name,
        options,
        raw: args.raw.options(args.size),
    };
    let manifest = import_frames(&request, &args.out)?;
    finish(&manifest, &args.out, output)
}

fn raw2event(args: &ImportRaw2EventArgs, output: &Output) -> anyhow::Result<Ending> {
    let zone = args.timezone.parse().map_err(|_| {
        WrongUse(format!("`{}` is no time zone; give one as UTC or Europe/Brussels", args.timezone))
    })?;
    let request =
        ImportRaw2Event { directory: &args.directory, id: &args.id, size: args.size, zone };
    let bar = output.progress("import", 0);
    let manifest = import_raw2event(&request, &args.out, &mut |done| bar.set_position(done))?;
    bar.finish_and_clear();
    finish(&manifest, &args.out, output)
}

fn finish(manifest: &Manifest, out: &Path, output: &Output) -> anyhow::Result<Ending> {
    manifest.decisions.iter().for_each(|decision| output.say(format_args!("decided: {decision}")));
    let mut text = format!("{}: {}", out.display(), counts(manifest));
    for loss in &manifest.losses {
        let _ = match loss.count {
            0 => write!(text, "\n  lost: {}: {}", loss.stream, loss.what),
            n => write!(text, "\n  lost: {}: {n} {}", loss.stream, loss.what),
        };
    }
    output.result(manifest, text)?;
    Ok(if manifest.losses.is_empty() { Ending::Done } else { Ending::WithLosses })
}

/// `real 78830 events, aps 59 frames`.
fn counts(manifest: &Manifest) -> String {
    let streams = manifest.streams.iter();
    let words = streams.map(|stream| match stream.name == stream.kind.to_string() {
        true => format!("{} {}", stream.count, stream.name),
        false => format!("{} {} {}", stream.name, stream.count, stream.kind),
    });
    words.collect::<Vec<_>>().join(", ")
}
