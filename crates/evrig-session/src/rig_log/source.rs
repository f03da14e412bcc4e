//! The records of a log, one after the other, from any source of bytes.

use super::length_check::LengthCheck;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::{self, Read};

/// Records longer than this are damage: a chunk ends soon after 8 MiB, a frame has some megabytes.
const MAX_RECORD_BYTES: usize = 1 << 28;

/// Bytes read at once at most: a damaged header may announce a record that is not there, and memory
/// is allocated, and cleared, for what is read.
const MAX_READ_BYTES: usize = 1 << 20;

/// Reads a log in memory for one record.
pub(super) struct RecordSource<R> {
    from: R,
    reader: LinearReader,
    lengths: LengthCheck,
    /// Bytes that the library asked for and did not get yet.
    n_wanted: usize,
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
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        let reader = LinearReader::new_with_options(options);
        Self { from, reader, lengths: LengthCheck::default(), n_wanted: 0 }
    }

    /// Reads the next step.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub(super) fn step(&mut self) -> io::Result<ReadStep<'_>> {
        if self.n_wanted > 0 {
            let buffer = self.reader.insert(self.n_wanted.min(MAX_READ_BYTES));
            self.n_wanted = 0;
            let n = self.from.read(buffer)?;
            if let Err(overrun) = self.lengths.check(&buffer[..n]) {
                return Ok(ReadStep::Damage(overrun.to_string()));
            }
            self.reader.notify_read(n);
        }
        Ok(match self.reader.next_event() {
            None => ReadStep::End,
            Some(Ok(LinearReadEvent::ReadRequest(n))) => {
                self.n_wanted = n;
                ReadStep::Nothing
            }
            // The log has no attachments, and mcap 0.26 panics on one whose name is too long for
            // it.
            Some(Ok(LinearReadEvent::Record { opcode: op::ATTACHMENT, .. })) => ReadStep::Nothing,
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                match mcap::parse_record(opcode, data) {
                    Ok(record) => ReadStep::Record(record),
                    Err(error) => ReadStep::Damage(error.to_string()),
                }
            }
            Some(Err(error)) => ReadStep::Damage(error.to_string()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes, and the largest buffer that was offered for them.
    struct Offered<'a> {
        bytes: &'a [u8],
        most: &'a mut usize,
    }

    impl Read for Offered<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            *self.most = buffer.len().max(*self.most);
            self.bytes.read(buffer)
        }
    }

    #[test]
    fn an_attachment_without_space_for_its_end_is_passed_over() {
        // Two times of eight bytes, the lengths of two names, that of the data: 32 bytes, and no
        // checksum.
        let attachment = [&[op::ATTACHMENT][..], &32_u64.to_le_bytes(), &[0; 32]].concat();
        let bytes =
            [mcap::MAGIC, &attachment, &[op::DATA_END], &4_u64.to_le_bytes(), &[0; 4]].concat();
        let mut source = RecordSource::new(&bytes[..]);
        let mut n_records = 0;
        loop {
            match source.step().unwrap() {
                ReadStep::Nothing => {}
                ReadStep::Record(_) => n_records += 1,
                ReadStep::Damage(_) | ReadStep::End => break,
            }
        }
        assert_eq!(n_records, 1, "what comes behind it is read");
    }

    #[test]
    fn a_record_that_is_announced_and_not_there_takes_no_memory() {
        let announced = (MAX_RECORD_BYTES as u64).to_le_bytes();
        let bytes = [mcap::MAGIC, &[mcap::records::op::MESSAGE], &announced, &[7; 30]].concat();
        let mut most = 0;
        let mut source = RecordSource::new(Offered { bytes: &bytes, most: &mut most });
        let end = loop {
            match source.step().unwrap() {
                ReadStep::Nothing | ReadStep::Record(_) => {}
                ReadStep::Damage(what) => break what,
                ReadStep::End => break "an end".to_owned(),
            }
        };
        assert!(end.contains("in the middle of a record"), "{end}");
        assert!(most <= MAX_READ_BYTES, "a buffer of {most} bytes");
    }
}
