//! AEDAT 2.0, the format of jAER and of v2e: pairs of an address and a time, 32 bits each,
//! big-endian, behind lines that begin with `#`.
//!
//! The address depends on the chip, which the header names. Rows and columns count from the corner
//! opposite to that of images. Layouts: <https://docs.inivation.com> (file formats, AEDAT 2.0).

use crate::{CameraEvents, CameraFileError};
use evrig_core::event::Event;
use evrig_core::geometry::Size;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Bytes of an address and its time.
const PAIR_BYTES: usize = 8;

/// Pairs decoded at once.
const PAIRS_PER_BLOCK: usize = 1 << 17;

/// How an address is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AddressLayout {
    /// Bit 31: not an event; 9 bits of y, 10 of x, polarity, a special event.
    Davis,
    /// 7 bits of y, 7 of x, polarity (reversed).
    Dvs128,
}

/// Whether the first bytes of a file are those of AEDAT 2.0, or of 1.0 without a version.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(b"#!AER-DAT2")
}

/// Reads the events of a file. `size` replaces the size of the chip that the header names.
///
/// # Errors
/// When the file cannot be read, or neither the header nor `size` tells the chip.
pub fn read_events(path: &Path, size: Option<Size>) -> Result<CameraEvents, CameraFileError> {
    let io = CameraFileError::io;
    let mut reader = BufReader::with_capacity(1 << 20, File::open(path).map_err(io(path))?);
    let mut header = String::new();
    while reader.fill_buf().map_err(io(path))?.first() == Some(&b'#') {
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line).map_err(io(path))?;
        header.push_str(&String::from_utf8_lossy(&line).to_lowercase());
    }
    let (layout, stated) = chip(&header);
    let (Some(layout), Some(size)) = (layout.or(size.map(layout_of)), size.or(stated)) else {
        let what = "has a header that names no chip that is known; give the sensor's --size";
        return Err(CameraFileError::format(path, what));
    };
    let mut found = CameraEvents { size: Some(size), ..CameraEvents::default() };
    found.decisions.push(format!("addresses are those of a {layout:?} of {size} pixels"));
    let mut clock = WrappingClock::default();
    let mut block = Vec::new();
    loop {
        block.clear();
        let n_bytes = (PAIRS_PER_BLOCK * PAIR_BYTES) as u64;
        let n = reader.by_ref().take(n_bytes).read_to_end(&mut block).map_err(io(path))?;
        decode(&block, layout, size, &mut clock, &mut found);
        if (n as u64) < n_bytes {
            let n_left = n % PAIR_BYTES;
            let cut = || format!("the file is cut: {n_left} bytes of a last event were left out");
            found.damage = (n_left > 0).then(cut);
            return Ok(found);
        }
    }
}

/// The chip that a header names.
fn chip(header: &str) -> (Option<AddressLayout>, Option<Size>) {
    let known = [
        ("davis346", AddressLayout::Davis, Size::new(346, 260)),
        ("davis240", AddressLayout::Davis, Size::new(240, 180)),
        ("davis640", AddressLayout::Davis, Size::new(640, 480)),
        ("dvs128", AddressLayout::Dvs128, Size::new(128, 128)),
        ("tmpdiff128", AddressLayout::Dvs128, Size::new(128, 128)),
    ];
    let found = known.into_iter().find(|(name, ..)| header.contains(name));
    found.map_or((None, None), |(_, layout, size)| (Some(layout), Some(size)))
}

fn layout_of(size: Size) -> AddressLayout {
    if size == Size::new(128, 128) { AddressLayout::Dvs128 } else { AddressLayout::Davis }
}

/// Times of 32 bits, which wrap after 36 or 72 minutes.
#[derive(Debug, Default)]
struct WrappingClock {
    last: Option<u32>,
    n_wraps: i64,
}

impl WrappingClock {
    fn at(&mut self, t: u32) -> i64 {
        let is_wrap = self.last.is_some_and(|last| last > t && last - t > u32::MAX / 2);
        self.n_wraps += i64::from(is_wrap);
        self.last = Some(t);
        (self.n_wraps << 32) + i64::from(t)
    }
}

fn decode(
    block: &[u8],
    layout: AddressLayout,
    size: Size,
    clock: &mut WrappingClock,
    found: &mut CameraEvents,
) {
    let (mut n_samples, mut n_special) = (0, 0);
    for pair in block.chunks_exact(PAIR_BYTES) {
        let word = |at: usize| {
            pair[at..at + 4].iter().fold(0_u32, |bits, byte| (bits << 8) | u32::from(*byte))
        };
        let (address, t) = (word(0), word(4));
        let (x, y, on) = match layout {
            AddressLayout::Davis if address >> 31 == 1 => {
                n_samples += 1;
                continue;
            }
            AddressLayout::Davis if address & 0x400 != 0 => {
                n_special += 1;
                continue;
            }
            AddressLayout::Davis => {
                ((address >> 12) & 0x3ff, (address >> 22) & 0x1ff, address & 0x800 != 0)
            }
            AddressLayout::Dvs128 if address & 0x8000 != 0 => {
                n_special += 1;
                continue;
            }
            AddressLayout::Dvs128 => {
                ((address >> 1) & 0x7f, (address >> 8) & 0x7f, address & 1 == 0)
            }
        };
        // An address off the chip stays off it.
        let mirror = |v: u32, side: u16| u32::from(side).checked_sub(v + 1).map_or(v, |v| v) as u16;
        let (x, y) = (mirror(x, size.width), mirror(y, size.height));
        found.events.push(Event { t: clock.at(t), x, y, on });
    }
    found.leave_out("samples of frames and inertial units", n_samples);
    found.leave_out("special events", n_special);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(header: &str, pairs: &[[u32; 2]], size: Option<Size>) -> Result<CameraEvents, String> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.aedat");
        let words = pairs.iter().flatten().flat_map(|word| word.to_be_bytes());
        let bytes: Vec<u8> = header.bytes().chain(words).collect();
        std::fs::write(&path, bytes).unwrap();
        read_events(&path, size).map_err(|error| error.to_string())
    }

    #[test]
    fn davis_addresses_count_from_the_opposite_corner() {
        let address = |x: u32, y: u32, on: u32| (y << 22) | (x << 12) | (on << 11);
        let pairs = [
            [address(345, 259, 1), 10],
            [address(0, 0, 0), u32::MAX],
            [1 << 31, 5],
            [address(1, 2, 1), 7],
        ];
        let header = "#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346\r\n";
        let found = read(header, &pairs, None).unwrap();
        let rows: Vec<(i64, u16, u16, bool)> =
            found.events.as_slice().iter().map(|e| (e.t, e.x, e.y, e.on)).collect();
        let wrapped = (1 << 32) + 7;
        let expected =
            [(10, 0, 0, true), (u32::MAX.into(), 345, 259, false), (wrapped, 344, 257, true)];
        assert_eq!(rows, expected);
        assert_eq!(found.left_out[0].1, 1);
    }

    #[test]
    fn a_chip_that_is_not_named_is_asked_for() {
        let error = read("#!AER-DAT2.0\r\n", &[[0, 0]], None).unwrap_err();
        assert!(error.contains("--size"), "{error}");
        let found = read("#!AER-DAT2.0\r\n", &[[0x0102, 3]], Some(Size::new(128, 128))).unwrap();
        let event = found.events.as_slice().iter().next().unwrap();
        assert_eq!((event.x, event.y, event.on), (126, 126, true));
    }
}
