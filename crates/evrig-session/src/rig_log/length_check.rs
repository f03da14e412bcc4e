//! Checks the lengths of a chunk's records against the chunk's length, before the library subtracts
//! them.
//!
//! mcap 0.26 subtracts the length that a record claims from the rest of its chunk without
//! asking whether it fits; in a damaged file the difference is negative. Here every length is
//! checked on its way from the file to the library; reading ends at the first that does not fit.

use mcap::records::op;

/// Opcode and length, before every record.
const HEAD_BYTES: usize = 9;
/// A chunk's header before its records: two times, size, checksum, the name of its
/// compression (none: its length alone), size as stored.
const CHUNK_HEAD_BYTES: usize = 40;

/// A record that claims more than its chunk has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a record claims {claimed} bytes of a chunk that has {left} left")]
pub(super) struct Overrun {
    claimed: u64,
    left: u64,
}

/// What the next bytes are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    /// The head of a record of the file.
    Head,
    /// The head of a chunk in a record of so many bytes.
    ChunkHead(u64),
    /// The header of a record in a chunk with `left` bytes of records, and `behind` further bytes.
    Inner { left: u64, behind: u64 },
    /// What the library refuses itself: no further checks.
    Refused,
}

/// Checks the lengths in a file whose bytes come in pieces.
#[derive(Debug)]
pub(super) struct LengthCheck {
    part: Expected,
    /// Bytes that may pass before it.
    passing: u64,
    gathered: Vec<u8>,
}

impl Default for LengthCheck {
    fn default() -> Self {
        let magic = mcap::MAGIC.len() as u64;
        Self {
            part: Expected::Head,
            passing: magic,
            gathered: Vec::with_capacity(CHUNK_HEAD_BYTES),
        }
    }
}

impl LengthCheck {
    /// Checks the next bytes of the file.
    ///
    /// # Errors
    /// When a length does not fit; the library must not get these bytes.
    pub(super) fn check(&mut self, mut bytes: &[u8]) -> Result<(), Overrun> {
        while !bytes.is_empty() {
            let n = match self.part {
                Expected::Refused => return Ok(()),
                _ if self.passing > 0 => {
                    let n = usize::try_from(self.passing).unwrap_or(usize::MAX).min(bytes.len());
                    self.passing -= n as u64;
                    n
                }
                part => {
                    let wanted = match part {
                        Expected::ChunkHead(_) => CHUNK_HEAD_BYTES,
                        _ => HEAD_BYTES,
                    };
                    let n = (wanted - self.gathered.len()).min(bytes.len());
                    self.gathered.extend_from_slice(&bytes[..n]);
                    if self.gathered.len() == wanted {
                        self.part = self.advance(part)?;
                        self.gathered.clear();
                    }
                    n
                }
            };
            bytes = &bytes[n..];
        }
        Ok(())
    }

    /// Parses the collected header and returns what follows.
    fn advance(&mut self, part: Expected) -> Result<Expected, Overrun> {
        match part {
            Expected::Head => {
                let length = self.number(1);
                if self.gathered[0] == op::CHUNK {
                    return Ok(Expected::ChunkHead(length));
                }
                self.passing = length;
                Ok(Expected::Head)
            }
            Expected::ChunkHead(length) => {
                let is_compressed = self.gathered[28..32] != [0; 4];
                let stored = self.number(32);
                let behind = length.checked_sub(CHUNK_HEAD_BYTES as u64);
                let behind = behind.and_then(|records| records.checked_sub(stored));
                Ok(match behind {
                    Some(behind) if !is_compressed => self.inside(stored, behind),
                    _ => Expected::Refused,
                })
            }
            Expected::Inner { left, behind } => {
                let length = self.number(1);
                let claimed = length.saturating_add(HEAD_BYTES as u64);
                let left = left.checked_sub(claimed).ok_or(Overrun { claimed, left })?;
                self.passing = length;
                Ok(self.inside(left, behind))
            }
            Expected::Refused => Ok(Expected::Refused),
        }
    }

    fn inside(&mut self, left: u64, behind: u64) -> Expected {
        if left > 0 {
            return Expected::Inner { left, behind };
        }
        self.passing = self.passing.saturating_add(behind);
        Expected::Head
    }

    fn number(&self, at: usize) -> u64 {
        let bytes = self.gathered.get(at..).and_then(|bytes| bytes.first_chunk());
        bytes.map_or(0, |bytes| u64::from_le_bytes(*bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// A log of two chunks with two messages each.
    fn log() -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(64));
        let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
        let channel =
            writer.add_channel(0, "topic", "", &std::collections::BTreeMap::new()).unwrap();
        for sequence in 0..4 {
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence,
                log_time: 1,
                publish_time: 1,
            };
            writer.write_to_known_channel(&header, &[sequence as u8; 40]).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        bytes
    }

    fn passes(bytes: &[u8], piece: usize) -> Result<(), Overrun> {
        let mut fence = LengthCheck::default();
        bytes.chunks(piece).try_for_each(|bytes| fence.check(bytes))
    }

    /// Positions of the lengths of records in chunks.
    fn inner_lengths(bytes: &[u8]) -> Vec<usize> {
        let (mut at, mut found) = (mcap::MAGIC.len(), Vec::new());
        while at + HEAD_BYTES <= bytes.len() - mcap::MAGIC.len() {
            let length =
                |at: usize| u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
            if bytes[at] == op::CHUNK {
                let mut inner = at + HEAD_BYTES + CHUNK_HEAD_BYTES;
                while inner < at + HEAD_BYTES + length(at) {
                    found.push(inner + 1);
                    inner += HEAD_BYTES + length(inner);
                }
            }
            at += HEAD_BYTES + length(at);
        }
        found
    }

    #[test]
    fn a_whole_log_passes_in_pieces_of_any_size() {
        let log = log();
        assert!(inner_lengths(&log).len() >= 4);
        for piece in [1, 2, 7, 9, 40, 64, log.len()] {
            assert_eq!(passes(&log, piece), Ok(()));
        }
    }

    #[test]
    fn a_record_longer_than_what_is_left_of_its_chunk_is_stopped_before_its_data() {
        let log = log();
        for at in inner_lengths(&log) {
            for length in [u64::MAX, 1 << 40, 4_000] {
                let mut damaged = log.clone();
                damaged[at..at + 8].copy_from_slice(&length.to_le_bytes());
                let error = passes(&damaged, 3).unwrap_err();
                assert_eq!(error.claimed, length.saturating_add(9));
                assert!(error.left < 4_000, "{error}");
            }
        }
    }
}
