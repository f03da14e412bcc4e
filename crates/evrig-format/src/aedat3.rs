//! AEDAT 3.1, the format of cAER and libcaer: packets of one kind of event each, little-endian.
//!
//! Layout: <https://docs.inivation.com> (file formats, AEDAT 3.1).

use crate::{CameraEvents, CameraFileError};
use evrig_core::event::Event;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Kind, source, size, time offset, overflow, capacity, number, valid.
const PACKET_HEADER_BYTES: usize = 28;

/// Packets of more bytes are damage.
const MAX_PACKET_BYTES: u64 = 1 << 28;

const POLARITY_KIND: u16 = 1;

/// Names of the other kinds of events, by number.
const KINDS: [&str; 5] =
    ["special events", "events", "frames", "inertial samples", "inertial samples"];

/// Whether the first bytes of a file are those of AEDAT 3.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(b"#!AER-DAT3")
}

/// Reads the events of a file, up to a cut.
///
/// # Errors
/// When the file cannot be read.
pub fn read_events(path: &Path) -> Result<CameraEvents, CameraFileError> {
    let io = CameraFileError::io;
    let mut reader = BufReader::with_capacity(1 << 20, File::open(path).map_err(io(path))?);
    let mut line = Vec::new();
    loop {
        line.clear();
        reader.read_until(b'\n', &mut line).map_err(io(path))?;
        if line.starts_with(b"#!END-HEADER") {
            break;
        }
        if line.is_empty() || line[0] != b'#' {
            let what = "has no end of its header; expected a line `#!END-HEADER`";
            return Err(CameraFileError::format(path, what));
        }
    }
    let mut found = CameraEvents::default();
    for packet in 0_u64.. {
        let mut header = Vec::new();
        let n = PACKET_HEADER_BYTES as u64;
        reader.by_ref().take(n).read_to_end(&mut header).map_err(io(path))?;
        if header.is_empty() {
            break;
        }
        if header.len() < PACKET_HEADER_BYTES {
            found.damage = Some(format!("the file is cut in the header of packet {packet}"));
            break;
        }
        let kind = u16::from_le_bytes([header[0], header[1]]);
        let [size, overflow, number] = [4, 12, 20].map(|at| u64::from(word(&header, at)));
        let n_bytes = size.saturating_mul(number);
        if size < 8 || n_bytes > MAX_PACKET_BYTES {
            found.damage = Some(format!("packet {packet} claims {number} events of {size} bytes"));
            break;
        }
        let mut body = Vec::new();
        reader.by_ref().take(n_bytes).read_to_end(&mut body).map_err(io(path))?;
        if kind == POLARITY_KIND && size == 8 {
            decode(&body, overflow, &mut found);
        } else {
            let name = KINDS.get(usize::from(kind)).copied().unwrap_or("events of other kinds");
            found.leave_out(name, number);
        }
        if (body.len() as u64) < n_bytes {
            found.damage = Some(format!("the file is cut in packet {packet}"));
            break;
        }
    }
    Ok(found)
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4].iter().rev().fold(0, |bits, byte| (bits << 8) | u32::from(*byte))
}

fn decode(body: &[u8], overflow: u64, found: &mut CameraEvents) {
    let mut n_invalid = 0;
    for event in body.chunks_exact(8) {
        let (data, t) = (word(event, 0), word(event, 4));
        if data & 1 == 0 {
            n_invalid += 1;
            continue;
        }
        let t = ((overflow as i64) << 31) + i64::from(t & 0x7fff_ffff);
        let (x, y) = ((data >> 17) as u16, ((data >> 2) & 0x7fff) as u16);
        found.events.push(Event { t, x, y, on: data & 2 != 0 });
    }
    found.leave_out("events that a filter of the camera's program marked as invalid", n_invalid);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(kind: u16, overflow: u32, events: &[[u32; 2]]) -> Vec<u8> {
        let n = events.len() as u32;
        let words = [8, 4, overflow, n, n, n];
        let head = [kind.to_le_bytes(), 1_u16.to_le_bytes()].concat();
        let words = words.iter().chain(events.iter().flatten()).flat_map(|w| w.to_le_bytes());
        head.into_iter().chain(words).collect()
    }

    #[test]
    fn polarity_packets_are_read_up_to_a_cut() {
        let event = |x: u32, y: u32, on: u32| (x << 17) | (y << 2) | (on << 1) | 1;
        let mut bytes = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#!END-HEADER\r\n".to_vec();
        bytes.extend(packet(1, 0, &[[event(345, 259, 1), 10], [0, 11]]));
        bytes.extend(packet(0, 0, &[[3, 12]]));
        bytes.extend(packet(1, 1, &[[event(1, 2, 0), 5], [event(9, 9, 0), 6]]));
        bytes.truncate(bytes.len() - 3);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        std::fs::write(&path, &bytes).unwrap();
        let found = read_events(&path).unwrap();
        let rows: Vec<(i64, u16, u16, bool)> =
            found.events.as_slice().iter().map(|e| (e.t, e.x, e.y, e.on)).collect();
        assert_eq!(rows, [(10, 345, 259, true), ((1 << 31) + 5, 1, 2, false)]);
        assert_eq!(found.left_out.len(), 2);
        assert!(found.damage.unwrap().contains("cut in packet 2"));
    }
}
