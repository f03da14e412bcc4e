//! Events as text.

use super::ExportError;
use evrig_core::event::EventSlice;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

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
    for event in events.iter() {
        let p = u8::from(event.on);
        let written = if in_seconds {
            let sign = if event.t < 0 { "-" } else { "" };
            let (s, us) = (event.t.unsigned_abs() / 1_000_000, event.t.unsigned_abs() % 1_000_000);
            writeln!(file, "{sign}{s}.{us:06} {} {} {p}", event.x, event.y)
        } else {
            writeln!(file, "{},{},{},{p}", event.t, event.x, event.y)
        };
        written.map_err(io)?;
    }
    file.flush().map_err(io)
}
