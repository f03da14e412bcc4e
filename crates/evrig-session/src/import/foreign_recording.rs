//! A recording of another program, with its events, frames and inertial samples, becomes a session.
//!
//! It is written as AEDAT4 packet by packet, so that memory does not grow with the recording, and
//! then taken in as any AEDAT4 file.

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
use evrig_format::aedat4::{Compression, Content, StreamSpec, WriteError, Writer};
use evrig_format::{CameraFileError, RecordingNotes};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Events of a stream that are written at once: messages of a robot hold few, and a packet each would
/// cost more than its events.
const MAX_PENDING_EVENTS: usize = 1 << 15;

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
    let write = ConversionWriter::create(&converted, &chosen.streams, by_us)?;
    write.run(format, file, *size)?;
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

/// The file under construction.
struct ConversionWriter<'a> {
    writer: Writer<BufWriter<File>>,
    streams: &'a [ChosenStream],
    pending: Vec<Events>,
    by_us: i64,
}

impl<'a> ConversionWriter<'a> {
    fn create(path: &Path, streams: &'a [ChosenStream], by_us: i64) -> Result<Self, SessionError> {
        let spec = |stream: &ChosenStream| StreamSpec {
            name: stream.source.name.clone(),
            kind: stream.source.kind.clone(),
            size: stream.size,
            source: format!("imported from {}", stream.source.name),
        };
        let specs: Vec<StreamSpec> = streams.iter().map(spec).collect();
        let writer = Writer::create(path, Compression::Lz4, &specs)?;
        Ok(Self { writer, streams, pending: vec![Events::new(); streams.len()], by_us })
    }

    fn run(
        mut self,
        format: CameraFormat,
        file: &Path,
        size: Option<Size>,
    ) -> Result<(), SessionError> {
        let mut failure = None;
        let read = format.read(file, size, &mut |source, content| {
            let place = self.streams.iter().position(|stream| {
                stream.source.name == source.name && stream.source.kind == source.kind
            });
            let Some(place) = place else { return Ok(()) };
            self.take(place, content).map_err(|error| {
                let refusal = CameraFileError::Sink(error.to_string());
                failure = Some(error);
                refusal
            })
        });
        if let Some(error) = failure {
            return Err(error.into());
        }
        read?;
        for place in 0..self.streams.len() {
            self.flush(place)?;
        }
        self.writer.finish()?;
        Ok(())
    }

    fn take(&mut self, place: usize, content: Content) -> Result<(), WriteError> {
        match content {
            Content::Events(events) => {
                let (by, pending) = (self.by_us, &mut self.pending[place]);
                let moved = |event: Event| Event { t: event.t.saturating_add(by), ..event };
                match by {
                    0 => pending.extend_from_slice(events.as_slice()),
                    _ => events.as_slice().iter().for_each(|event| pending.push(moved(event))),
                }
                match self.pending[place].len() {
                    MAX_PENDING_EVENTS.. => self.flush(place),
                    _ => Ok(()),
                }
            }
            other => moved_by(other, self.by_us).write(&mut self.writer, place as u32),
        }
    }

    fn flush(&mut self, place: usize) -> Result<(), WriteError> {
        let events = std::mem::take(&mut self.pending[place]);
        match events.len() {
            0 => Ok(()),
            _ => self.writer.write_events(place as u32, events.as_slice()),
        }
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
