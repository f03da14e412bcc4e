//! Prophesee's formats: EVT 2.0, EVT 2.1 and EVT 3.0 (`.raw`), and DAT.
//!
//! A header of lines that begin with `%` is followed by little-endian words. Layouts:
//! <https://docs.prophesee.ai/stable/data/encoding_formats/index.html>. The crate `evt3` reads one
//! of them, whole files at once, and no cut ones; the words are few.

mod evt2;
mod evt3;
mod write;

pub(crate) use write::Evt3Encoder;
pub use write::{MAX_EVT3_SIDE, write_evt3};

use crate::aedat4::Content;
use crate::recording::{RecordingNotes, RecordingSink, SourceStream};
use crate::{BLOCK_BYTES, CameraEvents, CameraFileError};
use evrig_core::event::Event;
use evrig_core::geometry::Size;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Longest header that is read.
const MAX_HEADER_LINES: usize = 1_000;

/// How the words of a file are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WordFormat {
    Evt2,
    Evt21,
    Evt3,
    Dat,
}

/// Decodes words into events.
trait WordDecoder {
    /// Bytes of a word.
    const BYTES: usize;

    fn decode(&mut self, words: &[u8], into: &mut CameraEvents);
}

/// What the header states.
#[derive(Debug, Default)]
struct FileHeader {
    text: String,
    width: Option<u16>,
    height: Option<u16>,
    /// Added to every time, µs, as faery writes it.
    t0: Option<i64>,
}

/// Decodes words that arrive in packets, as `event_camera_msgs` carries them.
#[derive(Debug)]
pub(crate) enum PacketDecoder {
    /// EVT 2.0.
    Evt2(evt2::Evt2),
    /// EVT 2.1.
    Evt21(evt2::Evt21),
    /// EVT 3.0.
    Evt3(evt3::Evt3),
}

impl PacketDecoder {
    /// The decoder of an encoding `evt2`, `evt21` or, for any other name, `evt3`.
    pub(crate) fn new(encoding: &str) -> Self {
        match encoding {
            "evt2" => Self::Evt2(evt2::Evt2::default()),
            "evt21" => Self::Evt21(evt2::Evt21::default()),
            _ => Self::Evt3(evt3::Evt3::default()),
        }
    }

    /// Decodes the whole words of a packet.
    pub(crate) fn decode(&mut self, words: &[u8], into: &mut CameraEvents) {
        match self {
            Self::Evt2(decoder) => decoder.decode(words, into),
            Self::Evt21(decoder) => decoder.decode(words, into),
            Self::Evt3(decoder) => decoder.decode(words, into),
        }
    }
}

