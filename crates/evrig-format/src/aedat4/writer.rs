//! The writer: packets of sensible size, and a data table at the end.

use super::compression::compress;
use super::header::{self, MAGIC};
use super::outgoing::{HEAD_BYTES, PacketBuffer, PacketInput};
use super::table::{self, TableEntry};
use super::{Compression, Content, StreamSpec, WriteError};
use crate::Destination;
use evrig_core::event::EventSlice;
use evrig_core::frame::Frame;
use evrig_core::imu::{ImuSample, Trigger};
use evrig_core::time::Davis;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// Packets that are compressed in parallel, ahead of the one that is written: at least two for each
/// core of a desktop computer, 8 MiB before compression.
const PARALLEL_PACKETS: usize = 16;

/// Packets that are encoded without compression ahead of the one that is written: the one that the
/// other thread fills, so that the memory of both stays in the cache.
const UNCOMPRESSED_AHEAD: usize = 2;

/// Small packets are gathered to this size; larger ones are written as they are, each at once.
const GATHERED_BYTES: usize = 1 << 16;

/// What was written, counted while writing.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct WriteSummary {
    /// Elements in each stream (events, frames, samples or triggers), in the order of the streams.
    pub n_elements: Vec<u64>,
    /// Packets in all streams.
    pub n_packets: u64,
    /// Bytes from the first to the last, the data table included.
    pub n_bytes: u64,
}

/// Writes the table's position into the header; only for seekable destinations.
type PatchHeader<W> = fn(&mut W, &[u8]) -> io::Result<()>;

/// Writes AEDAT4 to a file, or to a socket in that one's framing.
///
/// Each call writes whole packets, so that a file which is dropped without
/// [`Writer::finish`] can be read up to its last packet; it only lacks the data
/// table, by which DV seeks. What is still buffered then is written as well,
/// but an error in that is lost; `finish` reports it.
#[derive(Debug)]
pub struct Writer<W: Write> {
    destination: W,
    name: String,
    compression: Compression,
    streams: Vec<StreamSpec>,
    patch_header: Option<PatchHeader<W>>,
    entries: Vec<TableEntry>,
    summary: WriteSummary,
    /// Memory of packets that were written.
    spare: Vec<PacketBuffer>,
}

impl Writer<BufWriter<File>> {
    /// Makes a file, replacing one that is there, and writes its header.
    ///
    /// # Errors
    /// [`WriteError`] when the file cannot be made or written.
    pub fn create(
        path: impl AsRef<Path>,
        compression: Compression,
        streams: &[StreamSpec],
    ) -> Result<Self, WriteError> {
        let path = path.as_ref();
        let file = File::create(path)
            .map_err(|source| WriteError::Create { path: path.to_owned(), source })?;
        let destination = BufWriter::with_capacity(GATHERED_BYTES, file);
        Self::new(destination, &path.display().to_string(), compression, streams)
    }
}

impl Writer<BufWriter<Destination>> {
    /// Writes what is recorded, as it comes. A pipe gets the bytes of the file but for the data
    /// table at its end, which a reader finds by going back.
    ///
    /// # Errors
    /// [`WriteError`] when the header cannot be written.
    pub fn as_recorded(
        destination: Destination,
        name: &str,
        compression: Compression,
        streams: &[StreamSpec],
    ) -> Result<Self, WriteError> {
        let can_seek = destination.can_seek();
        let buffered = BufWriter::with_capacity(GATHERED_BYTES, destination);
        if can_seek {
            return Self::new(buffered, name, compression, streams);
        }
        let mut writer = Self::headless(buffered, name, compression, streams);
        writer.write_bytes(MAGIC)?;
        writer.write_header()?;
        Ok(writer)
    }
}

