//! The records of a log, one after the other, from any source of bytes.
//!
//! Records are framed here and parsed by the crate `mcap`. Its own readers end at the first damaged
//! chunk and trust the lengths inside chunks; here a chunk whose checksum or lengths do not hold is
//! passed over, and reading goes on at the next one.

use mcap::records::{Record, op};
use std::io::{self, Read};

/// Records longer than this are damage: a chunk ends soon after 8 MiB, a frame has some megabytes.
const MAX_RECORD_BYTES: u64 = 1 << 28;

/// Bytes read at once at most: a damaged header may announce a record that is not there, and memory
/// is allocated, and cleared, for what is read.
const MAX_READ_BYTES: usize = 1 << 20;

/// Opcode and length, before every record.
const HEAD_BYTES: usize = 9;

/// A chunk's header before its records: two times, size, checksum, the name of its
/// compression (none: its length alone), size as stored.
const CHUNK_HEAD_BYTES: usize = 40;

/// Reads a log in memory for one record.
pub(super) struct RecordSource<R> {
    from: R,
    /// Read in search of a chunk, and not yet used.
    pending: Vec<u8>,
    /// Bytes of the file before what comes next.
    offset: u64,
    body: Vec<u8>,
    /// The next record inside `body`, while that is a chunk.
    at: usize,
    is_in_chunk: bool,
    /// The damage to report at the end of a chunk that was cut.
    cut: Option<String>,
    has_begun: bool,
    has_ended: bool,
    passed_over: PassedOver,
}

/// Damage behind which reading went on.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct PassedOver {
    /// Damaged places.
    pub(crate) count: u64,
    /// The first of them.
    pub(crate) first: Option<String>,
}

/// The result of one step.
pub(super) enum ReadStep<'a> {
    /// A record, inside or outside a chunk.
    Record(Record<'a>),
    /// No complete record yet.
    Nothing,
    /// The file is truncated or damaged here; nothing after it can be read.
    Damage(String),
    /// The file's end.
    End,
}

impl<R: Read> RecordSource<R> {
    pub(super) fn new(from: R) -> Self {
        Self {
            from,
            pending: Vec::new(),
            offset: 0,
            body: Vec::new(),
            at: 0,
            is_in_chunk: false,
            cut: None,
            has_begun: false,
            has_ended: false,
            passed_over: PassedOver::default(),
        }
    }

    /// Damage that was passed over so far.
    pub(super) fn passed_over(&self) -> &PassedOver {
        &self.passed_over
    }