/// Reads a file up to a cut.
///
/// # Errors
/// When the file cannot be read or its header states no known format, or the sink refuses.
pub fn read(path: &Path, sink: &mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError> {
    let mut reader =
        BufReader::with_capacity(BLOCK_BYTES, File::open(path).map_err(CameraFileError::io(path))?);
    let header = FileHeader::read(&mut reader).map_err(CameraFileError::io(path))?;
    let format = header.format(path)?;
    let size = header.width.zip(header.height).map(|(w, h)| Size::new(w, h));
    let t0 = header.t0.unwrap_or(0);
    let mut drain = WordDrain { path, stream: SourceStream::only_events(size), t0, sink };
    let mut notes = match format {
        WordFormat::Evt2 => drain.run(&mut reader, &mut evt2::Evt2::default()),
        WordFormat::Evt21 => drain.run(&mut reader, &mut evt2::Evt21::default()),
        WordFormat::Evt3 => drain.run(&mut reader, &mut evt3::Evt3::default()),
        WordFormat::Dat => {
            let mut kind_and_bytes = [0; 2];
            reader.read_exact(&mut kind_and_bytes).map_err(|_| {
                CameraFileError::format(path, "the file is cut in its header; it holds no events")
            })?;
            if kind_and_bytes[1] != 8 {
                let what = format!("has events of {} bytes; expected 8", kind_and_bytes[1]);
                return Err(CameraFileError::format(path, what));
            }
            drain.run(&mut reader, &mut Dat::default())
        }
    }?;
    if t0 != 0 {
        notes.decisions.push(format!("the header's t0 of {t0} us is added to the times"));
    }
    Ok(notes)
}

/// Whether the first bytes of a file are those of a header of Prophesee's.
#[must_use]
pub fn is_header(start: &[u8]) -> bool {
    start.starts_with(b"% ")
}

/// Gives the events of a file's words to a sink, block by block.
struct WordDrain<'a, 'b> {
    path: &'a Path,
    stream: SourceStream,
    /// Added to every time, µs.
    t0: i64,
    sink: &'a mut RecordingSink<'b>,
}

impl WordDrain<'_, '_> {
    fn run<D: WordDecoder>(
        &mut self,
        reader: &mut impl Read,
        decoder: &mut D,
    ) -> Result<RecordingNotes, CameraFileError> {
        let mut block = Vec::with_capacity(BLOCK_BYTES);
        let mut notes = RecordingNotes::default();
        loop {
            block.clear();
            let n = reader.by_ref().take(BLOCK_BYTES as u64).read_to_end(&mut block);
            let n = n.map_err(CameraFileError::io(self.path))?;
            let n_left = n % D::BYTES;
            let mut found = CameraEvents::default();
            decoder.decode(&block[..n - n_left], &mut found);
            found.left_out.iter().for_each(|(what, count)| notes.leave_out(what, *count));
            let mut events = found.events;
            events.shift(self.t0);
            (self.sink)(&self.stream, Content::Events(events))?;
            if n < BLOCK_BYTES {
                let cut =
                    || format!("the file is cut: {n_left} bytes of a last word were left out");
                notes.damage = (n_left > 0).then(cut);
                return Ok(notes);
            }
        }
    }
}

impl FileHeader {
    fn read(reader: &mut impl BufRead) -> std::io::Result<Self> {
        let mut header = Self::default();
        for _ in 0..MAX_HEADER_LINES {
            let start = reader.fill_buf()?;
            // `%` can be the first byte of an event: a header's line goes on with a blank.
            if !is_header(start) {
                break;
            }
            let mut line = Vec::new();
            reader.read_until(b'\n', &mut line)?;
            let line = String::from_utf8_lossy(&line).trim_start_matches('%').trim().to_lowercase();
            if line == "end" {
                break;
            }
            header.take(&line);
            header.text.push_str(&line);
            header.text.push('\n');
        }
        Ok(header)
    }

    fn take(&mut self, line: &str) {
        let words = line.split([' ', ';', '=', ':']).filter(|word| !word.is_empty());
        let words: Vec<&str> = words.collect();
        for pair in words.windows(2) {
            match *pair {
                ["width", n] => self.width = n.parse().ok(),
                ["height", n] => self.height = n.parse().ok(),
                ["t0", n] => self.t0 = n.parse().ok(),
                ["geometry", size] => {
                    if let Some((w, h)) = size.split_once('x') {
                        (self.width, self.height) = (w.parse().ok(), h.parse().ok());
                    }
                }
                _ => {}
            }
        }
    }

    fn format(&self, path: &Path) -> Result<WordFormat, CameraFileError> {
        let states = |words: &[&str]| words.iter().any(|word| self.text.contains(word));
        let is_dat = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("dat"));
        Ok(match () {
            () if states(&["evt 3", "evt3"]) => WordFormat::Evt3,
            () if states(&["evt 2.1", "evt21", "evt2.1"]) => WordFormat::Evt21,
            () if states(&["evt 2", "evt2"]) => WordFormat::Evt2,
            () if is_dat || states(&["data file containing"]) => WordFormat::Dat,
            () => {
                let what = "has a header that states no format; expected `% evt 3.0`, `% evt 2.0`, \
                            `% evt 2.1` or that of a DAT file";
                return Err(CameraFileError::format(path, what));
            }
        })
    }
}

/// DAT: a time of 32 bits, then 14 bits each of x and y, and the polarity.
#[derive(Debug, Default)]
struct Dat {
    last: u32,
    n_wraps: i64,
}

impl WordDecoder for Dat {
    const BYTES: usize = 8;

    fn decode(&mut self, words: &[u8], into: &mut CameraEvents) {
        let (words, _) = words.as_chunks::<8>();
        for word in words.iter().map(|word| u64::from_le_bytes(*word)) {
            let (t, data) = (word as u32, (word >> 32) as u32);
            // A step back of half the range is a wrap; a small one is disorder.
            self.n_wraps += i64::from(self.last > t && self.last - t > u32::MAX / 2);
            self.last = t;
            let (x, y) = ((data & 0x3fff) as u16, ((data >> 14) & 0x3fff) as u16);
            let t = (self.n_wraps << 32) + i64::from(t);
            into.events.push(Event { t, x, y, on: (data >> 28) & 1 == 1 });
        }
    }
}

#[cfg(test)]
mod tests;
