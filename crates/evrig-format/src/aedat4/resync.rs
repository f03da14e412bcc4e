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

#[cfg(test)]
mod tests {
    use crate::aedat4::{Compression, Content, Reader, StreamSpec, Writer};
    use evrig_core::event::{Event, Events};
    use evrig_core::geometry::Size;

    const N_PACKETS: usize = 9;

    /// A closed file of packets of 500 events each, and where its packets begin.
    fn file(compression: Compression) -> (Vec<u8>, Vec<usize>) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat4");
        let specs = [StreamSpec::events(Size::new(64, 48), "DAVIS346_0")];
        let mut writer = Writer::create(&path, compression, &specs).unwrap();
        for k in 0..N_PACKETS as i64 {
            let event = |i: i64| Event {
                t: k * 50_000 + i * 97,
                x: (i * 31 % 64) as u16,
                y: (i * 17 % 48) as u16,
                on: i % 3 == 0,
            };
            let events: Events = (0..500).map(event).collect();
            writer.write_events(0, events.as_slice()).unwrap();
        }
        writer.finish().unwrap();
        let starts = Reader::open(&path).unwrap().map(|p| p.unwrap().offset as usize).collect();
        (std::fs::read(&path).unwrap(), starts)
    }

    /// Packets of events read, damaged packets, and whether reading ended with an error.
    fn drain(bytes: &[u8]) -> (usize, u64, bool) {
        let mut reader = Reader::new(bytes, "file").unwrap();
        let packets: Vec<_> = reader.by_ref().collect();
        let is_events = |p: &Content| matches!(p, Content::Events(events) if events.len() == 500);
        let n = packets.iter().flatten().filter(|packet| is_events(&packet.content)).count();
        (n, reader.losses().damaged_packets, packets.iter().any(Result::is_err))
    }

    #[test]
    fn reading_goes_on_behind_a_damaged_head_or_payload() {
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
            let (whole, starts) = file(compression);
            assert_eq!(starts.len(), N_PACKETS);
            assert_eq!(drain(&whole), (N_PACKETS, 0, false));
            // Stream, length, and the first bytes of the payload.
            for place in [0, 4, 8] {
                let mut damaged = whole.clone();
                damaged[starts[4] + place..][..8].fill(0xff);
                assert_eq!(drain(&damaged), (N_PACKETS - 1, 1, false), "{compression:?} {place}");
            }
            let (n, n_damaged, has_error) = drain(&whole[..starts[6] + 30]);
            assert_eq!((n, n_damaged, has_error), (6, 0, true), "{compression:?}");
        }
    }
}