    /// Reads the next step.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub(super) fn step(&mut self) -> io::Result<ReadStep<'_>> {
        if self.has_ended {
            return Ok(ReadStep::End);
        }
        if !self.has_begun {
            let mut magic = Vec::new();
            self.read(mcap::MAGIC.len(), &mut magic)?;
            self.has_begun = true;
            if magic != mcap::MAGIC {
                return Ok(self.end("it does not begin as an MCAP file".into()));
            }
            self.offset += magic.len() as u64;
        }
        if self.is_in_chunk { Ok(self.next_in_chunk()) } else { self.next_in_file() }
    }

    fn end(&mut self, damage: String) -> ReadStep<'static> {
        self.has_ended = true;
        ReadStep::Damage(damage)
    }

    fn next_in_chunk(&mut self) -> ReadStep<'_> {
        let rest = &self.body[self.at.min(self.body.len())..];
        let Some((opcode, length)) = head(rest) else {
            self.is_in_chunk = false;
            return match self.cut.take() {
                Some(cut) => self.end(cut),
                None => ReadStep::Nothing,
            };
        };
        let start = self.at + HEAD_BYTES;
        let end = (start as u64).saturating_add(length);
        if end > self.body.len() as u64 {
            self.is_in_chunk = false;
            if let Some(cut) = self.cut.take() {
                return self.end(cut);
            }
            let left = self.body.len() - self.at;
            let what = format!("a record claims {length} bytes of a chunk that has {left} left");
            self.pass_over(what);
            return ReadStep::Nothing;
        }
        self.at = end as usize;
        match mcap::parse_record(opcode, &self.body[start..self.at]) {
            Ok(record) => ReadStep::Record(record),
            // The checksum held, or there is none: the next record is where this one ends.
            Err(_) => ReadStep::Nothing,
        }
    }

    fn next_in_file(&mut self) -> io::Result<ReadStep<'_>> {
        let mut record = Vec::new();
        self.read(HEAD_BYTES, &mut record)?;
        let Some((opcode, length)) = head(&record) else {
            self.has_ended = true;
            // A file ends with its magic.
            return Ok(match record.as_slice() {
                tail if tail == mcap::MAGIC => ReadStep::End,
                [] => ReadStep::Damage("the file ends without its footer".into()),
                _ => ReadStep::Damage("the file ends in the middle of a record".into()),
            });
        };
        let is_record = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
        if !is_record || length > MAX_RECORD_BYTES {
            let what = format!("opcode {opcode} with {length} bytes is no record");
            return self.seek_chunk(record, what);
        }
        let mut body = std::mem::take(&mut self.body);
        self.read(length as usize, &mut body)?;
        self.body = body;
        if (self.body.len() as u64) < length {
            return self.cut_record(opcode, record);
        }
        self.offset += HEAD_BYTES as u64 + length;
        match opcode {
            op::CHUNK => {
                match check_chunk(&self.body) {
                    Ok(()) => (self.is_in_chunk, self.at) = (true, CHUNK_HEAD_BYTES),
                    Err(what) => self.pass_over(what),
                }
                Ok(ReadStep::Nothing)
            }
            // The log has no attachments, and mcap 0.26 panics on one whose name is too long for
            // it.
            op::ATTACHMENT => Ok(ReadStep::Nothing),
            op::FOOTER => {
                self.has_ended = true;
                Ok(ReadStep::End)
            }
            _ => Ok(match mcap::parse_record(opcode, &self.body) {
                Ok(record) => ReadStep::Record(record),
                Err(error) => {
                    self.passed_over.count += 1;
                    let place = format!("byte {}: {error}", self.offset);
                    self.passed_over.first.get_or_insert(place);
                    ReadStep::Nothing
                }
            }),
        }
    }

    /// The file ends before the record that was announced: its length is damaged, or the file is
    /// cut, and the whole records of a cut chunk can be read.
    fn cut_record(&mut self, opcode: u8, record: Vec<u8>) -> io::Result<ReadStep<'_>> {
        let cut = "the file ends in the middle of a record".to_owned();
        if find_chunk(&self.body).is_some() {
            let read = [record, std::mem::take(&mut self.body)].concat();
            return self.seek_chunk(read, cut);
        }
        if opcode == op::CHUNK && self.body.len() > CHUNK_HEAD_BYTES {
            (self.is_in_chunk, self.at, self.cut) = (true, CHUNK_HEAD_BYTES, Some(cut));
            return Ok(ReadStep::Nothing);
        }
        Ok(self.end(cut))
    }

    /// Goes on at the next chunk in `read`, which begins at the current offset, or behind it.
    fn seek_chunk(&mut self, read: Vec<u8>, damage: String) -> io::Result<ReadStep<'_>> {
        let place = self.offset;
        let mut window = read;
        let mut start = 1;
        loop {
            if let Some(at) = find_chunk(&window[start.min(window.len())..]) {
                window.drain(..start + at);
                self.offset += (start + at) as u64;
                window.extend(std::mem::take(&mut self.pending));
                self.pending = window;
                self.passed_over.count += 1;
                self.passed_over.first.get_or_insert(format!("byte {place}: {damage}"));
                return Ok(ReadStep::Nothing);
            }
            let keep = window.len().saturating_sub(HEAD_BYTES + CHUNK_HEAD_BYTES - 1).max(start);
            let keep = keep.min(window.len());
            window.drain(..keep);
            self.offset += keep as u64;
            start = 0;
            let mut more = Vec::new();
            self.read(MAX_READ_BYTES, &mut more)?;
            if more.is_empty() {
                return Ok(self.end(format!("byte {place}: {damage}")));
            }
            window.extend(more);
        }
    }

    fn pass_over(&mut self, what: String) {
        self.passed_over.count += 1;
        let place = self.offset.saturating_sub((HEAD_BYTES + self.body.len()) as u64);
        self.passed_over.first.get_or_insert(format!("chunk at byte {place}: {what}"));
    }

    /// Reads up to `n` bytes; fewer mean the source ended.
    fn read(&mut self, n: usize, bytes: &mut Vec<u8>) -> io::Result<()> {
        bytes.clear();
        let n_pending = n.min(self.pending.len());
        bytes.extend(self.pending.drain(..n_pending));
        while bytes.len() < n {
            let n_step = (n - bytes.len()).min(MAX_READ_BYTES);
            let n_read = self.from.by_ref().take(n_step as u64).read_to_end(bytes)?;
            if n_read < n_step {
                break;
            }
        }
        Ok(())
    }
}

/// Opcode and length of a record.
fn head(bytes: &[u8]) -> Option<(u8, u64)> {
    let (head, _) = bytes.split_first_chunk::<HEAD_BYTES>()?;
    let length = <[u8; 8]>::try_from(&head[1..]).ok()?;
    Some((head[0], u64::from_le_bytes(length)))
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> Option<u64> {
    let cell: [u8; N] = bytes.get(at..at + N)?.try_into().ok()?;
    Some(cell.iter().rev().fold(0, |value, byte| (value << 8) | u64::from(*byte)))
}

/// Whether a chunk's lengths and checksum hold.
fn check_chunk(body: &[u8]) -> Result<(), String> {
    let cut = || "its header is cut".to_owned();
    let n_name = number::<4>(body, 28).ok_or_else(cut)?;
    if n_name != 0 {
        return Err("it is compressed; expected the chunks of evrig, which are not".into());
    }
    let n_records = number::<8>(body, 32).ok_or_else(cut)?;
    let records = &body[CHUNK_HEAD_BYTES..];
    if n_records != records.len() as u64 {
        return Err(format!("it states {n_records} bytes of records and has {}", records.len()));
    }
    let checksum = number::<4>(body, 24).ok_or_else(cut)?;
    if checksum != 0 && u64::from(crc32fast::hash(records)) != checksum {
        return Err("its checksum does not hold".into());
    }
    Ok(())
}

/// Where the first chunk without compression begins in `bytes`.
fn find_chunk(bytes: &[u8]) -> Option<usize> {
    let is_chunk = |at: &usize| {
        let bytes = &bytes[*at..];
        let body = bytes.get(HEAD_BYTES..).unwrap_or_default();
        let Some((op::CHUNK, length)) = head(bytes) else { return false };
        let times = number::<8>(body, 0).zip(number::<8>(body, 8));
        let n_records = length.checked_sub(CHUNK_HEAD_BYTES as u64);
        length <= MAX_RECORD_BYTES
            && times.is_some_and(|(first, last)| first <= last)
            && number::<4>(body, 28) == Some(0)
            && number::<8>(body, 32) == n_records
            && number::<8>(body, 16) == n_records
    };
    let last = bytes.len().saturating_sub(HEAD_BYTES + CHUNK_HEAD_BYTES - 1);
    (0..last).find(is_chunk)
}

#[cfg(test)]
mod tests;
