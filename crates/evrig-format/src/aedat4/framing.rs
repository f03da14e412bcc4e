//! Packets as bytes, in file order, and how a source ends.

use super::compression::decompress;
use super::error::{FilePosition, ReadError};
use super::header::{self, Header, MAGIC, MAX_HEADER_BYTES};
use super::memory::DecompressFailure;
use super::resync::{PacketSignature, find_packet};
use super::{Compression, MAX_PACKET_BYTES, table};
use std::io::{self, Read};

/// Advice for a file that was cut.
const CUT: &str =
    "the file was cut, what came before is complete; copy it again if the original is longer";
/// Advice for a file whose bytes changed.
const DAMAGED: &str =
    "the file is damaged here, what came before is complete; copy it again or continue with that";
/// Advice for a file that is no AEDAT4.
const OTHER_FORMAT: &str = "give a file that DV, dv-processing or evrig wrote";

/// Bytes asked for at first; a declared length is believed only as far as bytes arrive.
const FIRST_STEP: usize = 1 << 20;

/// One packet, not yet decompressed.
#[derive(Debug)]
pub(super) struct RawPacket {
    pub(super) stream: u32,
    pub(super) index: u64,
    pub(super) offset: u64,
    pub(super) payload: Vec<u8>,
    /// Description of the damage that was passed over to reach it.
    pub(super) damage_before: Option<String>,
}

/// Cuts a source into packets.
#[derive(Debug)]
pub(super) struct Framing<R> {
    source: R,
    name: String,
    offset: u64,
    n_packets: u64,
    /// Length of the source, where it is a file.
    n_bytes: Option<u64>,
    table_position: Option<u64>,
    compression: Compression,
    /// Whether the header was read.
    is_in_packets: bool,
    /// Read ahead in search of a packet, and not yet used.
    pending: Vec<u8>,
    /// By which packets are found behind damage; none on a socket.
    signature: Option<PacketSignature>,
    n_damaged: u64,
}

impl<R: Read> Framing<R> {
    /// Reads the magic (of a file) and the header.
    pub(super) fn start(
        source: R,
        name: &str,
        n_bytes: Option<u64>,
        has_magic: bool,
    ) -> Result<(Self, Header), ReadError> {
        let mut framing = Self {
            source,
            name: name.to_owned(),
            offset: 0,
            n_packets: 0,
            n_bytes,
            table_position: None,
            compression: Compression::None,
            is_in_packets: false,
            pending: Vec::new(),
            signature: None,
            n_damaged: 0,
        };
        if has_magic {
            framing.read_magic()?;
        }
        let header = framing.read_header()?;
        // A socket has no positions.
        framing.table_position = header.table_position.filter(|_| has_magic);
        framing.compression = header.compression;
        let streams = header.streams.iter().map(|stream| stream.id).collect();
        framing.signature =
            has_magic.then_some(PacketSignature { compression: header.compression, streams });
        framing.is_in_packets = true;
        Ok((framing, header))
    }

    fn read_magic(&mut self) -> Result<(), ReadError> {
        let expected = format!("\"{}\", the first bytes of AEDAT4", MAGIC.escape_ascii());
        let mut bytes = Vec::new();
        self.read(MAGIC.len(), &mut bytes, None)?;
        if bytes == MAGIC {
            self.offset = MAGIC.len() as u64;
            return Ok(());
        }
        let found = match bytes.len() {
            0 => "an empty file".to_owned(),
            _ => format!("\"{}\"", bytes.escape_ascii()),
        };
        Err(self.malformed(None, expected, found, OTHER_FORMAT))
    }

    fn read_header(&mut self) -> Result<Header, ReadError> {
        let expected = || "a header with a description of the streams".to_owned();
        let mut bytes = Vec::new();
        self.read(4, &mut bytes, None)?;
        let Ok(length) = <[u8; 4]>::try_from(bytes.as_slice()) else {
            return Err(self.malformed(None, expected(), ends_after(bytes.len()), CUT));
        };
        let length = u32::from_le_bytes(length) as usize;
        if length > MAX_HEADER_BYTES {
            let found =
                format!("a header of {length} bytes, above the limit of {MAX_HEADER_BYTES}");
            return Err(self.malformed(None, expected(), found, DAMAGED));
        }
        self.read_more(length, &mut bytes, None)?;
        if bytes.len() < 4 + length {
            let expected = format!("a header of {length} bytes");
            return Err(self.malformed(None, expected, ends_after(bytes.len() - 4), CUT));
        }
        let header = header::parse(&bytes)
            .map_err(|found| self.malformed(None, expected(), found, DAMAGED))?;
        self.offset += 4 + length as u64;
        Ok(header)
    }

