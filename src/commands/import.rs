//! `evrig import`: recordings of other software become sessions.

use super::{Ending, Output, WrongUse};
use crate::cli::{ImportAedat4Args, ImportCommand, ImportFramesArgs, ImportRaw2EventArgs};
use evrig_session::import::{
    FrameTimes, ImportFrames, ImportRaw2Event, import_aedat4, import_frames, import_raw2event,
};
use evrig_session::{Manifest, StreamName};
use std::fmt::Write;
use std::path::Path;

pub(super) fn run(command: &ImportCommand, output: &Output) -> anyhow::Result<Ending> {
    match command {
        ImportCommand::Aedat4(args) => aedat4(args, output),
        ImportCommand::Frames(args) => frames(args, output),
        ImportCommand::Raw2Event(args) => raw2event(args, output),
    }
}

fn aedat4(args: &ImportAedat4Args, output: &Output) -> anyhow::Result<Ending> {
    let n_bytes = std::fs::metadata(&args.file).map(|meta| meta.len()).unwrap_or(0);
    let bar = output.progress("import", 2 * n_bytes);
    let manifest = import_aedat4(&args.file, &args.out, &mut |done| bar.set_position(done))?;
    bar.finish_and_clear();
    finish(&manifest, &args.out, output)
}

fn frames(args: &ImportFramesArgs, output: &Output) -> anyhow::Result<Ending> {
    let times = match (&args.timestamps, args.fps) {
        (Some(path), _) => FrameTimes::File(path.clone()),
        (None, Some(fps)) => FrameTimes::Fps(fps),
        (None, None) => return Err(WrongUse("give --fps or --timestamps".into()).into()),
    };
    let events_name =
        StreamName::new(&args.events_name).map_err(|error| WrongUse(error.to_string()))?;
    let request =
        ImportFrames { frames: &args.frames, times, events: args.events.as_deref(), events_name };
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
    manifest.decisions.iter().for_each(|decision| output.say(format_args!("decided: {decision}")));
    finish(&manifest, &args.out, output)
}

fn finish(manifest: &Manifest, out: &Path, output: &Output) -> anyhow::Result<Ending> {
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
