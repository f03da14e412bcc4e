//! ROS 2 recordings in MCAP, of messages in CDR.
//!
//! Records are framed here, in the order of the file, and parsed by the crate `mcap`: a file that was
//! cut, and has no index, is read up to the cut, and a damaged chunk is passed over. The crate's own
//! reader ends at the first damage and trusts the lengths inside chunks.

mod write;

pub use write::write_packets;

use crate::recording::{RecordingNotes, RecordingSink};
use crate::ros::{RosDecoder, RosWire};
use crate::{BLOCK_BYTES, CameraFileError};
use mcap::records::{Record, op};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Longer records are damage; an image of 100 megapixels in colour has 300 MB.
const MAX_RECORD_BYTES: u64 = 1 << 30;

/// Opcode and length in front of a record.
const HEAD_BYTES: usize = 9;

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
    /// Memory of the last chunk, to be used again.
    plain: Vec<u8>,
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
        let mut file = BufReader::with_capacity(BLOCK_BYTES, File::open(path).map_err(io(path))?);
        let mut offset = mcap::MAGIC.len() as u64;
        let mut body = Vec::new();
        file.by_ref().take(offset).read_to_end(&mut body).map_err(io(path))?;
        if body != mcap::MAGIC {
            return Err(CameraFileError::format(path, "does not begin as an MCAP file"));
        }
        loop {
            body.clear();
            file.by_ref().take(HEAD_BYTES as u64).read_to_end(&mut body).map_err(io(path))?;
            let Some((opcode, length)) = record_head(&body).filter(|h| h.1 <= MAX_RECORD_BYTES)
            else {
                let what = format!("the file is cut or damaged at byte {offset}");
                self.damaged(path, what);
                return Ok(());
            };
            body.clear();
            let n = file.by_ref().take(length).read_to_end(&mut body).map_err(io(path))?;
            let is_whole = n as u64 == length;
            if !is_whole {
                self.damaged(path, format!("the file is cut in the record at byte {offset}"));
            }
            match opcode {
                op::FOOTER if is_whole => return Ok(()),
                op::CHUNK => {
                    if let Err(what) = self.take_chunk(path, &body, sink)? {
                        self.damaged(path, format!("the chunk at byte {offset} {what}"));
                    }
                }
                _ if is_whole => self.take_record(path, opcode, &body, sink)?,
                _ => {}
            }
            if !is_whole {
                return Ok(());
            }
            offset += HEAD_BYTES as u64 + length;
        }
    }

    /// Takes the records of a chunk, those of a damaged one up to the damage.
    fn take_chunk(
        &mut self,
        path: &Path,
        chunk: &[u8],
        sink: &mut RecordingSink<'_>,
    ) -> Result<Result<(), String>, CameraFileError> {
        let Some(parts) = ChunkParts::of(chunk) else {
            return Ok(Err("has no whole header".into()));
        };
        let mut plain = std::mem::take(&mut self.plain);
        plain.clear();
        let mut fault = match parts.decompress(&mut plain) {
            Ok(fault) => fault.map_or(Ok(()), Err),
            Err(what) => return Ok(Err(what)),
        };
        let mut rest = plain.as_slice();
        while let Some((opcode, length)) = record_head(rest) {
            let end = usize::try_from(length).ok().and_then(|n| n.checked_add(HEAD_BYTES));
            let Some(record) = end.and_then(|end| rest.get(HEAD_BYTES..end)) else {
                fault = fault.and(Err("holds a record that is not whole".to_owned()));
                break;
            };
            self.take_record(path, opcode, record, sink)?;
            rest = &rest[HEAD_BYTES + record.len()..];
        }
        self.plain = plain;
        Ok(fault)
    }

    fn take_record(
        &mut self,
        path: &Path,
        opcode: u8,
        body: &[u8],
        sink: &mut RecordingSink<'_>,
    ) -> Result<(), CameraFileError> {
        match mcap::parse_record(opcode, body) {
            Ok(record) => self.take(record, sink),
            Err(error) => {
                self.damaged(path, format!("a record: {error}"));
                Ok(())
            }
        }
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

/// Opcode and length of the record at the beginning of `bytes`.
fn record_head(bytes: &[u8]) -> Option<(u8, u64)> {
    let length = bytes.get(1..HEAD_BYTES)?.try_into().ok()?;
    Some((bytes[0], u64::from_le_bytes(length)))
}

/// A chunk's header and its records as they are stored.
struct ChunkParts<'a> {
    n_plain: u64,
    crc: u32,
    compression: &'a [u8],
    stored: &'a [u8],
    /// Whether all of them are there.
    is_whole: bool,
}

impl<'a> ChunkParts<'a> {
    /// Two times, size, checksum, name of the compression, size as stored, records.
    fn of(chunk: &'a [u8]) -> Option<Self> {
        let long = |at: usize| Some(u64::from_le_bytes(chunk.get(at..at + 8)?.try_into().ok()?));
        let word = |at: usize| Some(u32::from_le_bytes(chunk.get(at..at + 4)?.try_into().ok()?));
        let (n_plain, crc, n_name) = (long(16)?, word(24)?, word(28)? as usize);
        let at = 32_usize.checked_add(n_name)?;
        let (compression, n_stored) = (chunk.get(32..at)?, long(at)?);
        let stored = chunk.get(at + 8..)?;
        let is_whole = stored.len() as u64 >= n_stored;
        let stored = &stored[..stored.len().min(usize::try_from(n_stored).unwrap_or(usize::MAX))];
        Some(Self { n_plain, crc, compression, stored, is_whole })
    }

    /// Appends the plain records; gives why they are not all.
    fn decompress(&self, plain: &mut Vec<u8>) -> Result<Option<String>, String> {
        let limit = self.n_plain.min(MAX_RECORD_BYTES);
        let text = |error: std::io::Error| format!("cannot be decompressed: {error}");
        let read = match self.compression {
            b"" | b"none" => self.stored.take(limit).read_to_end(plain),
            b"lz4" => lz4::Decoder::new(self.stored).map_err(text)?.take(limit).read_to_end(plain),
            b"zstd" => {
                let decoder = zstd::Decoder::new(self.stored).map_err(text)?;
                decoder.take(limit).read_to_end(plain)
            }
            other => {
                let name = String::from_utf8_lossy(other);
                return Err(format!("is compressed with {name}, which is not read"));
            }
        };
        let fault = match read {
            _ if !self.is_whole => Some("is cut".to_owned()),
            Err(error) => Some(text(error)),
            Ok(_) if self.crc != 0 && crc32fast::hash(plain) != self.crc => {
                // What its messages would say is not known.
                return Err("has another checksum than was written; it is left out".into());
            }
            Ok(_) => None,
        };
        Ok(fault)
    }
}
