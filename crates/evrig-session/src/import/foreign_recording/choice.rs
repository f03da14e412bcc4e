//! Which streams of a recording are imported, and on which grid.

use crate::SessionError;
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Content, PayloadKind};
use evrig_format::{RecordingNotes, SourceStream};
use std::path::Path;

/// What one stream of a recording holds.
#[derive(Debug)]
struct SurveyedStream {
    source: SourceStream,
    n: u64,
    /// Events off the stated grid.
    n_outside: u64,
    first_us: Option<i64>,
    /// The outermost column and row of its events.
    outermost: [u16; 2],
}

/// What the streams of a recording hold.
#[derive(Debug, Default)]
pub(super) struct StreamSurvey {
    streams: Vec<SurveyedStream>,
}

/// A stream that is imported.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChosenStream {
    pub(super) source: SourceStream,
    pub(super) size: Option<Size>,
}

/// The streams that are imported.
#[derive(Debug)]
pub(super) struct ChosenStreams {
    pub(super) streams: Vec<ChosenStream>,
    pub(super) decisions: Vec<String>,
    /// The first event, or without events the first stamp.
    pub(super) first_us: Option<i64>,
}

impl StreamSurvey {
    pub(super) fn take(&mut self, source: &SourceStream, content: &Content) {
        let known = self.streams.iter().position(|stream| {
            stream.source.name == source.name && stream.source.kind == source.kind
        });
        let place = known.unwrap_or_else(|| {
            let source = source.clone();
            self.streams.push(SurveyedStream {
                source,
                n: 0,
                n_outside: 0,
                first_us: None,
                outermost: [0; 2],
            });
            self.streams.len() - 1
        });
        let stream = &mut self.streams[place];
        stream.source.size = stream.source.size.or(source.size);
        let (n, first_us) = match content {
            Content::Events(events) => {
                let events = events.as_slice();
                let outermost = |values: &[u16]| values.iter().copied().max().unwrap_or(0);
                let [x, y] = [outermost(events.x), outermost(events.y)];
                stream.outermost = [stream.outermost[0].max(x), stream.outermost[1].max(y)];
                if let Some(size) = source.size.filter(|size| !size.contains(x, y)) {
                    let outside = events.iter().filter(|event| !size.contains(event.x, event.y));
                    stream.n_outside += outside.count() as u64;
                }
                (events.len(), events.t.first().copied())
            }
            Content::Frame(frame) => (1, Some(frame.timing.stamp.as_micros())),
            Content::Imu(samples) => {
                (samples.len(), samples.first().map(|sample| sample.stamp.as_micros()))
            }
            Content::Triggers(edges) => {
                (edges.len(), edges.first().map(|edge| edge.stamp.as_micros()))
            }
            Content::Unknown { .. } => (0, None),
        };
        stream.n += n as u64;
        stream.first_us = stream.first_us.or(first_us);
    }

    /// All streams in the order of their kinds and names, or those of the camera of `topic`: its
    /// events, and the frames and samples whose names begin as its name does up to the last `/`.
    pub(super) fn choose(
        mut self,
        file: &Path,
        topic: Option<&str>,
        size: Option<Size>,
        notes: &RecordingNotes,
    ) -> Result<ChosenStreams, SessionError> {
        self.streams.retain(|stream| stream.n > 0);
        if self.streams.is_empty() {
            return Err(SessionError::import(file, nothing(notes)));
        }
        let mut decisions = Vec::new();
        if let Some(topic) = topic {
            self.of_topic(file, topic, &mut decisions)?;
        }
        let rank = |kind: &PayloadKind| match kind {
            PayloadKind::Events => 0,
            PayloadKind::Frames => 1,
            _ => 2,
        };
        self.streams.sort_by_cached_key(|s| (rank(&s.source.kind), s.source.name.clone()));
        let first_us = self.streams.first().and_then(|stream| stream.first_us);
        let mut streams = Vec::new();
        for stream in self.streams {
            let size = match stream.source.kind {
                PayloadKind::Events => Some(grid(file, &stream, size, &mut decisions)?),
                _ => stream.source.size,
            };
            streams.push(ChosenStream { source: stream.source, size });
        }
        Ok(ChosenStreams { streams, decisions, first_us })
    }

    fn of_topic(
        &mut self,
        file: &Path,
        topic: &str,
        decisions: &mut Vec<String>,
    ) -> Result<(), SessionError> {
        let names: Vec<String> = self.streams.iter().map(|s| s.source.name.clone()).collect();
        if !names.iter().any(|name| name == topic) {
            let what = format!("has no stream `{topic}`; it has: {}", names.join(", "));
            return Err(SessionError::import(file, what));
        }
        // Names without a folder are those of a format of one camera.
        let camera = topic.rfind('/').map_or("", |end| &topic[..=end]);
        let is_of_camera = |stream: &SurveyedStream| {
            let is_other = stream.source.kind == PayloadKind::Events && stream.source.name != topic;
            !is_other && stream.source.name.starts_with(camera)
        };
        let others: Vec<String> = self
            .streams
            .iter()
            .filter(|stream| !is_of_camera(stream))
            .map(|stream| stream.source.name.clone())
            .collect();
        self.streams.retain(is_of_camera);
        if !others.is_empty() {
            decisions.push(format!("left out, as not of {topic}: {}", others.join(", ")));
        }
        Ok(())
    }
}

fn nothing(notes: &RecordingNotes) -> String {
    let mut what = String::from("holds no events, frames or inertial samples that are read");
    let others: Vec<&str> = notes.left_out.iter().map(|(what, _)| what.as_str()).collect();
    if !others.is_empty() {
        what.push_str(&format!("; it holds {}", others.join(", ")));
    }
    what.extend(notes.damage.as_ref().map(|damage| format!("; {damage}")));
    what
}

/// The grid that the user or the file states, or the smallest that holds the events.
fn grid(
    file: &Path,
    stream: &SurveyedStream,
    size: Option<Size>,
    decisions: &mut Vec<String>,
) -> Result<Size, SessionError> {
    let stated = size.or(stream.source.size);
    if let Some(size) = stated {
        if 2 * stream.n_outside > stream.n {
            let (n, of) = (stream.n_outside, stream.n);
            let what = format!("{n} of {of} events are off the {size} grid; see --size");
            return Err(SessionError::import(file, what));
        }
        return Ok(size);
    }
    let [x, y] = stream.outermost;
    let size = Size::new(x.saturating_add(1), y.saturating_add(1));
    decisions.push(format!("the sensor has {size} pixels, by its outermost events; see --size"));
    Ok(size)
}
