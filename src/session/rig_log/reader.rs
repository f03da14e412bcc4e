//! Reading the rig's log, message by message.

use super::{RigLogError, Topic};
use crate::time::{Stamp, Unix};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Records longer than this are damage: a chunk ends soon after 8 MiB, a frame has some megabytes.
pub(super) const MAX_RECORD_BYTES: usize = 1 << 28;

/// One message as the file holds it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::session) struct LoggedMessage {
    pub(in crate::session) topic: Topic,
    /// Host time at which it was written.
    pub(in crate::session) logged: Stamp<Unix>,
    /// Its sender's wall clock.
    pub(in crate::session) published: Stamp<Unix>,
    pub(in crate::session) data: Vec<u8>,
}

/// The messages of some topics, in the order of the file, up to its end or the first damage.
pub(in crate::session) struct RigLogReader {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    wanted: Vec<Topic>,
    channels: BTreeMap<u16, Topic>,
    n_seen: u64,
    has_ended: bool,
}

/// What the file gave in one step.
enum Step {
    More(usize),
    Message(LoggedMessage),
    Nothing,
    Damage,
}

impl RigLogReader {
    /// Opens the log to read the messages of `wanted` topics.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub(in crate::session) fn open(path: &Path, wanted: &[Topic]) -> Result<Self, RigLogError> {
        let failed = |source| RigLogError::Open { path: path.to_owned(), source };
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        Ok(Self {
            path: path.to_owned(),
            file: File::open(path).map_err(failed)?,
            reader: LinearReader::new_with_options(options),
            wanted: wanted.to_vec(),
            channels: BTreeMap::new(),
            n_seen: 0,
            has_ended: false,
        })
    }

    /// The error that names a message which is not what its topic says.
    pub(in crate::session) fn malformed(
        &self,
        topic: Topic,
        because: impl Into<String>,
    ) -> RigLogError {
        RigLogError::Malformed {
            path: self.path.clone(),
            topic: topic.name(),
            message: self.n_seen,
            because: because.into(),
        }
    }

    fn step(&mut self) -> Option<Step> {
        let record = match self.reader.next_event()? {
            Ok(LinearReadEvent::ReadRequest(n)) => return Some(Step::More(n)),
            Ok(LinearReadEvent::Record { data, opcode }) => mcap::parse_record(opcode, data),
            Err(error) => Err(error),
        };
        Some(match record {
            Ok(Record::Channel(channel)) => {
                let topic = self.wanted.iter().find(|topic| topic.name() == channel.topic);
                if let Some(topic) = topic {
                    self.channels.insert(channel.id, *topic);
                }
                Step::Nothing
            }
            Ok(Record::Message { header, data }) => {
                let stamp = |ns: u64| Stamp::from_nanos(i64::try_from(ns).unwrap_or(i64::MAX));
                match self.channels.get(&header.channel_id) {
                    Some(&topic) => Step::Message(LoggedMessage {
                        topic,
                        logged: stamp(header.log_time),
                        published: stamp(header.publish_time),
                        data: data.into_owned(),
                    }),
                    None => Step::Nothing,
                }
            }
            Ok(_) => Step::Nothing,
            // The damage of a cut file is in the manifest since it was sealed; here it ends the messages.
            Err(_) => Step::Damage,
        })
    }
}

impl Iterator for RigLogReader {
    type Item = Result<LoggedMessage, RigLogError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.has_ended {
            match self.step() {
                Some(Step::More(n)) => match self.file.read(self.reader.insert(n)) {
                    Ok(n) => self.reader.notify_read(n),
                    Err(source) => {
                        self.has_ended = true;
                        return Some(Err(RigLogError::Open { path: self.path.clone(), source }));
                    }
                },
                Some(Step::Message(message)) => {
                    self.n_seen += 1;
                    return Some(Ok(message));
                }
                Some(Step::Nothing) => {}
                Some(Step::Damage) | None => self.has_ended = true,
            }
        }
        None
    }
}
