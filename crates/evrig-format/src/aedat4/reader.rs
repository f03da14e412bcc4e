//! The reader: raw packets are read in order, decoded in parallel, and delivered in order.

use super::compression::decompress;
use super::decode::{Decoded, decode};
use super::framing::{Framing, RawPacket};
use super::header::Header;
use super::memory::DecompressFailure;
use super::{
    Compression, Content, Losses, MAX_PACKET_BYTES, Packet, PayloadKind, ReadError, StreamHeader,
};
use evrig_core::event::Events;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Packets read ahead at most. Live sources, which must not wait for the next packet, read one; so
/// do uncompressed files, whose packets are split into columns fastest while they are in the cache.
const READ_AHEAD_PACKETS: usize = 256;

/// Bytes of the file after which no further packet is read ahead.
const READ_AHEAD_BYTES: usize = 1 << 22;

/// Largest size of a packet decoded in parallel, at least and as a multiple of its bytes in the
/// file. One that needs more is decoded by itself, so that a hostile file cannot fill the memory.
const PARALLEL_MIN_BYTES: usize = 1 << 20;
const PARALLEL_MAX_RATIO: usize = 32;

/// Parts into which a thread's share of the packets is cut, so that threads end together.
const PARTS_PER_THREAD: usize = 4;

/// Reads AEDAT4 packet by packet, from a file or a socket, in bounded memory.
///
/// An iterator over packets in file order. Damaged packets are passed over and counted in
/// [`Losses::damaged_packets`]. After a cut or an I/O error it yields exactly one error and then
/// ends; every packet before the error was delivered. A clean end yields none.
/// Memory: some packets a thread, read ahead and decoded side by side, at most [`MAX_PACKET_BYTES`]
/// for each of raw bytes, all packets decoded together, and a single large one.
#[derive(Debug)]
pub struct Reader<R> {
    framing: Framing<R>,
    streams: Vec<StreamHeader>,
    /// Packets decoded together; with one, packets are read on demand.
    window: usize,
    /// Read, not yet decoded.
    ahead: Vec<RawPacket>,
    /// Decoded, not yet delivered.
    ready: VecDeque<DecodeJob>,
    /// The result after the last packet.
    ending: Option<Result<(), ReadError>>,
    is_over: bool,
    losses: Losses,
    /// Memory of packets that were delivered.
    spare: Vec<Vec<u8>>,
    /// Memory of events that were given back.
    spare_events: Vec<Events>,
}

/// A packet and its decoding result.
#[derive(Debug)]
struct DecodeJob {
    packet: RawPacket,
    /// Memory for its events.
    spare: Events,
    decoded: Result<Decoded, DecodeFailure>,
}

impl DecodeJob {
    fn new(packet: RawPacket, spare: Events) -> Self {
        Self { packet, spare, decoded: Err(DecodeFailure::TooLarge) }
    }

    fn decode(&mut self, streams: &[StreamHeader], compression: Compression, limit: usize) {
        let spare = std::mem::take(&mut self.spare);
        self.decoded = decode_packet(&self.packet, streams, compression, limit, spare);
    }
}

/// Why a packet was not decoded.
#[derive(Debug)]
enum DecodeFailure {
    /// It was not tried yet, or would have grown beyond its share of memory.
    TooLarge,
    /// What was expected and found.
    Damaged(String, String),
}

impl Reader<BufReader<File>> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`ReadError`] when the file cannot be opened or does not begin as AEDAT4 does.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        let path = path.as_ref();
        let failed = |source| ReadError::Open { path: path.to_owned(), source };
        let file = File::open(path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        let n_bytes = metadata.is_file().then_some(metadata.len());
        let name = path.display().to_string();
        let started = Framing::start(BufReader::new(file), &name, n_bytes, true)?;
        Ok(Self::from_start(started, READ_AHEAD_PACKETS))
    }
}

impl<R: Read> Reader<R> {
    /// Reads a file's bytes from any source; `name` names it in errors.
    ///
    /// # Errors
    /// [`ReadError`] when the bytes do not begin as AEDAT4 does.
    pub fn new(source: R, name: &str) -> Result<Self, ReadError> {
        let started = Framing::start(source, name, None, true)?;
        Ok(Self::from_start(started, READ_AHEAD_PACKETS))
    }

    /// Reads from a socket: without the first bytes of a file, and each packet as soon as it came.
    ///
    /// The end of the source between two packets is a clean end; a time-out of the socket is an
    /// error.
    ///
    /// # Errors
    /// [`ReadError`] when the bytes do not begin with a header.
    pub fn from_stream(source: R, name: &str) -> Result<Self, ReadError> {
        let started = Framing::start(source, name, None, false)?;
        Ok(Self::from_start(started, 1))
    }

    fn from_start((framing, header): (Framing<R>, Header), window: usize) -> Self {
        let window = if header.compression == Compression::None { 1 } else { window };
        Self {
            framing,
            streams: header.streams,
            window,
            ahead: Vec::new(),
            ready: VecDeque::new(),
            ending: None,
            is_over: false,
            losses: Losses::default(),
            spare: Vec::new(),
            spare_events: Vec::new(),
        }
    }

    /// The streams that the header describes.
    #[must_use]
    pub fn streams(&self) -> &[StreamHeader] {
        &self.streams
    }

    /// How the packets are compressed.
    #[must_use]
    pub fn compression(&self) -> Compression {
        self.framing.compression()
    }

    /// What was read but could not be represented, in the packets delivered so far.
    #[must_use]
    pub fn losses(&self) -> &Losses {
        &self.losses
    }