    /// The next packet; none at a clean end. Behind a packet whose length is damaged the next one is
    /// sought.
    pub(super) fn next(&mut self, payload: Vec<u8>) -> Result<Option<RawPacket>, ReadError> {
        match self.next_in_place(payload).map_err(|failed| *failed) {
            Err((error @ ReadError::Malformed { .. }, consumed)) if !consumed.is_empty() => {
                if !self.find_next(consumed)? {
                    return Err(error);
                }
                self.n_damaged += 1;
                let name = format!("{}: ", self.name);
                let damage = error.to_string().replacen(&name, "", 1);
                let next = self.next_in_place(Vec::new()).map_err(|failed| failed.0)?;
                Ok(next.map(|packet| RawPacket { damage_before: Some(damage), ..packet }))
            }
            other => other.map_err(|(error, _)| error),
        }
    }

    /// Seeks a packet in `consumed`, which was read from the current offset on, and behind it.
    fn find_next(&mut self, consumed: Vec<u8>) -> Result<bool, ReadError> {
        let Some(signature) = self.signature.take() else { return Ok(false) };
        let mut window = consumed;
        // The damaged packet begins here: the next one begins later.
        let mut start = 1;
        let end = self.table_position.or(self.n_bytes).unwrap_or(u64::MAX);
        let found = loop {
            let base = self.offset;
            let fits = |at: usize, length: u64| base + at as u64 + 8 + length <= end;
            if let Some(at) = find_packet(&window[start..], &signature) {
                let length = signature.length_at(&window[start + at..]);
                if fits(start + at, length) {
                    break Some(start + at);
                }
                start += at + 1;
                continue;
            }
            // A head and the first bytes of its payload may lie across the border of two windows.
            let keep = window.len().saturating_sub(PacketSignature::BYTES).max(start);
            window.drain(..keep.min(window.len()));
            self.offset += keep as u64;
            start = 0;
            let n_before = window.len();
            let mut more = Vec::new();
            self.read(FIRST_STEP, &mut more, None)?;
            window.extend(more);
            if window.len() == n_before {
                break None;
            }
        };
        self.signature = Some(signature);
        let Some(at) = found else { return Ok(false) };
        self.offset += at as u64;
        window.drain(..at);
        window.extend(std::mem::take(&mut self.pending));
        self.pending = window;
        Ok(true)
    }

    /// The next packet; with an error, the bytes that were read of it.
    fn next_in_place(
        &mut self,
        payload: Vec<u8>,
    ) -> Result<Option<RawPacket>, Box<(ReadError, Vec<u8>)>> {
        let without = |error| Box::new((error, Vec::new()));
        if self.table_position == Some(self.offset) {
            return self.check_table().map(|()| None).map_err(without);
        }
        let mut payload = payload;
        self.read(8, &mut payload, None).map_err(without)?;
        let Some((&head, [])) = payload.split_first_chunk::<8>() else {
            return self.end_after(payload.len()).map(|()| None).map_err(without);
        };
        let word = u64::from_le_bytes(head);
        let (stream, length) = (word as u32, (word >> 32) as usize);
        self.check_length(stream, length as u64)
            .map_err(|error| Box::new((error, head.to_vec())))?;
        if self.signature.as_ref().is_some_and(|known| !known.streams.contains(&stream)) {
            let expected = "a packet of a stream that the header describes".to_owned();
            let found = format!("one of stream {stream}");
            let error = self.malformed(Some(stream), expected, found, DAMAGED);
            return Err(Box::new((error, head.to_vec())));
        }
        self.read(length, &mut payload, Some(stream)).map_err(without)?;
        if payload.len() < length {
            let expected = format!("a packet of {length} bytes");
            let found = ends_after(payload.len());
            let error = self.malformed(Some(stream), expected, found, CUT);
            return Err(Box::new((error, [&head[..], &payload].concat())));
        }
        let packet = RawPacket {
            stream,
            index: self.n_packets,
            offset: self.offset,
            payload,
            damage_before: None,
        };
        self.offset += 8 + length as u64;
        self.n_packets += 1;
        Ok(Some(packet))
    }

