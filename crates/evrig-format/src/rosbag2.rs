//! ROS 2 recordings in MCAP, of messages in CDR.
//!
//! Records are read in the order of the file, so that a file that was cut, and has no index, is read
//! up to the cut.

mod write;

pub use write::write_packets;

use crate::CameraFileError;
use crate::recording::{RecordingNotes, RecordingSink};
use crate::ros::{RosDecoder, RosWire};
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longer records are damage; an image of 100 megapixels in colour has 300 MB.
const MAX_RECORD_BYTES: usize = 1 << 30;

/// Whether the first bytes of a file are those of MCAP.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(mcap::MAGIC)
}

/// A channel's topic and type.
struct McapTopic {
    topic: String,
    kind: String,
    is_cdr: bool,
}

/// What was read so far.
#[derive(Default)]
struct McapState {
    schemas: BTreeMap<u16, String>,
    topics: BTreeMap<u16, McapTopic>,
    decoder: RosDecoder,
    damage: Option<String>,
}

/// Reads a file, or the files of a folder in the order of their numbers, each up to a cut.
///
/// # Errors
/// When a file cannot be read, or the sink refuses.
pub fn read(path: &Path, sink: &mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError> {
    let mut state = McapState::default();
    for file in files(path)? {
        state.schemas.clear();
        state.topics.clear();
        state.read(&file, sink)?;
    }
    let mut notes = state.decoder.notes;
    notes.damage = state.damage;
    Ok(notes)
}

/// The files of a recording: `NAME_0.mcap`, `NAME_1.mcap`, ... of a folder.
fn files(path: &Path) -> Result<Vec<PathBuf>, CameraFileError> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).map_err(CameraFileError::io(path))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "mcap"));
    // A number with more digits is greater.
    files.sort_by_key(|file| (file.as_os_str().len(), file.clone()));
    Ok(files)
}

impl McapState {
    fn read(&mut self, path: &Path, sink: &mut RecordingSink<'_>) -> Result<(), CameraFileError> {
        let io = CameraFileError::io;
        let mut file = File::open(path).map_err(io(path))?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        let mut reader = LinearReader::new_with_options(options);
        let mut offset = 0_u64;
        let mut is_ended = false;
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(n)) => {
                    let n_read = file.read(reader.insert(n)).map_err(io(path))?;
                    reader.notify_read(n_read);
                    offset += n_read as u64;
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    match mcap::parse_record(opcode, data) {
                        Ok(Record::Footer(_)) => is_ended = true,
                        Ok(record) => self.take(record, sink)?,
                        Err(error) => self.damaged(path, format!("a record: {error}")),
                    }
                }
                Err(error) => {
                    let what = format!("cut or damaged before byte {offset}: {error}");
                    self.damaged(path, what);
                    is_ended = true;
                    break;
                }
            }
        }
        if !is_ended {
            let what = format!("the file ends at byte {offset} without MCAP's footer: it was cut");
            self.damaged(path, what);
        }
        Ok(())
    }

    /// Keeps the first damage.
    fn damaged(&mut self, path: &Path, what: String) {
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        self.damage.get_or_insert_with(|| format!("{name}: {what}"));
    }

    fn take(
        &mut self,
        record: Record<'_>,
        sink: &mut RecordingSink<'_>,
    ) -> Result<(), CameraFileError> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let kind = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let is_cdr = channel.message_encoding == "cdr";
                let topic = McapTopic { topic: channel.topic, kind, is_cdr };
                self.topics.insert(channel.id, topic);
            }
            Record::Message { header, data } => {
                let Some(McapTopic { topic, kind, is_cdr }) = self.topics.get(&header.channel_id)
                else {
                    self.damage.get_or_insert("a message is of an unknown channel".into());
                    return Ok(());
                };
                if !is_cdr {
                    let what = format!("messages of {topic} ({kind}), which are not in CDR");
                    self.decoder.notes.leave_out(&what, 1);
                    return Ok(());
                }
                match self.decoder.take(topic, kind, RosWire::Cdr, &data) {
                    Ok(Some((stream, content))) => sink(&stream, content)?,
                    Ok(None) => {}
                    Err(what) => {
                        self.damage.get_or_insert(format!("{what}; reading went on"));
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }
}
