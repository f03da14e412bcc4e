//! Events as text.

use super::ExportError;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;

/// Text that is gathered before it is written: it stays in a core's cache.
const BLOCK_BYTES: usize = 1 << 18;

/// A line in seconds at its longest: a sign, 13 digits, the point, 6 digits, and 15 bytes after the
/// time.
const MAX_LINE_BYTES: usize = 36;

/// How an event is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LineLayout {
    /// `t,x,y,p`, us.
    Csv,
    /// `t x y p`, seconds.
    Seconds,
}

/// Writes one event per line: `t,x,y,p` in us below a heading, or `t x y p` in seconds without one,
/// as the Event-Camera Dataset.
pub(super) fn write(
    out: &Path,
    events: EventSlice<'_>,
    in_seconds: bool,
) -> Result<(), ExportError> {
    let io = |source| ExportError::Io { path: out.to_owned(), source };
    let mut file = File::create(out).map_err(io)?;
    let (heading, layout) =
        if in_seconds { ("", LineLayout::Seconds) } else { ("t,x,y,p\n", LineLayout::Csv) };
    file.write_all(heading.as_bytes()).map_err(io)?;
    write_lines(&mut file, events, layout).map_err(io)
}

/// Writes the archive that rpg_e2vid reads: one text, whose first line is the size of the sensor and
/// the others are `t x y p` in seconds.
pub(super) fn write_zip(out: &Path, events: EventSlice<'_>, size: Size) -> Result<(), ExportError> {
    let io = |source| ExportError::Io { path: out.to_owned(), source };
    let refused = |error: zip::result::ZipError| io(std::io::Error::other(error));
    let file = BufWriter::with_capacity(1 << 20, File::create(out).map_err(io)?);
    let mut archive = zip::ZipWriter::new(file);
    // One date for all: the same events give the same bytes at any time.
    let options = SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::default())
        .large_file(true);
    archive.start_file("events.txt", options).map_err(refused)?;
    writeln!(archive, "{} {}", size.width, size.height).map_err(io)?;
    write_lines(&mut archive, events, LineLayout::Seconds).map_err(io)?;
    archive.finish().and_then(|mut file| Ok(file.flush()?)).map_err(refused)
}

/// Writes a line per event. `itoa` and one buffer, since the formatting of the standard library
/// took most of the time.
fn write_lines(
    file: &mut impl Write,
    events: EventSlice<'_>,
    layout: LineLayout,
) -> std::io::Result<()> {
    let mut digits = itoa::Buffer::new();
    let mut text = Vec::with_capacity(BLOCK_BYTES + MAX_LINE_BYTES);
    for event in events.iter() {
        let separator = match layout {
            LineLayout::Csv => {
                text.extend_from_slice(digits.format(event.t).as_bytes());
                b','
            }
            LineLayout::Seconds => {
                push_seconds(&mut text, event.t, &mut digits);
                b' '
            }
        };
        for coordinate in [event.x, event.y] {
            text.push(separator);
            text.extend_from_slice(digits.format(coordinate).as_bytes());
        }
        text.extend_from_slice(&[separator, b'0' + u8::from(event.on), b'\n']);
        if text.len() >= BLOCK_BYTES {
            file.write_all(&text)?;
            text.clear();
        }
    }
    file.write_all(&text)
}

/// Appends a time in seconds with six decimals.
fn push_seconds(text: &mut Vec<u8>, t_us: i64, digits: &mut itoa::Buffer) {
    const SECOND_US: u64 = 1_000_000;
    if t_us < 0 {
        text.push(b'-');
    }
    let t_us = t_us.unsigned_abs();
    text.extend_from_slice(digits.format(t_us / SECOND_US).as_bytes());
    // The added second keeps the zeros of the fraction; its digit becomes the point.
    let point = text.len();
    text.extend_from_slice(digits.format(SECOND_US + t_us % SECOND_US).as_bytes());
    text[point] = b'.';
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};

    #[test]
    fn times_of_every_sign_and_length_are_written_as_the_standard_library_writes_them() {
        let times = [i64::MIN, -1_000_001, -1, 0, 7, 999_999, 1_000_000, 12_034_005, i64::MAX];
        let event = |(i, t): (usize, &i64)| Event { t: *t, x: 7, y: u16::MAX, on: i % 2 == 0 };
        let events: Events = times.iter().enumerate().map(event).collect();
        let lines = |layout| {
            let mut text = Vec::new();
            write_lines(&mut text, events.as_slice(), layout).unwrap();
            String::from_utf8(text).unwrap()
        };
        let csv = |e: Event| format!("{},{},{},{}\n", e.t, e.x, e.y, u8::from(e.on));
        assert_eq!(lines(LineLayout::Csv), events.as_slice().iter().map(csv).collect::<String>());
        let seconds = |e: Event| {
            let (sign, t) = (if e.t < 0 { "-" } else { "" }, e.t.unsigned_abs());
            let (s, us, p) = (t / 1_000_000, t % 1_000_000, u8::from(e.on));
            format!("{sign}{s}.{us:06} {} {} {p}\n", e.x, e.y)
        };
        let expected: String = events.as_slice().iter().map(seconds).collect();
        assert_eq!(lines(LineLayout::Seconds), expected);
    }

    #[test]
    fn blocks_of_text_join_without_a_gap() {
        let n = (3 * BLOCK_BYTES / "0,0,0,1\n".len()) as i64;
        let events: Events = (0..n).map(|t| Event { t, x: 0, y: 0, on: true }).collect();
        let mut text = Vec::new();
        write_lines(&mut text, events.as_slice(), LineLayout::Csv).unwrap();
        let expected: String = (0..n).map(|t| format!("{t},0,0,1\n")).collect();
        assert!(text == expected.as_bytes());
    }
}
