//! Finding the next packet behind a damaged one.

use super::{Compression, MAX_PACKET_BYTES};

/// What every packet of a file begins with.
#[derive(Debug)]
pub(super) struct PacketSignature {
    pub(super) compression: Compression,
    pub(super) streams: Vec<u32>,
}

impl PacketSignature {
    /// Bytes of a packet's head and of the part of its payload that is compared.
    pub(super) const BYTES: usize = 20;

    /// The length that the head at the beginning of `bytes` states.
    pub(super) fn length_at(&self, bytes: &[u8]) -> u64 {
        word(bytes, 4).unwrap_or(u32::MAX).into()
    }

    fn is_at(&self, bytes: &[u8]) -> bool {
        let (Some(stream), Some(length)) = (word(bytes, 0), word(bytes, 4)) else { return false };
        let payload = &bytes[8..];
        let begins = match self.compression {
            Compression::None => payload.get(8..12).is_some_and(|identifier| {
                [&b"EVTS"[..], b"FRME", b"IMUS", b"TRIG"].contains(&identifier)
            }),
            Compression::Lz4 => payload.starts_with(&[0x04, 0x22, 0x4d, 0x18]),
            Compression::Zstd => payload.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]),
        };
        begins
            && self.streams.contains(&stream)
            && (1..=MAX_PACKET_BYTES).contains(&(length as usize))
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// Where the first packet begins in `bytes`.
pub(super) fn find_packet(bytes: &[u8], signature: &PacketSignature) -> Option<usize> {
    (0..bytes.len().saturating_sub(8)).find(|at| signature.is_at(&bytes[*at..]))
}