impl<W: Write + Seek> Writer<W> {
    /// Writes a file's bytes to a seekable destination; `name` names it in errors.
    ///
    /// # Errors
    /// [`WriteError`] when the header cannot be written.
    pub fn new(
        destination: W,
        name: &str,
        compression: Compression,
        streams: &[StreamSpec],
    ) -> Result<Self, WriteError> {
        let mut writer = Self::headless(destination, name, compression, streams);
        writer.patch_header = Some(|destination, header| {
            destination.seek(SeekFrom::Start(MAGIC.len() as u64))?;
            destination.write_all(header)?;
            destination.seek(SeekFrom::End(0)).map(|_| ())
        });
        writer.write_bytes(MAGIC)?;
        writer.write_header()?;
        Ok(writer)
    }
}

impl<W: Write> Writer<W> {
    /// Writes in the framing of a socket: no first bytes, no data table, and each packet is
    /// flushed.
    ///
    /// # Errors
    /// [`WriteError`] when the header cannot be written.
    pub fn to_stream(
        destination: W,
        name: &str,
        compression: Compression,
        streams: &[StreamSpec],
    ) -> Result<Self, WriteError> {
        let mut writer = Self::headless(destination, name, compression, streams);
        writer.write_header()?;
        writer.flush()?;
        Ok(writer)
    }

    fn headless(
        destination: W,
        name: &str,
        compression: Compression,
        streams: &[StreamSpec],
    ) -> Self {
        Self {
            destination,
            name: name.to_owned(),
            compression,
            streams: streams.to_vec(),
            patch_header: None,
            entries: Vec::new(),
            summary: WriteSummary { n_elements: vec![0; streams.len()], ..WriteSummary::default() },
            spare: Vec::new(),
        }
    }

    /// Packets written so far, in all streams.
    #[must_use]
    pub const fn n_packets(&self) -> u64 {
        self.summary.n_packets
    }

    /// Writes a run of events in packets of 8,192 to 32,768 events, of 10 ms or, in quiet scenes,
    /// up to 1 s.
    ///
    /// A call ends a packet, so what is written as it arrives is there at once.
    ///
    /// # Errors
    /// [`WriteError`] when the stream carries no events, a coordinate is above 32,767, or writing
    /// fails.
    pub fn write_events(&mut self, stream: u32, events: EventSlice<'_>) -> Result<(), WriteError> {
        self.write_all([(stream, PacketInput::Events(events))])
    }

    /// Writes one frame.
    ///
    /// # Errors
    /// [`WriteError`] when the stream carries no frames, the samples do not match the frame's size
    /// or larger than AEDAT4 can hold, or writing fails.
    pub fn write_frame(&mut self, stream: u32, frame: &Frame<Davis>) -> Result<(), WriteError> {
        self.write_all([(stream, PacketInput::Frame(frame))])
    }

    /// Writes inertial samples.
    ///
    /// # Errors
    /// [`WriteError`] when the stream carries none or writing fails.
    pub fn write_imu(&mut self, stream: u32, samples: &[ImuSample]) -> Result<(), WriteError> {
        self.write_all([(stream, PacketInput::Imu(samples))])
    }

    /// Writes triggers.
    ///
    /// # Errors
    /// [`WriteError`] when the stream carries none or writing fails.
    pub fn write_triggers(&mut self, stream: u32, marks: &[Trigger]) -> Result<(), WriteError> {
        self.write_all([(stream, PacketInput::Triggers(marks))])
    }

    /// Writes contents in order, each with the number of its stream, and compresses their packets in
    /// parallel. Contents of an unknown kind are passed over.
    ///
    /// # Errors
    /// [`WriteError`] when a stream carries something else, AEDAT4 cannot hold a content, or writing
    /// fails; nothing is written where one is refused.
    pub fn write_contents(&mut self, contents: &[(u32, Content)]) -> Result<(), WriteError> {
        self.write_all(
            contents.iter().filter_map(|(stream, content)| {
                PacketInput::of(content).map(|input| (*stream, input))
            }),
        )
    }

