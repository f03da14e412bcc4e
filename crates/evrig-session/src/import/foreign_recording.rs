//! A recording of another program, with its events, frames and inertial samples, becomes a session.
//!
//! It is written as AEDAT4 packet by packet, so that memory does not grow with the recording, and
//! then taken in as any AEDAT4 file. Contents are compressed and written while the next are read.

mod choice;

use super::aedat4::{Aedat4Source, adopt};
use super::builder::SessionBuilder;
use super::event_table::EventTableOptions;
use super::imported_events::{CameraFormat, refuse_table_options};
use crate::manifest::file_name;
use crate::{DataLoss, Manifest, Origin, SessionError};
use choice::{ChosenStream, StreamSurvey};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Compression, Content, EVENT_BYTES, StreamSpec, WriteError, Writer};
use evrig_format::{CameraFileError, RecordingNotes, RecordingSink, SourceStream};
use std::path::Path;
use std::sync::mpsc::{SyncSender, sync_channel};

/// Events of a stream that are written at once: messages of a robot hold few, and a packet each would
/// cost more than its events.
const MAX_PENDING_EVENTS: usize = 1 << 15;

/// Events and frames that are given to the writer at once: 16 of its packets, which it compresses in
/// parallel.
const MAX_BATCH_BYTES: usize = 1 << 23;

/// What to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportRecording<'a> {
    /// The file, or the folder of a ROS 2 recording.
    pub file: &'a Path,
    /// The sensor's size; by default what the file states, or the smallest grid of its events.
    pub size: Option<Size>,
    /// What the user states about the events.
    pub options: EventTableOptions,
}

/// Makes a session of a recording.
///
/// # Errors
/// When the file is not what it should be, `root` is taken, or writing fails.
pub fn import_recording(
    request: &ImportRecording<'_>,
    root: &Path,
) -> Result<Manifest, SessionError> {
    let ImportRecording { file, size, options } = request;
    refuse_table_options(file, options)?;
    let Some(format) = CameraFormat::of_file(file)? else {
        let what = "is no recording of a camera; see docs/how-to/import-recordings.md";
        return Err(SessionError::import(file, what));
    };
    let mut survey = StreamSurvey::default();
    let notes = format.read(file, *size, &mut |stream, content| {
        survey.take(stream, &content);
        Ok(())
    })?;
    let chosen = survey.choose(file, options.table.as_deref(), *size, &notes)?;
    let builder = SessionBuilder::take(root)?;
    let by_us = match (options.begin_us, chosen.first_us) {
        (Some(begin), Some(first)) => begin.saturating_sub(first),
        _ => 0,
    };
    let converted = builder.layout.root().join("converted.aedat4");
    convert(|sink| format.read(file, *size, sink), &converted, &chosen.streams, by_us)?;
    let RecordingNotes { left_out, damage, mut decisions } = notes;
    let loss = |what| DataLoss { stream: file_name(file), what, count: 0 };
    let losses = damage.map(loss).into_iter().collect();
    decisions.extend(chosen.decisions);
    decisions.extend(
        left_out.into_iter().map(|(what, n)| format!("left out: {n} {what}, which are not read")),
    );
    if by_us != 0 {
        decisions.push(format!("{by_us} us were added to all times (--events-begin)"));
    }
    let source = Aedat4Source {
        file,
        path: &converted,
        origin: Origin::Converted { file: file_name(file), format: format.name().to_owned() },
        epoch: options.epoch,
        decisions,
        losses,
    };
    adopt(builder, source, &mut |_| {})
}

