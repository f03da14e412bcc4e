//! ROS 1 bags with events, images and inertial samples.
//!
//! Layout: <http://wiki.ros.org/Bags/Format/2.0>. Records are read in file order, so that a bag
//! that was cut, and has no index, is read up to the cut; the crate `rosbag` needs the index.

use crate::recording::{RecordingNotes, RecordingSink};
use crate::ros::{RosDecoder, RosWire};
use crate::{BLOCK_BYTES, CameraFileError};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Operations of records.
const MESSAGE: u8 = 0x02;
const CHUNK: u8 = 0x05;
const CONNECTION: u8 = 0x07;

/// Records of more bytes are damage.
const MAX_RECORD_BYTES: u32 = 1 << 30;

/// Whether the first bytes of a file are those of a bag.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(b"#ROSBAG V2")
}

/// A connection's topic and message type.
#[derive(Debug, Clone)]
struct BagConnection {
    topic: String,
    kind: String,
}

/// A bag while it is read.
struct BagReader<'a, 'b> {
    connections: BTreeMap<u32, BagConnection>,
    decoder: RosDecoder,
    sink: &'a mut RecordingSink<'b>,
}

/// Why a record gives nothing.
enum RecordFault {
    /// It is damaged; the next may be whole.
    Damage(String),
    /// The sink refuses.
    Sink(CameraFileError),
}

impl From<String> for RecordFault {
    fn from(what: String) -> Self {
        Self::Damage(what)
    }
}

/// A record's header fields and its data.
struct BagRecord<'a> {
    op: u8,
    connection: Option<u32>,
    fields: BTreeMap<&'a [u8], &'a [u8]>,
    data: &'a [u8],
}