    /// Checks contents and writes their packets, several in parallel.
    pub(super) fn write_all<'a>(
        &mut self,
        contents: impl IntoIterator<Item = (u32, PacketInput<'a>)>,
    ) -> Result<(), WriteError> {
        let mut inputs = Vec::new();
        for (stream, content) in contents {
            self.check_stream(stream, content)?;
            inputs.extend(content.cut().into_iter().map(|input| (stream, input)));
        }
        match inputs.as_slice() {
            [(stream, input)] => {
                let mut packet = self.spare.pop().unwrap_or_default();
                let filled = packet.fill(self.compression, *input);
                filled.map_err(|source| self.failed(source))?;
                self.write_packet(*stream, packet)?;
            }
            several => self.write_parallel(several)?,
        }
        self.flush_stream()
    }

    /// Encodes and compresses packets in parallel and writes each as soon as those before it are
    /// written.
    fn write_parallel(&mut self, inputs: &[(u32, PacketInput<'_>)]) -> Result<(), WriteError> {
        let compression = self.compression;
        let n_ahead = match compression {
            Compression::None => UNCOMPRESSED_AHEAD,
            Compression::Lz4 | Compression::Zstd => PARALLEL_PACKETS,
        };
        rayon::in_place_scope(|scope| {
            let mut ahead = VecDeque::with_capacity(n_ahead);
            for &(stream, input) in inputs {
                if ahead.len() == n_ahead
                    && let Some((stream, filled)) = ahead.pop_front()
                {
                    self.write_filled(stream, &filled)?;
                }
                let mut packet = self.spare.pop().unwrap_or_default();
                let (sender, filled) = sync_channel(1);
                scope.spawn(move |_| {
                    // The receiver is gone only after an error.
                    let _ = sender.send(packet.fill(compression, input).map(|()| packet));
                });
                ahead.push_back((stream, filled));
            }
            ahead.into_iter().try_for_each(|(stream, filled)| self.write_filled(stream, &filled))
        })
    }

    /// Waits for a packet and writes it.
    fn write_filled(
        &mut self,
        stream: u32,
        filled: &Receiver<io::Result<PacketBuffer>>,
    ) -> Result<(), WriteError> {
        let received = loop {
            match filled.try_recv() {
                // A thread of the pool that waited could be the one that the packet needs.
                Err(TryRecvError::Empty) if rayon::yield_now() == Some(rayon::Yield::Executed) => {}
                Err(TryRecvError::Empty) => break filled.recv().map_err(io::Error::other),
                done => break done.map_err(io::Error::other),
            }
        };
        let packet = received.flatten().map_err(|source| self.failed(source))?;
        self.write_packet(stream, packet)
    }

    /// Writes the data table (of a file), flushes, and returns counts of what was written.
    ///
    /// # Errors
    /// [`WriteError`] when writing fails; the packets are in the file all the same.
    pub fn finish(mut self) -> Result<WriteSummary, WriteError> {
        if let Some(patch) = self.patch_header {
            let position = self.summary.n_bytes;
            let mut table = Vec::new();
            let n = compress(self.compression, &table::encode(&self.entries), &mut table, 0)
                .map_err(|source| self.failed(source))?;
            self.write_bytes(&table[..n])?;
            // The table is written before the header refers to it.
            self.flush()?;
            let header = header::encode(self.compression, Some(position), &self.streams);
            patch(&mut self.destination, &header).map_err(|source| self.failed(source))?;
        }
        self.flush()?;
        Ok(self.summary)
    }

    fn write_packet(&mut self, stream: u32, mut packet: PacketBuffer) -> Result<(), WriteError> {
        if self.patch_header.is_some() {
            self.entries.push(TableEntry {
                payload_offset: self.summary.n_bytes + HEAD_BYTES as u64,
                stream,
                payload_bytes: packet.payload_bytes(),
                n_elements: packet.n_elements as u64,
                span_us: packet.span_us,
            });
        }
        self.write_bytes(packet.finish(stream))?;
        self.summary.n_packets += 1;
        if let Some(n) = self.summary.n_elements.get_mut(stream as usize) {
            *n += packet.n_elements as u64;
        }
        self.spare.push(packet);
        Ok(())
    }

    fn write_header(&mut self) -> Result<(), WriteError> {
        let header = header::encode(self.compression, None, &self.streams);
        self.write_bytes(&header)
    }

    fn write_bytes(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        self.destination.write_all(bytes).map_err(|source| self.failed(source))?;
        self.summary.n_bytes += bytes.len() as u64;
        Ok(())
    }

    /// On a socket, flushes immediately.
    fn flush_stream(&mut self) -> Result<(), WriteError> {
        if self.patch_header.is_none() { self.flush() } else { Ok(()) }
    }

    /// Flushes everything written so far.
    ///
    /// # Errors
    /// [`WriteError`] when writing fails.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.destination.flush().map_err(|source| self.failed(source))
    }

    /// Refuses what the stream does not carry or AEDAT4 cannot hold.
    fn check_stream(&self, stream: u32, content: PacketInput<'_>) -> Result<(), WriteError> {
        let (name, (kind, expected)) = (self.name.clone(), content.kind());
        let found = match self.streams.get(stream as usize) {
            Some(spec) if spec.kind == kind => {
                let Some(found) = content.unrepresentable() else { return Ok(()) };
                let limit =
                    "columns and rows up to 32767, and exactly the samples of a frame's size";
                return Err(WriteError::Unrepresentable { name, stream, found, limit });
            }
            Some(spec) => format!("({}) carries {}", spec.name, spec.kind.identifier()),
            None => format!("does not exist among {}", self.streams.len()),
        };
        Err(WriteError::WrongStream { name, stream, expected, found })
    }

    fn failed(&self, source: io::Error) -> WriteError {
        WriteError::Io { name: self.name.clone(), packet: self.summary.n_packets, source }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aedat4::Reader;
    use crate::aedat4::cut::cut_into_packets;
    use evrig_core::event::{Event, Events};
    use evrig_core::geometry::Size;
    use evrig_core::imu::TriggerKind;
    use evrig_core::time::Stamp;
    use proptest::prelude::*;
    use std::io::Cursor;

    fn specs() -> [StreamSpec; 2] {
        [StreamSpec::events(Size::DAVIS346, "w"), StreamSpec::triggers("w")]
    }

    fn events_of<R: io::Read>(reader: Reader<R>) -> Events {
        let mut all = Events::new();
        for packet in reader {
            if let Content::Events(events) = packet.unwrap().content {
                all.extend_from_slice(events.as_slice());
            }
        }
        all
    }

    fn at(times: impl Iterator<Item = i64>) -> Events {
        times.map(|t| Event { t, x: 1, y: 2, on: true }).collect()
    }

    #[test]
    fn a_file_that_was_dropped_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dropped.aedat4");
        let mut writer = Writer::create(&path, Compression::Lz4, &specs()).unwrap();
        let events = at(0..50_000);
        writer.write_events(0, events.as_slice()).unwrap();
        drop(writer);
        assert!(events_of(Reader::open(&path).unwrap()) == events);
    }

    #[test]
    fn packets_compressed_side_by_side_stay_in_order() {
        // A hundred packets of ten events, then one, then a hundred again: memory is used anew.
        let quiet = at((0..1_000).map(|i| i * 100_000));
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
            let mut bytes = Cursor::new(Vec::new());
            let mut writer = Writer::new(&mut bytes, "w", compression, &specs()).unwrap();
            let mut expected = Events::new();
            for run in [quiet.as_slice(), quiet.as_slice().range(0, 1), quiet.as_slice()] {
                writer.write_events(0, run).unwrap();
                expected.extend_from_slice(run);
            }
            assert_eq!(writer.finish().unwrap().n_packets, 201);
            let reader = Reader::new(bytes.get_ref().as_slice(), "w").unwrap();
            assert!(events_of(reader) == expected, "{compression:?}");
        }
    }