/// Reads a recording and writes its chosen streams to an AEDAT4 file, each on a thread.
fn convert(
    read: impl FnOnce(&mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError>,
    path: &Path,
    streams: &[ChosenStream],
    by_us: i64,
) -> Result<(), SessionError> {
    let spec = |stream: &ChosenStream| StreamSpec {
        name: stream.source.name.clone(),
        kind: stream.source.kind.clone(),
        size: stream.size,
        source: format!("imported from {}", stream.source.name),
    };
    let specs: Vec<StreamSpec> = streams.iter().map(spec).collect();
    let mut writer = Writer::create(path, Compression::Lz4, &specs)?;
    let (batches, received) = sync_channel::<Vec<(u32, Content)>>(1);
    std::thread::scope(|scope| {
        let writing = scope.spawn(move || -> Result<(), WriteError> {
            received.into_iter().try_for_each(|batch| writer.write_contents(&batch))?;
            writer.finish().map(drop)
        });
        let pending = vec![Events::new(); streams.len()];
        let mut gatherer =
            ContentGatherer { streams, pending, by_us, batch: Vec::new(), n_bytes: 0, batches };
        let notes = read(&mut |source, content| gatherer.take(source, content));
        let read = notes.and_then(|_| gatherer.finish());
        // An error of the writer is the reason why the reader could not go on.
        writing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok(read?)
    })
}

/// Gathers the contents of the chosen streams to batches for the writer.
struct ContentGatherer<'a> {
    streams: &'a [ChosenStream],
    pending: Vec<Events>,
    by_us: i64,
    batch: Vec<(u32, Content)>,
    /// Bytes of the batch before compression.
    n_bytes: usize,
    batches: SyncSender<Vec<(u32, Content)>>,
}

impl ContentGatherer<'_> {
    fn take(&mut self, source: &SourceStream, content: Content) -> Result<(), CameraFileError> {
        let is_same = |stream: &ChosenStream| {
            stream.source.name == source.name && stream.source.kind == source.kind
        };
        let Some(place) = self.streams.iter().position(is_same) else { return Ok(()) };
        match content {
            Content::Events(events) => {
                let (by, pending) = (self.by_us, &mut self.pending[place]);
                let moved = |event: Event| Event { t: event.t.saturating_add(by), ..event };
                match by {
                    0 => pending.extend_from_slice(events.as_slice()),
                    _ => events.as_slice().iter().for_each(|event| pending.push(moved(event))),
                }
                match pending.len() {
                    MAX_PENDING_EVENTS.. => self.take_pending(place),
                    _ => return Ok(()),
                }
            }
            other => {
                self.n_bytes += match &other {
                    Content::Frame(frame) => frame.samples.len(),
                    Content::Imu(samples) => size_of_val(samples.as_slice()),
                    _ => size_of::<Content>(),
                };
                self.batch.push((place as u32, moved_by(other, self.by_us)));
            }
        }
        if self.n_bytes < MAX_BATCH_BYTES { Ok(()) } else { self.send() }
    }

    fn take_pending(&mut self, place: usize) {
        let events = std::mem::take(&mut self.pending[place]);
        self.n_bytes += EVENT_BYTES * events.len();
        self.batch.push((place as u32, Content::Events(events)));
    }

    fn send(&mut self) -> Result<(), CameraFileError> {
        self.n_bytes = 0;
        let ended = |_| CameraFileError::Sink("the writer ended".into());
        self.batches.send(std::mem::take(&mut self.batch)).map_err(ended)
    }

    /// Gives what is left; the writer ends.
    fn finish(mut self) -> Result<(), CameraFileError> {
        let has_pending = |place: &usize| !self.pending[*place].is_empty();
        let places: Vec<usize> = (0..self.streams.len()).filter(has_pending).collect();
        places.into_iter().for_each(|place| self.take_pending(place));
        self.send()
    }
}

fn moved_by(content: Content, by_us: i64) -> Content {
    let by = evrig_core::time::Span::from_micros(by_us);
    match content {
        Content::Frame(mut frame) => {
            frame.timing.stamp = frame.timing.stamp + by;
            frame.timing.exposure = frame.timing.exposure.map(|at| at.map(|stamp| stamp + by));
            Content::Frame(frame)
        }
        Content::Imu(mut samples) => {
            samples.iter_mut().for_each(|sample| sample.stamp = sample.stamp + by);
            Content::Imu(samples)
        }
        other => other,
    }
}

#[cfg(test)]
mod tests;