/// Reads a bag, up to a cut.
///
/// # Errors
/// When the file cannot be read or is no bag, or the sink refuses.
pub fn read(path: &Path, sink: &mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError> {
    let io = CameraFileError::io;
    let mut reader = BufReader::with_capacity(BLOCK_BYTES, File::open(path).map_err(io(path))?);
    let mut magic = [0; MAGIC.len()];
    reader.read_exact(&mut magic).map_err(io(path))?;
    if magic != MAGIC {
        return Err(CameraFileError::format(path, "is no ROS bag of version 2.0"));
    }
    let mut bag = BagReader { connections: BTreeMap::new(), decoder: RosDecoder::default(), sink };
    let mut damage = None;
    let mut offset = MAGIC.len();
    let mut record = Vec::new();
    loop {
        record.clear();
        let taken = match read_record(&mut reader, &mut record).map_err(io(path))? {
            RecordEnd::Whole => match parse(&record) {
                Some((parsed, _)) => bag.take(&parsed),
                None => Err(RecordFault::Damage("a record without an operation".into())),
            },
            RecordEnd::End => break,
            RecordEnd::Cut => {
                damage.get_or_insert(format!("the file is cut in the record at byte {offset}"));
                if let Err(RecordFault::Sink(error)) = bag.take_cut(&record) {
                    return Err(error);
                }
                break;
            }
        };
        offset += record.len();
        match taken {
            Ok(()) => {}
            Err(RecordFault::Sink(error)) => return Err(error),
            Err(RecordFault::Damage(what)) => {
                damage.get_or_insert(format!("up to byte {offset}: {what}; reading went on"));
            }
        }
    }
    let mut notes = bag.decoder.notes;
    notes.damage = damage;
    Ok(notes)
}

enum RecordEnd {
    Whole,
    End,
    Cut,
}

/// Reads both parts of a record with their lengths.
fn read_record(reader: &mut impl Read, record: &mut Vec<u8>) -> std::io::Result<RecordEnd> {
    for part in 0..2 {
        let start = record.len();
        reader.by_ref().take(4).read_to_end(record)?;
        if record.len() == start && part == 0 {
            return Ok(RecordEnd::End);
        }
        let Some(length) = word(record, start).filter(|n| *n <= MAX_RECORD_BYTES) else {
            return Ok(RecordEnd::Cut);
        };
        let n = reader.by_ref().take(length.into()).read_to_end(record)?;
        if n < length as usize {
            return Ok(RecordEnd::Cut);
        }
    }
    Ok(RecordEnd::Whole)
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// Fields of the form `name=value`, each behind its length.
fn fields(mut header: &[u8]) -> BTreeMap<&[u8], &[u8]> {
    let mut fields = BTreeMap::new();
    while let Some(n) = word(header, 0) {
        let Some(field) = header.get(4..4 + n as usize) else { break };
        if let Some(at) = field.iter().position(|byte| *byte == b'=') {
            fields.insert(&field[..at], &field[at + 1..]);
        }
        header = &header[4 + n as usize..];
    }
    fields
}

/// The record at the beginning of `bytes`, and what is behind it.
fn parse(bytes: &[u8]) -> Option<(BagRecord<'_>, &[u8])> {
    let n_header = word(bytes, 0)? as usize;
    let header = bytes.get(4..4 + n_header)?;
    let n_data = word(bytes, 4 + n_header)? as usize;
    let start = 8 + n_header;
    let data = bytes.get(start..start.checked_add(n_data)?)?;
    let fields = fields(header);
    let op = *fields.get(&b"op"[..])?.first()?;
    let connection = fields.get(&b"conn"[..]).and_then(|value| word(value, 0));
    Some((BagRecord { op, connection, fields, data }, &bytes[start + n_data..]))
}

impl BagReader<'_, '_> {
    fn take(&mut self, record: &BagRecord<'_>) -> Result<(), RecordFault> {
        match (record.op, record.connection) {
            (CHUNK, _) => self.take_chunk(record),
            (CONNECTION, Some(id)) => {
                let text = |value: Option<&&[u8]>| {
                    value.map(|v| String::from_utf8_lossy(v).into_owned()).unwrap_or_default()
                };
                let topic = text(record.fields.get(&b"topic"[..]));
                let kind = text(fields(record.data).get(&b"type"[..]));
                self.connections.insert(id, BagConnection { topic, kind });
                Ok(())
            }
            (MESSAGE, Some(id)) => self.take_message(id, record.data),
            _ => Ok(()),
        }
    }

    /// Takes the whole messages of a chunk without compression that the file's end cuts.
    fn take_cut(&mut self, record: &[u8]) -> Result<(), RecordFault> {
        let n_header = word(record, 0).unwrap_or(u32::MAX) as usize;
        let Some(header) = record.get(4..4_usize.saturating_add(n_header)) else { return Ok(()) };
        let fields = fields(header);
        let is_plain = fields.get(&b"compression"[..]).is_some_and(|name| *name == b"none");
        match record.get(8 + n_header..).filter(|_| is_plain) {
            // A last message without its end is no record, and ends the chunk.
            Some(data) => self.take_chunk(&BagRecord { op: CHUNK, connection: None, fields, data }),
            None => Ok(()),
        }
    }

    fn take_chunk(&mut self, record: &BagRecord<'_>) -> Result<(), RecordFault> {
        let compression = record.fields.get(&b"compression"[..]).copied().unwrap_or(b"none");
        let size = record.fields.get(&b"size"[..]).and_then(|size| word(size, 0)).unwrap_or(0);
        let plain;
        let mut rest = match compression {
            b"none" => record.data,
            b"lz4" => {
                let mut bytes = Vec::new();
                let decoder = lz4::Decoder::new(record.data).map_err(|error| error.to_string())?;
                let read = decoder.take(size.into()).read_to_end(&mut bytes);
                read.map_err(|error| format!("a chunk cannot be decompressed: {error}"))?;
                plain = bytes;
                plain.as_slice()
            }
            other => {
                let name = String::from_utf8_lossy(other);
                let what = format!("a chunk is compressed with {name}; run `rosbag decompress`");
                return Err(RecordFault::Damage(what));
            }
        };
        // A damaged message does not take the others of its chunk with it.
        let mut first_damage = Ok(());
        while let Some((record, behind)) = parse(rest) {
            let taken = if record.op == CHUNK { Ok(()) } else { self.take(&record) };
            match taken {
                Err(RecordFault::Damage(what)) if first_damage.is_ok() => {
                    first_damage = Err(RecordFault::Damage(what));
                }
                Err(RecordFault::Sink(error)) => return Err(RecordFault::Sink(error)),
                _ => {}
            }
            rest = behind;
        }
        first_damage
    }

    fn take_message(&mut self, id: u32, data: &[u8]) -> Result<(), RecordFault> {
        let Some(BagConnection { topic, kind }) = self.connections.get(&id) else {
            return Err(RecordFault::Damage("a message of an unknown connection".into()));
        };
        if let Some((stream, content)) = self.decoder.take(topic, kind, RosWire::Ros1, data)? {
            (self.sink)(&stream, content).map_err(RecordFault::Sink)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraEvents;
    use crate::ros::tests::{imu_message, rgb_image};
    use evrig_core::geometry::Size;

    fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
        let mut header = Vec::new();
        for (name, value) in fields {
            header.extend(((name.len() + 1 + value.len()) as u32).to_le_bytes());
            header.extend([name.as_bytes(), b"=", value].concat());
        }
        let mut bytes = (header.len() as u32).to_le_bytes().to_vec();
        bytes.extend(header);
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(data);
        bytes
    }

    fn connection(id: u32, topic: &str, kind: &str) -> Vec<u8> {
        let data = [&((kind.len() + 5) as u32).to_le_bytes()[..], b"type=", kind.as_bytes()];
        let fields: [(&str, &[u8]); 3] =
            [("op", &[CONNECTION]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())];
        record(&fields, &data.concat())
    }

    fn message(id: u32, events: &[(u32, u32, u16, u16, u8)]) -> Vec<u8> {
        let mut data = [0; 12].to_vec();
        data.extend(3_u32.to_le_bytes());
        data.extend(b"dvs");
        [180_u32, 240, events.len() as u32].iter().for_each(|n| data.extend(n.to_le_bytes()));
        for (s, ns, x, y, p) in events {
            data.extend([x.to_le_bytes(), y.to_le_bytes()].concat());
            data.extend([s.to_le_bytes(), ns.to_le_bytes()].concat());
            data.push(*p);
        }
        record(&[("op", &[MESSAGE]), ("conn", &id.to_le_bytes()), ("time", &[0; 8])], &data)
    }

    fn bag(records: &[Vec<u8>]) -> Vec<u8> {
        let fields: [(&str, &[u8]); 3] =
            [("op", &[CHUNK]), ("compression", b"none"), ("size", &[0; 4])];
        let chunk = record(&fields, &records.concat());
        let header = record(&[("op", &[0x03])], &[b' '; 40]);
        [MAGIC.to_vec(), header, chunk].concat()
    }

    fn read(bytes: &[u8], topic: Option<&str>) -> Result<CameraEvents, String> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.bag");
        std::fs::write(&path, bytes).unwrap();
        let found = CameraEvents::gather(&path, topic, |sink| super::read(&path, sink));
        found.map_err(|error| error.to_string())
    }

    #[test]
    fn events_of_a_topic_are_read_and_others_counted() {
        let records = [
            connection(0, "/dvs/events", "dvs_msgs/EventArray"),
            connection(1, "/dvs/imu", "sensor_msgs/Imu"),
            message(0, &[(1_500_000_000, 1_999, 239, 179, 1), (1_500_000_001, 0, 0, 1, 0)]),
            record(
                &[("op", &[MESSAGE]), ("conn", &1_u32.to_le_bytes())],
                &imu_message(RosWire::Ros1),
            ),
            connection(3, "/dvs/image_raw", "sensor_msgs/Image"),
            record(
                &[("op", &[MESSAGE]), ("conn", &3_u32.to_le_bytes())],
                &rgb_image(RosWire::Ros1),
            ),
            connection(4, "/tf", "tf2_msgs/TFMessage"),
            message(4, &[]),
        ];
        let bytes = bag(&records);
        let found = read(&bytes, None).unwrap();
        let events: Vec<(i64, u16, u16, bool)> =
            found.events.as_slice().iter().map(|e| (e.t, e.x, e.y, e.on)).collect();
        let expected =
            [(1_500_000_000_000_001, 239, 179, true), (1_500_000_001_000_000, 0, 1, false)];
        assert_eq!(events, expected);
        assert_eq!(found.size, Some(Size::new(240, 180)));
        let expected = [
            ("messages of /tf (tf2_msgs/TFMessage)", 1),
            ("frames of /dvs/image_raw", 1),
            ("inertial samples of /dvs/imu", 1),
        ];
        assert_eq!(found.left_out, expected.map(|(what, n)| (what.to_owned(), n)));
        let twice = [&records[..], &[connection(2, "/right", "dvs_msgs/EventArray")]].concat();
        let twice = bag(&[twice, vec![message(2, &[(1, 0, 1, 1, 1)])]].concat());
        let error = read(&twice, None).unwrap_err();
        assert!(error.contains("/dvs/events, /right") && error.contains("--topic"), "{error}");
        assert_eq!(read(&twice, Some("/right")).unwrap().events.len(), 1);
    }

    #[test]
    fn a_bag_that_was_cut_is_read_up_to_the_cut() {
        let records = [
            connection(0, "/e", "dvs_msgs/EventArray"),
            message(0, &[(1, 0, 1, 1, 1)]),
            message(0, &[(2, 0, 1, 1, 1)]),
        ];
        let whole = bag(&records);
        let two = [whole.clone(), bag(&records)[MAGIC.len()..].to_vec()].concat();
        let found = read(&two[..two.len() - 5], None).unwrap();
        assert_eq!(found.events.len(), 3);
        assert!(found.damage.unwrap().contains("cut"));
    }
}
