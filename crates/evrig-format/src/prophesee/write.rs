//! Writes EVT 3.0.

use super::evt3::{ADDRESS_X, ADDRESS_Y, TIME_HIGH, TIME_LOW};
use crate::BLOCK_BYTES;
use evrig_core::event::{Event, EventSlice};
use evrig_core::geometry::Size;
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// Columns and rows have 11 bits.
pub const MAX_EVT3_SIDE: u16 = 1 << 11;

/// Encodes events as words.
#[derive(Debug, Default)]
pub(crate) struct Evt3Encoder {
    /// The upper and the lower half of the time that were written last.
    time: Option<(i64, i64)>,
    y: Option<u16>,
}

impl Evt3Encoder {
    /// Appends the words of an event, whose time must not be before the last one.
    pub(crate) fn push(&mut self, event: Event, words: &mut Vec<u8>) {
        let mut put = |kind: u16, value: u16| words.extend(((kind << 12) | value).to_le_bytes());
        let (high, low) = (event.t >> 12, event.t & 0xfff);
        let from = self.time.map_or(high - 1, |(last, _)| last);
        // Every value of the upper half, as cameras send them: faery counts its wraps only so. An hour
        // without events has 1.8 MB.
        (from + 1..=high).for_each(|reached| put(TIME_HIGH, (reached & 0xfff) as u16));
        if high > from || self.time != Some((high, low)) {
            put(TIME_LOW, low as u16);
        }
        if self.y != Some(event.y) {
            put(ADDRESS_Y, event.y);
        }
        put(ADDRESS_X, event.x | (u16::from(event.on) << 11));
        (self.time, self.y) = (Some((high, low)), Some(event.y));
    }
}

/// Writes a `.raw` file of events in ascending time on a sensor of at most 2048 x 2048 pixels. Times
/// that do not begin in the first 16.8 s are written from 0, with the first one as `t0` in the header,
/// which faery and evrig add.
///
/// # Errors
/// When the file cannot be written.
pub fn write_evt3(path: &Path, events: EventSlice<'_>, size: Size) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    let first = events.t.first().copied().unwrap_or(0);
    let t0 = if (0..1 << 24).contains(&first) { 0 } else { first };
    let Size { width, height } = size;
    writeln!(file, "% evt 3.0\n% format EVT3;height={height};width={width}")?;
    writeln!(file, "% geometry {width}x{height}")?;
    if t0 != 0 {
        writeln!(file, "% t0 {t0}")?;
    }
    file.write_all(b"% end\n")?;
    let mut encoder = Evt3Encoder::default();
    let mut words = Vec::with_capacity(BLOCK_BYTES);
    for event in events.iter() {
        encoder.push(Event { t: event.t - t0, ..event }, &mut words);
        if words.len() >= BLOCK_BYTES {
            file.write_all(&words)?;
            words.clear();
        }
    }
    file.write_all(&words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraEvents;
    use evrig_core::event::Events;

    #[test]
    fn what_is_written_is_read_back_over_pauses_of_hours() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.raw");
        for start in [0, 4_095, -70, 1_700_000_000_000_000] {
            let steps = [0, 0, 1, 4_096, 1 << 23, 1 << 24, 1 << 25, 3_600_000_000, 5];
            let mut t = start;
            let events: Events = (0..900_u16)
                .map(|i| {
                    t += steps[usize::from(i) % steps.len()];
                    Event { t, x: i * 2 % 1280, y: i / 3 % 720, on: i % 5 < 2 }
                })
                .collect();
            write_evt3(&path, events.as_slice(), Size::new(1280, 720)).unwrap();
            let read = |sink: &mut crate::RecordingSink<'_>| super::super::read(&path, sink);
            let found = CameraEvents::gather(&path, None, read).unwrap();
            assert!(found.events == events, "{start}");
            assert_eq!(found.size, Some(Size::new(1280, 720)));
            assert_eq!((found.left_out, found.damage), (Vec::new(), None));
        }
    }
}
