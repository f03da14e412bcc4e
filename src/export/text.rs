//! Events as text.

use super::ExportError;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;

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
    let mut file = BufWriter::with_capacity(1 << 20, File::create(out).map_err(io)?);
    if !in_seconds {
        file.write_all(b"t,x,y,p\n").map_err(io)?;
    }
    let layout = if in_seconds { LineLayout::Seconds } else { LineLayout::Csv };
    lines(&mut file, events, layout).and_then(|()| file.flush()).map_err(io)
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
    let mut text = BufWriter::with_capacity(1 << 16, &mut archive);
    writeln!(text, "{} {}", size.width, size.height).map_err(io)?;
    lines(&mut text, events, LineLayout::Seconds).and_then(|()| text.flush()).map_err(io)?;
    drop(text);
    archive.finish().and_then(|mut file| Ok(file.flush()?)).map_err(refused)
}

fn lines(file: &mut impl Write, events: EventSlice<'_>, layout: LineLayout) -> std::io::Result<()> {
    for event in events.iter() {
        let p = u8::from(event.on);
        if layout == LineLayout::Seconds {
            let sign = if event.t < 0 { "-" } else { "" };
            let (s, us) = (event.t.unsigned_abs() / 1_000_000, event.t.unsigned_abs() % 1_000_000);
            writeln!(file, "{sign}{s}.{us:06} {} {} {p}", event.x, event.y)?;
        } else {
            writeln!(file, "{},{},{},{p}", event.t, event.x, event.y)?;
        }
    }
    Ok(())
}
