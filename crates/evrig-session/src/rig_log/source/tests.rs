//! Damage costs the chunk it is in, and no memory.

use super::*;

/// Bytes, and the largest room that was offered for them.
struct Offered<'a> {
    bytes: &'a [u8],
    most: &'a mut usize,
}

impl Read for Offered<'_> {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        *self.most = room.len().max(*self.most);
        self.bytes.read(room)
    }
}

/// Messages read, damage passed over, and the final damage.
fn drain(bytes: &[u8]) -> (usize, u64, Option<String>) {
    let mut source = RecordSource::new(bytes);
    let mut n_messages = 0;
    let damage = loop {
        match source.step().unwrap() {
            ReadStep::Record(Record::Message { .. }) => n_messages += 1,
            ReadStep::Record(_) | ReadStep::Nothing => {}
            ReadStep::Damage(what) => break Some(what),
            ReadStep::End => break None,
        }
    };
    (n_messages, source.passed_over().count, damage)
}

const PER_CHUNK: usize = 10;
const N_CHUNKS: usize = 5;

/// A log of five chunks of ten messages, and where its chunks begin.
fn log() -> (Vec<u8>, Vec<usize>) {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(None);
    let mut writer = mcap::Writer::with_options(std::io::Cursor::new(Vec::new()), options).unwrap();
    let channel = writer.add_channel(0, "/t", "", &std::collections::BTreeMap::new()).unwrap();
    for k in 0..(PER_CHUNK * N_CHUNKS) as u64 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: k as u32,
            log_time: k,
            publish_time: k,
        };
        writer.write_to_known_channel(&header, &[k as u8; 100]).unwrap();
        if (k + 1) % PER_CHUNK as u64 == 0 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    let bytes = writer.into_inner().into_inner();
    let mut starts = Vec::new();
    let mut at = 0;
    while let Some(found) = find_chunk(&bytes[at..]) {
        starts.push(at + found);
        at += found + 1;
    }
    assert_eq!(starts.len(), N_CHUNKS);
    (bytes, starts)
}

#[test]
fn damage_in_a_chunk_costs_that_chunk() {
    let (whole, starts) = log();
    assert_eq!(drain(&whole), (50, 0, None));
    for (place, why) in [(500, "records"), (1, "length"), (0, "opcode"), (41, "first record")] {
        let mut damaged = whole.clone();
        let at = starts[2] + place;
        damaged[at..at + 8].fill(0xff);
        assert_eq!(drain(&damaged), (40, 1, None), "{why}");
    }
}

#[test]
fn a_cut_chunk_gives_its_whole_messages() {
    let (whole, starts) = log();
    let (n, passed_over, damage) = drain(&whole[..starts[3] + 400]);
    assert!((30..40).contains(&n) && n > 30, "{n}");
    assert_eq!(passed_over, 0);
    assert!(damage.unwrap().contains("in the middle of a record"));
}

#[test]
fn an_attachment_without_room_for_its_end_is_passed_over() {
    // Two times of eight bytes, the lengths of two names, that of the data: 32 bytes, and no
    // checksum.
    let attachment = [&[op::ATTACHMENT][..], &32_u64.to_le_bytes(), &[0; 32]].concat();
    let bytes = [mcap::MAGIC, &attachment, &[op::DATA_END], &4_u64.to_le_bytes(), &[0; 4]].concat();
    let mut source = RecordSource::new(&bytes[..]);
    let mut n_records = 0;
    loop {
        match source.step().unwrap() {
            ReadStep::Nothing => {}
            ReadStep::Record(_) => n_records += 1,
            ReadStep::Damage(_) | ReadStep::End => break,
        }
    }
    assert_eq!(n_records, 1, "what comes behind it is read");
}

#[test]
fn a_record_that_is_announced_and_not_there_takes_no_memory() {
    let announced = MAX_RECORD_BYTES.to_le_bytes();
    let bytes = [mcap::MAGIC, &[mcap::records::op::MESSAGE], &announced, &[7; 30]].concat();
    let mut most = 0;
    let mut source = RecordSource::new(Offered { bytes: &bytes, most: &mut most });
    let end = loop {
        match source.step().unwrap() {
            ReadStep::Nothing | ReadStep::Record(_) => {}
            ReadStep::Damage(what) => break what,
            ReadStep::End => break "an end".to_owned(),
        }
    };
    assert!(end.contains("in the middle of a record"), "{end}");
    assert!(most <= MAX_READ_BYTES, "room for {most} bytes");
}