    #[test]
    fn contents_of_several_streams_stay_in_order() {
        let events = at(0..70_000);
        let mark = Trigger { stamp: Stamp::from_micros(3), kind: TriggerKind::from_code(1) };
        let contents = [
            (0, Content::Events(events.clone())),
            (1, Content::Triggers(vec![mark])),
            (0, Content::Events(at(5..6))),
        ];
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = Writer::new(&mut bytes, "w", Compression::Lz4, &specs()).unwrap();
        writer.write_contents(&contents).unwrap();
        assert!(writer.write_contents(&[(1, Content::Events(events))]).is_err());
        assert_eq!(writer.finish().unwrap().n_elements, [70_001, 1]);
        let reader = Reader::new(bytes.get_ref().as_slice(), "w").unwrap();
        let lengths: Vec<(u32, usize)> = reader
            .map(|packet| packet.unwrap())
            .map(|packet| match packet.content {
                Content::Events(events) => (packet.stream, events.len()),
                _ => (packet.stream, 1),
            })
            .collect();
        assert_eq!(lengths[..7], [(0, 10_000); 7]);
        assert_eq!(lengths[7..], [(1, 1), (0, 1)]);
    }

    #[test]
    fn a_socket_gets_whole_packets_without_the_first_bytes() {
        let mut wire = Vec::new();
        let mut writer = Writer::to_stream(&mut wire, "tcp", Compression::Zstd, &specs()).unwrap();
        let events = at(0..10);
        writer.write_events(0, events.as_slice()).unwrap();
        writer.finish().unwrap();
        assert!(!wire.starts_with(b"#!AER"));
        assert!(events_of(Reader::from_stream(wire.as_slice(), "tcp").unwrap()) == events);
    }

