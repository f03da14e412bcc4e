//! Reading the rig's log, message by message.

use super::source::{ReadStep, RecordSource};
use super::{RigLogError, Topic};
use evrig_core::time::{Stamp, Unix};
use mcap::records::Record;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// One message as the file holds it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct LoggedMessage {
    pub topic: Topic,
    /// Host time at which it was written.
    pub logged: Stamp<Unix>,
    /// Its sender's wall clock.
    pub published: Stamp<Unix>,
    pub data: Vec<u8>,
}

/// The messages of some topics, in the order of the file, up to its end or the first damage.
pub(super) struct RigLogReader {
    path: PathBuf,
    source: RecordSource<File>,
    wanted: Vec<Topic>,
    channels: BTreeMap<u16, Topic>,
    n_seen: u64,
    has_ended: bool,
}

impl RigLogReader {
    /// Opens the log to read the messages of `wanted` topics.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub(super) fn open(path: &Path, wanted: &[Topic]) -> Result<Self, RigLogError> {
        let failed = |source| RigLogError::Open { path: path.to_owned(), source };
        Ok(Self {
            path: path.to_owned(),
            source: RecordSource::new(File::open(path).map_err(failed)?),
            wanted: wanted.to_vec(),
            channels: BTreeMap::new(),
            n_seen: 0,
            has_ended: false,
        })
    }

    /// The error for a message that is not of its topic's schema.
    pub(super) fn malformed(&self, topic: Topic, because: impl Into<String>) -> RigLogError {
        RigLogError::Malformed {
            path: self.path.clone(),
            topic: topic.name(),
            message: self.n_seen,
            because: because.into(),
        }
    }

    /// The next message; none at the end.
    fn next_message(&mut self) -> Result<Option<LoggedMessage>, RigLogError> {
        let failed = |source| RigLogError::Open { path: self.path.clone(), source };
        loop {
            match self.source.step().map_err(failed)? {
                ReadStep::Record(Record::Channel(channel)) => {
                    let topic = self.wanted.iter().find(|topic| topic.name() == channel.topic);
                    self.channels.extend(topic.map(|topic| (channel.id, *topic)));
                }
                ReadStep::Record(Record::Message { header, data }) => {
                    let stamp = |ns: u64| Stamp::from_nanos(i64::try_from(ns).unwrap_or(i64::MAX));
                    if let Some(&topic) = self.channels.get(&header.channel_id) {
                        return Ok(Some(LoggedMessage {
                            topic,
                            logged: stamp(header.log_time),
                            published: stamp(header.publish_time),
                            data: data.into_owned(),
                        }));
                    }
                }
                ReadStep::Record(_) | ReadStep::Nothing => {}
                // The damage of a cut file is in the manifest since it was sealed; here it ends the
                // messages.
                ReadStep::Damage(_) | ReadStep::End => return Ok(None),
            }
        }
    }
}

impl Iterator for RigLogReader {
    type Item = Result<LoggedMessage, RigLogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_ended {
            return None;
        }
        let next = self.next_message().transpose();
        match &next {
            Some(Ok(_)) => self.n_seen += 1,
            Some(Err(_)) | None => self.has_ended = true,
        }
        next
    }
}
