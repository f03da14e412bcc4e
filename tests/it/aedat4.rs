//! AEDAT4 on a real recording: complete, truncated anywhere, damaged anywhere.

use evrig::format::aedat4::{
    Compression, Content, PayloadKind, ReadError, Reader, StreamSpec, Writer,
};
use evrig::geometry::Size;
use std::fs;
use std::io::{Cursor, Read};
use std::sync::OnceLock;

const STREET: &str = "tests/data/davis346-street.aedat4";

/// Packets in the recording.
const N_PACKETS: usize = 708;

fn street() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| fs::read(STREET).expect("the recording is in the repository"))
}

#[derive(Debug, Default, Clone, PartialEq, Eq)]
struct ElementCounts {
    events: usize,
    frames: usize,
    samples: usize,
    triggers: usize,
    unknown: usize,
}

impl ElementCounts {
    fn add(&mut self, content: &Content) {
        match content {
            Content::Events(events) => self.events += events.len(),
            Content::Frame(_) => self.frames += 1,
            Content::Imu(samples) => self.samples += samples.len(),
            Content::Triggers(triggers) => self.triggers += triggers.len(),
            Content::Unknown { .. } => self.unknown += 1,
        }
    }
}

/// All packets of a reader and its error (at most one, at the end).
fn drain<R: Read>(reader: Reader<R>) -> (Vec<evrig::format::aedat4::Packet>, Option<ReadError>) {
    let mut packets = Vec::new();
    let mut error = None;
    for item in reader {
        assert!(error.is_none(), "nothing comes after an error");
        match item {
            Ok(packet) => packets.push(packet),
            Err(e) => error = Some(e),
        }
    }
    (packets, error)
}

/// Byte offsets of the recording's packets, and the end of the last.
fn boundaries() -> &'static [u64] {
    static OFFSETS: OnceLock<Vec<u64>> = OnceLock::new();
    OFFSETS.get_or_init(|| {
        let (packets, _) = drain(Reader::new(street(), "street").unwrap());
        let mut offsets: Vec<u64> = packets.iter().map(|packet| packet.offset).collect();
        let last = *offsets.last().unwrap() as usize;
        let length = u32::from_le_bytes(street()[last + 4..last + 8].try_into().unwrap());
        offsets.push(last as u64 + 8 + u64::from(length));
        offsets
    })
}

#[test]
fn element_counts_agree_with_other_readers() {
    // dv-processing 2.0.4 and aedat 1.3.3 count the same.
    let mut reader = Reader::open(STREET).unwrap();
    let kinds: Vec<_> = reader.streams().iter().map(|stream| stream.kind.clone()).collect();
    assert_eq!(
        kinds,
        [PayloadKind::Events, PayloadKind::Frames, PayloadKind::Imu, PayloadKind::Triggers]
    );
    assert_eq!(reader.streams()[0].size, Some(Size::DAVIS346));
    assert_eq!(reader.streams()[1].source, "DAVIS346_00000002");
    assert_eq!(reader.compression(), Compression::Lz4);
    let mut counts = ElementCounts::default();
    let mut pixels = 0_u64;
    for packet in &mut reader {
        let packet = packet.unwrap();
        counts.add(&packet.content);
        match packet.content {
            Content::Frame(frame) => {
                assert_eq!(frame.size, Size::DAVIS346);
                if counts.frames == 1 {
                    pixels = frame.brightness().iter().map(|&value| value as u64).sum();
                    // The recorder stores the middle of the exposure; dv-processing shows its
                    // start.
                    let [start, end] = frame.timing.exposure.expect("DV states the exposure");
                    assert_eq!(start.as_micros(), 1_589_163_147_364_965);
                    assert_eq!(end.as_micros() - start.as_micros(), 500);
                    assert_eq!(frame.timing.mid_exposure(0), frame.timing.stamp);
                }
            }
            Content::Events(events) => {
                assert_eq!(events.as_slice().first_outside(Size::DAVIS346), None);
            }
            _ => {}
        }
    }
    let truth =
        ElementCounts { events: 78_830, frames: 59, samples: 2_363, triggers: 236, unknown: 0 };
    assert_eq!(counts, truth);
    // dv-processing: getNextFrame().image.mean() * 346 * 260 = 77.25277901289462 * 89960.
    assert_eq!(pixels, 6_949_660);
    assert!(reader.losses().is_none());
}