    /// Returns events whose memory can be used again. Never
    /// required, but faster: newly allocated memory is cleared page by page.
    pub fn recycle(&mut self, events: Events) {
        if self.spare_events.len() < READ_AHEAD_PACKETS {
            self.spare_events.push(events);
        }
    }

    /// Decodes the packets read ahead and meanwhile reads the next.
    fn fill(&mut self) {
        if self.ahead.is_empty() {
            self.read_ahead();
        }
        let packets = std::mem::take(&mut self.ahead);
        let compression = self.framing.compression();
        let mut jobs: VecDeque<DecodeJob> = packets
            .into_iter()
            .map(|packet| DecodeJob::new(packet, self.spare_events.pop().unwrap_or_default()))
            .collect();
        let streams = std::mem::take(&mut self.streams);
        let decode = |jobs: &mut [DecodeJob]| {
            for job in jobs {
                let limit = job.packet.payload.len().saturating_mul(PARALLEL_MAX_RATIO);
                job.decode(
                    &streams,
                    compression,
                    limit.clamp(PARALLEL_MIN_BYTES, MAX_PACKET_BYTES),
                );
            }
        };
        let jobs_in_order = jobs.make_contiguous();
        if self.window == 1 {
            decode(jobs_in_order);
        } else {
            let n_parts = PARTS_PER_THREAD * rayon::current_num_threads();
            let length = jobs_in_order.len().div_ceil(n_parts).max(1);
            rayon::in_place_scope(|scope| {
                for part in jobs_in_order.chunks_mut(length) {
                    scope.spawn(|_| decode(part));
                }
                self.read_ahead();
            });
        }
        self.streams = streams;
        self.ready = jobs;
    }

    /// Reads the next window of packets, unless the end was reached.
    fn read_ahead(&mut self) {
        let mut n_bytes = 0;
        while self.ending.is_none() && self.ahead.len() < self.window && n_bytes < READ_AHEAD_BYTES
        {
            match self.framing.next(self.spare.pop().unwrap_or_default()) {
                Ok(Some(packet)) => {
                    n_bytes += packet.payload.len();
                    self.ahead.push(packet);
                }
                end => self.ending = Some(end.map(|_| ())),
            }
        }
    }

    /// Counts losses and returns the packet; none for a packet that was lost entirely.
    fn deliver(&mut self, packet: RawPacket, decoded: Decoded) -> Option<Packet> {
        let RawPacket { stream, index, offset, payload, .. } = packet;
        self.spare.push(payload);
        self.losses.events += decoded.lost_events;
        self.losses.frames += u64::from(decoded.content.is_none());
        if let Some(reason) = decoded.reason {
            let place = || format!("byte {offset}, packet {index} of stream {stream}: {reason}");
            self.losses.first.get_or_insert_with(place);
        }
        let content = decoded.content?;
        self.losses.unknown_packets += u64::from(matches!(content, Content::Unknown { .. }));
        Some(Packet { stream, index, offset, content })
    }

    /// Counts a packet that cannot be decoded; the next one is where its length states.
    fn pass_over(&mut self, packet: RawPacket, expected: &str, found: &str) {
        let RawPacket { stream, index, offset, .. } = packet;
        self.losses.damaged_packets += 1;
        let what = || {
            format!(
                "byte {offset}, packet {index} of stream {stream}: expected {expected}, found {found}"
            )
        };
        self.losses.first_damage.get_or_insert_with(what);
    }
}

impl<R: Read> Iterator for Reader<R> {
    type Item = Result<Packet, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_over {
            let Some(job) = self.ready.pop_front() else {
                match self.ending.take_if(|_| self.ahead.is_empty()) {
                    None => self.fill(),
                    Some(end) => {
                        self.is_over = true;
                        return end.err().map(Err);
                    }
                }
                continue;
            };
            let mut job = job;
            if let Some(damage) = job.packet.damage_before.take() {
                self.losses.damaged_packets += 1;
                self.losses.first_damage.get_or_insert(damage);
            }
            if matches!(job.decoded, Err(DecodeFailure::TooLarge)) {
                job.decode(&self.streams, self.framing.compression(), MAX_PACKET_BYTES);
            }
            let DecodeJob { packet, decoded, .. } = job;
            match decoded {
                Ok(decoded) => {
                    if let Some(packet) = self.deliver(packet, decoded) {
                        return Some(Ok(packet));
                    }
                }
                Err(DecodeFailure::TooLarge) => {
                    let expected = format!("at most {MAX_PACKET_BYTES} bytes once decompressed");
                    self.pass_over(packet, &expected, "more than that");
                }
                Err(DecodeFailure::Damaged(expected, found)) => {
                    self.pass_over(packet, &expected, &found);
                }
            }
        }
        None
    }
}

fn decode_packet(
    packet: &RawPacket,
    streams: &[StreamHeader],
    compression: Compression,
    limit: usize,
    spare: Events,
) -> Result<Decoded, DecodeFailure> {
    let Some(stream) = streams.iter().find(|stream| stream.id == packet.stream) else {
        let expected = "a packet of a stream that the header describes".to_owned();
        return Err(DecodeFailure::Damaged(expected, format!("one of stream {}", packet.stream)));
    };
    if let PayloadKind::Other(kind) = &stream.kind {
        return Ok(Decoded::whole(Content::Unknown { kind: kind.clone() }));
    }
    decompress(compression, &packet.payload, limit, |payload| decode(&stream.kind, payload, spare))
        .map_err(|error| match error {
            DecompressFailure::TooLarge => DecodeFailure::TooLarge,
            DecompressFailure::Damaged(found) => {
                DecodeFailure::Damaged(format!("{} data", compression.name()), found)
            }
        })?
        .map_err(|found| {
            DecodeFailure::Damaged(format!("a {} flatbuffer", stream.kind.identifier()), found)
        })
}
