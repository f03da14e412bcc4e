//! Recordings of other programs, given to a sink packet by packet, so that memory does not grow with
//! the file.

use crate::aedat4::{Content, PayloadKind};
use crate::{CameraEvents, CameraFileError};
use evrig_core::event::Events;
use evrig_core::geometry::Size;
use std::collections::BTreeMap;
use std::path::Path;

/// A stream of a recording, as the recording names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceStream {
    /// Its topic, or the kind where the format has one stream of each.
    pub name: String,
    /// Kind of its contents.
    pub kind: PayloadKind,
    /// The pixel grid, where the recording states it.
    pub size: Option<Size>,
}

/// Takes the contents of a recording in the order of the file.
pub type RecordingSink<'a> = dyn FnMut(&SourceStream, Content) -> Result<(), CameraFileError> + 'a;

/// What a recording holds besides the contents that were given to the sink.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingNotes {
    /// What was left out, with its number.
    pub left_out: Vec<(String, u64)>,
    /// Where reading had to stop.
    pub damage: Option<String>,
    /// What had to be decided about the file.
    pub decisions: Vec<String>,
}

impl SourceStream {
    pub(crate) fn new(name: &str, kind: PayloadKind, size: Option<Size>) -> Self {
        Self { name: name.to_owned(), kind, size }
    }

    /// The events of a format that has one stream of them.
    pub(crate) fn only_events(size: Option<Size>) -> Self {
        Self::new("events", PayloadKind::Events, size)
    }
}

impl RecordingNotes {
    /// Counts something that is left out.
    pub(crate) fn leave_out(&mut self, what: &str, count: u64) {
        match self.left_out.iter_mut().find(|(known, _)| known == what) {
            Some((_, n)) => *n += count,
            None if count > 0 => self.left_out.push((what.to_owned(), count)),
            None => {}
        }
    }

    /// Notes a decision once.
    pub(crate) fn decide(&mut self, decision: String) {
        if !self.decisions.contains(&decision) {
            self.decisions.push(decision);
        }
    }
}

impl CameraEvents {
    /// The events of one stream of a recording that `read` reads. `topic` is needed where several
    /// streams hold events.
    ///
    /// # Errors
    /// When the recording cannot be read, holds no events, or several streams do and none is chosen.
    pub fn gather(
        path: &Path,
        topic: Option<&str>,
        read: impl FnOnce(&mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError>,
    ) -> Result<Self, CameraFileError> {
        let mut found: BTreeMap<String, (Events, Option<Size>)> = BTreeMap::new();
        let mut others: BTreeMap<String, u64> = BTreeMap::new();
        let notes = read(&mut |stream, content| {
            let count = match content {
                Content::Events(events) => {
                    let (all, size) = found.entry(stream.name.clone()).or_default();
                    *size = size.or(stream.size);
                    if topic.is_none_or(|topic| topic == stream.name) {
                        all.extend_from_slice(events.as_slice());
                    }
                    return Ok(());
                }
                Content::Imu(samples) => samples.len() as u64,
                _ => 1,
            };
            *others.entry(format!("{} of {}", describe(&stream.kind), stream.name)).or_default() +=
                count;
            Ok(())
        })?;
        let RecordingNotes { mut left_out, damage, mut decisions } = notes;
        let chosen = choose(path, topic, &found, &left_out, damage.as_deref())?;
        if found.len() > 1 || chosen != "events" {
            decisions.push(format!("the events are those of {chosen}"));
        }
        let (events, size) = found.remove(&chosen).unwrap_or_default();
        left_out.extend(others);
        Ok(Self { events, size, left_out, damage, decisions })
    }
}

/// The kind in words.
fn describe(kind: &PayloadKind) -> &str {
    match kind {
        PayloadKind::Events => "events",
        PayloadKind::Frames => "frames",
        PayloadKind::Imu => "inertial samples",
        PayloadKind::Triggers => "trigger edges",
        PayloadKind::Other(name) => name,
    }
}

fn choose(
    path: &Path,
    topic: Option<&str>,
    found: &BTreeMap<String, (Events, Option<Size>)>,
    left_out: &[(String, u64)],
    damage: Option<&str>,
) -> Result<String, CameraFileError> {
    let names: Vec<&str> = found.keys().map(String::as_str).collect();
    match (topic, names.as_slice()) {
        (Some(topic), names) if names.contains(&topic) => Ok(topic.to_owned()),
        (None, [only]) => Ok((*only).to_owned()),
        (_, []) => {
            let mut what = String::from("holds no events");
            let others: Vec<&str> = left_out.iter().map(|(what, _)| what.as_str()).collect();
            if !others.is_empty() {
                what.push_str(&format!("; it holds {}", others.join(", ")));
            }
            what.extend(damage.map(|damage| format!("; {damage}")));
            Err(CameraFileError::format(path, what))
        }
        _ => {
            let what = format!("has events on {}; choose one with --topic", names.join(", "));
            Err(CameraFileError::format(path, what))
        }
    }
}
