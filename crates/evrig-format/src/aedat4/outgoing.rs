//! A packet to be written: header and payload in one buffer, which is reused.

use super::compression::{Compression, compress, with_scratch};
use super::encode;
use evrig_core::event::EventSlice;
use std::io;

/// Bytes of a packet's stream and length, before its payload.
pub(super) const HEAD_BYTES: usize = 8;

/// One packet, ready to be written.
#[derive(Debug, Default)]
pub(super) struct PacketBuffer {
    /// Head and payload; may be longer than the packet, because growing clears memory.
    bytes: Vec<u8>,
    /// Bytes of the packet.
    n_bytes: usize,
    pub(super) n_elements: usize,
    pub(super) span_us: [i64; 2],
}

impl PacketBuffer {
    /// Takes a run of events; their coordinates must be below 32,768.
    pub(super) fn take_events(
        &mut self,
        compression: Compression,
        run: EventSlice<'_>,
    ) -> io::Result<()> {
        self.n_bytes = match compression {
            Compression::None => encode::events(run, &mut self.bytes, HEAD_BYTES),
            _ => with_scratch(|plain| {
                let n = encode::events(run, plain, 0);
                compress(compression, &plain[..n], &mut self.bytes, HEAD_BYTES)
            })?,
        };
        self.n_elements = run.len();
        self.span_us = span(run.t.iter().copied());
        Ok(())
    }

    /// Takes a payload.
    pub(super) fn take_payload(
        &mut self,
        compression: Compression,
        payload: &[u8],
        n_elements: usize,
        span_us: [i64; 2],
    ) -> io::Result<()> {
        self.n_bytes = compress(compression, payload, &mut self.bytes, HEAD_BYTES)?;
        (self.n_elements, self.span_us) = (n_elements, span_us);
        Ok(())
    }

    /// Bytes of the payload.
    pub(super) fn payload_bytes(&self) -> u32 {
        self.n_bytes.saturating_sub(HEAD_BYTES) as u32
    }

    /// The packet as written to a file.
    pub(super) fn finish(&mut self, stream: u32) -> &[u8] {
        let length = self.payload_bytes();
        if let Some((head, _)) = self.bytes.split_first_chunk_mut::<HEAD_BYTES>() {
            *head = (u64::from(length) << 32 | u64::from(stream)).to_le_bytes();
        }
        &self.bytes[..self.n_bytes]
    }
}

/// Earliest and latest of some times, zeros for none.
pub(super) fn span(times: impl Iterator<Item = i64> + Clone) -> [i64; 2] {
    [times.clone().min().unwrap_or_default(), times.max().unwrap_or_default()]
}