#[test]
fn a_truncated_file_is_read_up_to_the_cut() {
    let boundaries = boundaries();
    assert_eq!(boundaries.len(), N_PACKETS + 1);
    let n_bytes = street().len();
    let spread = (0..400).map(|i| i * n_bytes / 400);
    let at_boundaries = boundaries.iter().step_by(41).map(|&offset| offset as usize);
    let near_boundaries = boundaries.iter().step_by(37).map(|&offset| offset as usize + 5);
    for cut in spread.chain(at_boundaries).chain(near_boundaries).chain([n_bytes - 1]) {
        let reader = match Reader::new(&street()[..cut], "street") {
            Ok(reader) => reader,
            Err(error) => {
                assert!((cut as u64) < boundaries[0], "cut at {cut}: {error}");
                continue;
            }
        };
        let (packets, error) = drain(reader);
        let n_whole = boundaries[1..].iter().filter(|&&end| end <= cut as u64).count();
        assert_eq!(packets.len(), n_whole, "cut at {cut}");
        let error = error.unwrap_or_else(|| panic!("cut at {cut}: no error"));
        let place = error.place().unwrap();
        assert_eq!(place.offset, boundaries[n_whole], "cut at {cut}: {error}");
        assert_eq!(place.packet, Some(n_whole as u64), "cut at {cut}: {error}");
        assert!(error.to_string().contains("expected"), "{error}");
    }
}

#[test]
fn every_truncated_header_is_an_error() {
    let first = boundaries()[0] as usize;
    for cut in 0..first {
        let error = Reader::new(&street()[..cut], "street").unwrap_err();
        assert!(error.to_string().starts_with("street: byte "), "{error}");
        assert!(error.to_string().contains("header"), "{error}");
    }
    let (packets, error) = drain(Reader::new(&street()[..first], "street").unwrap());
    assert!(packets.is_empty() && error.is_some());
}

#[test]
fn truncation_on_disk_is_detected_as_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.aedat4");
    let boundaries = boundaries();
    for cut in [boundaries[3], boundaries[3] + 2, boundaries[3] + 100, boundaries[N_PACKETS] + 1] {
        fs::write(&path, &street()[..cut as usize]).unwrap();
        let (packets, error) = drain(Reader::open(&path).unwrap());
        let error = error.unwrap();
        assert_eq!(packets.len(), if cut > boundaries[4] { N_PACKETS } else { 3 }, "{error}");
        assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
    }
}

#[test]
fn damage_never_panics_and_earlier_packets_are_read() {
    let boundaries = boundaries();
    let first = boundaries[0] as usize;
    let (truth, _) = drain(Reader::new(street(), "street").unwrap());
    let n_bytes = street().len();
    let in_header = (0..first).step_by(3);
    let heads = boundaries[..40].iter().flat_map(|&b| (0..32).map(move |i| b as usize + i));
    let spread = (0..100).map(|i| first + i * (n_bytes - first) / 100);
    // Damage far into the file is tested in a file of a few packets, to save time.
    for at in in_header.chain(heads).chain(spread) {
        let (from, to) = neighbourhood(boundaries, at);
        let mut bytes = street()[..first].to_vec();
        // Without a data table the part is a complete file.
        let position = table_position_at(&bytes);
        bytes[position..position + 8].copy_from_slice(&(-1_i64).to_le_bytes());
        bytes.extend_from_slice(&street()[boundaries[from] as usize..boundaries[to] as usize]);
        let at = if at < first { at } else { at - boundaries[from] as usize + first };
        let Some(byte) = bytes.get_mut(at) else { continue };
        *byte ^= 1 << (at % 8);
        let Ok(reader) = Reader::new(bytes.as_slice(), "street") else { continue };
        let (packets, _) = drain(reader);
        let untouched = boundaries[from..to]
            .iter()
            .zip(&boundaries[from + 1..=to])
            .take_while(|(_, end)| (**end - boundaries[from]) as usize + first <= at)
            .count();
        if at >= first {
            assert!(packets.len() >= untouched, "byte {at}: {} of {untouched}", packets.len());
        }
        for (packet, true_packet) in packets.iter().take(untouched).zip(&truth[from..]) {
            assert_eq!(packet.content, true_packet.content, "byte {at}");
        }
    }
}

/// The packets around a byte: two before it and two after.
fn neighbourhood(boundaries: &[u64], at: usize) -> (usize, usize) {
    let packet = boundaries.partition_point(|&offset| offset <= at as u64).saturating_sub(1);
    (packet.saturating_sub(2), (packet + 3).min(boundaries.len() - 1))
}

/// Offset in the header of the position of the data table.
fn table_position_at(header: &[u8]) -> usize {
    let position = boundaries()[N_PACKETS].to_le_bytes();
    header.windows(8).position(|window| window == position).expect("the header names the table")
}

#[test]
fn an_unclosed_file_ends_without_error_after_any_packet() {
    let boundaries = boundaries();
    let mut bytes = street()[..boundaries[9] as usize].to_vec();
    let position = table_position_at(&bytes);
    bytes[position..position + 8].copy_from_slice(&(-1_i64).to_le_bytes());
    let (packets, error) = drain(Reader::new(bytes.as_slice(), "open").unwrap());
    assert_eq!(packets.len(), 9);
    assert!(error.is_none(), "{error:?}");
}