    /// Whether a source may end here, after `n` bytes of a packet's head.
    fn end_after(&self, n: usize) -> Result<(), ReadError> {
        match self.table_position {
            None if n == 0 => Ok(()),
            None => {
                let expected = "a packet's stream and length, 8 bytes".to_owned();
                Err(self.malformed(None, expected, ends_after(n), CUT))
            }
            Some(position) => {
                let expected = format!("packets up to the data table at byte {position}");
                Err(self.malformed(None, expected, ends_after(n), CUT))
            }
        }
    }

    fn check_length(&self, stream: u32, length: u64) -> Result<(), ReadError> {
        let end = self.offset + 8 + length;
        let declared = format!("a packet of {length} bytes");
        if length > MAX_PACKET_BYTES as u64 {
            let expected = format!("a packet of at most {MAX_PACKET_BYTES} bytes");
            return Err(self.malformed(Some(stream), expected, declared, DAMAGED));
        }
        if let Some(position) = self.table_position.filter(|&position| end > position) {
            let expected = format!("a packet that ends before the data table at byte {position}");
            return Err(self.malformed(Some(stream), expected, declared, DAMAGED));
        }
        if let Some(n_bytes) = self.n_bytes.filter(|&n_bytes| end > n_bytes) {
            let found = ends_after(n_bytes.saturating_sub(self.offset + 8) as usize);
            return Err(self.malformed(Some(stream), declared, found, CUT));
        }
        Ok(())
    }

    /// The data table must be complete: it distinguishes a closed file from a truncated one.
    fn check_table(&mut self) -> Result<(), ReadError> {
        let mut raw = Vec::new();
        self.read(MAX_PACKET_BYTES, &mut raw, None)?;
        let count = decompress(self.compression, &raw, MAX_PACKET_BYTES, table::count)
            .map_err(DecompressFailure::into_text)
            .and_then(|count| count);
        let expected = || format!("the data table of {} packets", self.n_packets);
        match count {
            // Packets that were passed over are in the table.
            Ok(n) if n as u64 == self.n_packets || self.n_damaged > 0 => Ok(()),
            Ok(n) => {
                let found = format!("a data table of {n} packets");
                Err(self.malformed(None, expected(), found, DAMAGED))
            }
            Err(found) => {
                let found = format!("{found} ({} bytes to the end)", raw.len());
                Err(self.malformed(None, expected(), found, CUT))
            }
        }
    }

    /// Reads up to `n` bytes; fewer mean the source ended.
    fn read(
        &mut self,
        n: usize,
        bytes: &mut Vec<u8>,
        stream: Option<u32>,
    ) -> Result<(), ReadError> {
        bytes.clear();
        self.read_more(n, bytes, stream)
    }

    fn read_more(
        &mut self,
        n: usize,
        bytes: &mut Vec<u8>,
        stream: Option<u32>,
    ) -> Result<(), ReadError> {
        bytes.reserve(n.min(FIRST_STEP));
        let n_pending = n.min(self.pending.len());
        bytes.extend(self.pending.drain(..n_pending));
        let n = n - n_pending;
        let read = self.source.by_ref().take(n as u64).read_to_end(bytes);
        read.map(|_| ()).map_err(|source| self.failed(stream, source))
    }

    fn failed(&self, stream: Option<u32>, source: io::Error) -> ReadError {
        ReadError::Io { place: self.place(stream), source }
    }

    fn malformed(
        &self,
        stream: Option<u32>,
        expected: String,
        found: String,
        advice: &'static str,
    ) -> ReadError {
        ReadError::Malformed { place: self.place(stream), expected, found, advice }
    }

    fn place(&self, stream: Option<u32>) -> FilePosition {
        let packet = self.is_in_packets.then_some(self.n_packets);
        FilePosition { name: self.name.clone(), offset: self.offset, packet, stream }
    }

    pub(super) fn compression(&self) -> Compression {
        self.compression
    }
}

fn ends_after(n: usize) -> String {
    format!("the end after {n} bytes")
}