    #[test]
    fn what_the_format_cannot_hold_is_refused_before_anything_is_written() {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = Writer::new(&mut bytes, "w", Compression::None, &specs()).unwrap();
        let beyond: Events = [Event { t: 0, x: 32_768, y: 0, on: true }].into_iter().collect();
        let error = writer.write_events(0, beyond.as_slice()).unwrap_err().to_string();
        assert!(error.contains("stream 0: event 0 at x 32768, y 0 cannot be written"), "{error}");
        let error = writer.write_events(1, beyond.as_slice()).unwrap_err().to_string();
        assert!(error.contains("stream 1 (triggers) carries TRIG"), "{error}");
        let error = writer.write_imu(7, &[]).unwrap_err().to_string();
        assert!(error.contains("stream 7 does not exist among 2"), "{error}");
        assert_eq!(writer.finish().unwrap().n_packets, 0);
    }

    #[test]
    fn quiet_scenes_are_cut_each_second_and_busy_ones_by_number() {
        let quiet = at((0..100).map(|i| i * 100_000));
        let lengths = |events: &Events| -> Vec<usize> {
            cut_into_packets(events.as_slice()).iter().map(|[start, end]| end - start).collect()
        };
        assert_eq!(lengths(&quiet), [10; 10]);
        assert_eq!(lengths(&at((0..100_000).map(|i| i / 100))), [32_768, 32_768, 32_768, 1_696]);
        assert_eq!(lengths(&at((0..25_000).map(|i| i * 1_000 / 1_250))), [12_500, 12_500]);
    }

    proptest! {
        #[test]
        fn events_in_any_order_come_back_as_they_were(
            events in prop::collection::vec((any::<i64>(), 0..32_768_u16, 0..32_768_u16, any::<bool>()), 0..300),
            compression in prop::sample::select(vec![Compression::None, Compression::Lz4, Compression::Zstd]),
        ) {
            let events: Events =
                events.into_iter().map(|(t, x, y, on)| Event { t, x, y, on }).collect();
            let mut bytes = Cursor::new(Vec::new());
            let mut writer = Writer::new(&mut bytes, "w", compression, &specs()).unwrap();
            writer.write_events(0, events.as_slice()).unwrap();
            prop_assert_eq!(writer.finish().unwrap().n_elements, vec![events.len() as u64, 0]);
            let back = events_of(Reader::new(bytes.get_ref().as_slice(), "w").unwrap());
            prop_assert_eq!(back, events);
        }
    }
}