#[test]
fn other_file_types_are_refused_with_their_path() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in
        [("empty", &b""[..]), ("text", b"# t x y p\n1 2 3 1\n"), ("short", b"#!AER")]
    {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let error = Reader::open(&path).unwrap_err().to_string();
        assert!(error.contains("byte 0, header: expected \"#!AER-DAT4.0"), "{error}");
        assert!(error.starts_with(&path.display().to_string()), "{error}");
    }
    let error = Reader::open(folder.path().join("nowhere")).unwrap_err();
    assert!(matches!(error, ReadError::Open { .. }), "{error}");
    assert!(Reader::open(folder.path()).is_err(), "a folder is not a file");
}

/// Returns bytes, then fails.
struct FailingReader<'a>(&'a [u8]);

impl Read for FailingReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self.0.read(buffer)? {
            0 => Err(std::io::Error::other("connection lost")),
            n => Ok(n),
        }
    }
}

#[test]
fn a_connection_error_between_packets_is_not_an_end() {
    let end = boundaries()[7] as usize;
    let (packets, error) =
        drain(Reader::from_stream(FailingReader(&street()[14..end]), "tcp").unwrap());
    assert_eq!(packets.len(), 7);
    assert!(matches!(error, Some(ReadError::Io { .. })), "{error:?}");
    let (packets, error) = drain(Reader::from_stream(&street()[14..end], "tcp").unwrap());
    assert_eq!((packets.len(), error.is_none()), (7, true), "a closed connection is an end");
}

#[test]
fn a_copy_is_equal_in_every_compression() {
    let (truth, _) = drain(Reader::new(street(), "street").unwrap());
    let specs = [
        StreamSpec::events(Size::DAVIS346, "copy"),
        StreamSpec::frames(Size::DAVIS346, "copy"),
        StreamSpec::imu("copy"),
        StreamSpec::triggers("copy"),
    ];
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = Writer::new(&mut bytes, "copy", compression, &specs).unwrap();
        for packet in &truth {
            let stream = match &packet.content {
                Content::Events(_) => 0,
                Content::Frame(_) => 1,
                Content::Imu(_) => 2,
                Content::Triggers(_) => 3,
                Content::Unknown { .. } => unreachable!("the recording has four known streams"),
            };
            packet.content.write(&mut writer, stream).unwrap();
        }
        let summary = writer.finish().unwrap();
        assert_eq!(summary.n_elements, [78_830, 59, 2_363, 236]);
        assert_eq!(summary.n_bytes, bytes.get_ref().len() as u64);
        let (copy, error) = drain(Reader::new(bytes.get_ref().as_slice(), "copy").unwrap());
        assert!(error.is_none(), "{error:?}");
        let columns = |packets: &[evrig::format::aedat4::Packet]| {
            let mut all = evrig::event::Events::new();
            for packet in packets {
                if let Content::Events(events) = &packet.content {
                    all.extend_from_slice(events.as_slice());
                }
            }
            all
        };
        assert_eq!(columns(&copy), columns(&truth));
        let rest = |packets: &[evrig::format::aedat4::Packet]| {
            let contents = packets.iter().map(|packet| packet.content.clone());
            contents.filter(|content| !matches!(content, Content::Events(_))).collect::<Vec<_>>()
        };
        // Empty packets, of which the recording has some, are not copied.
        let filled = |content: &Content| !matches!(content, Content::Triggers(t) if t.is_empty());
        let mut truth = rest(&truth);
        truth.retain(filled);
        assert_eq!(rest(&copy), truth);
    }
}

#[test]
fn a_stream_of_unknown_kind_is_skipped_and_counted() {
    let mut bytes = street().to_vec();
    let at = bytes.windows(4).position(|window| window == b"TRIG").unwrap();
    bytes[at..at + 4].copy_from_slice(b"POSE");
    let mut reader = Reader::new(bytes.as_slice(), "street").unwrap();
    assert_eq!(reader.streams()[3].kind, PayloadKind::Other("POSE".to_owned()));
    let mut counts = ElementCounts::default();
    reader.by_ref().for_each(|packet| counts.add(&packet.unwrap().content));
    let truth =
        ElementCounts { events: 78_830, frames: 59, samples: 2_363, triggers: 0, unknown: 177 };
    assert_eq!(counts, truth);
    assert_eq!(reader.losses().unknown_packets, 177);
}

#[test]
fn corpus_inputs_give_packets_and_at_most_one_error() {
    let mut n_inputs = 0;
    for input in fs::read_dir("fuzz/corpus/aedat4").unwrap() {
        let bytes = fs::read(input.unwrap().path()).unwrap();
        for reader in [Reader::new(&*bytes, "kept"), Reader::from_stream(&*bytes, "kept")] {
            let n_errors = reader.map_or(1, |reader| reader.filter(Result::is_err).count());
            assert!(n_errors <= 1);
        }
        n_inputs += 1;
    }
    assert!(n_inputs > 200, "{n_inputs}");
}
