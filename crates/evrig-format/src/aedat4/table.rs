//! The data table (FTAB) at a closed file's end: where each packet is and what time it spans.

use super::header::one_line;
use super::overflow;
use flatbuffers::{
    FlatBufferBuilder, Follow, ForwardsUOffset, InvalidFlatbuffer, Push, Table, Vector, Verifiable,
    Verifier, VerifierOptions,
};

const IDENTIFIER: &str = "FTAB";

/// Virtual table slots of a `FileDataDefinition`.
const VT_BYTE_OFFSET: u16 = 4;
const VT_PACKET_INFO: u16 = 6;
const VT_NUM_ELEMENTS: u16 = 8;
const VT_TIMESTAMP_START: u16 = 10;
const VT_TIMESTAMP_END: u16 = 12;

/// Slot of the definitions in the root.
const VT_TABLE: u16 = 4;

/// One packet in the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TableEntry {
    /// Byte at which the payload (not the packet's header) begins.
    pub(super) payload_offset: u64,
    pub(super) stream: u32,
    /// Bytes of the payload in the file.
    pub(super) payload_bytes: u32,
    pub(super) n_elements: u64,
    /// First and last time in the packet, µs.
    pub(super) span_us: [i64; 2],
}

/// StreamHeader and payload length, as the struct `PacketHeader` has them.
#[derive(Clone, Copy)]
struct PacketInfo(u32, u32);

impl Push for PacketInfo {
    type Output = [u32; 2];
    fn push(&self, destination: &mut [u8], _rest: &[u8]) {
        let bytes = u64::from(self.0) | u64::from(self.1) << 32;
        if let Some(cell) = destination.get_mut(..8) {
            cell.copy_from_slice(&bytes.to_le_bytes());
        }
    }
}

/// The table as a size-prefixed flatbuffer.
pub(super) fn encode(entries: &[TableEntry]) -> Vec<u8> {
    let mut builder = FlatBufferBuilder::with_capacity(64 * entries.len() + 64);
    let mut definitions = Vec::with_capacity(entries.len());
    for entry in entries {
        let table = builder.start_table();
        builder.push_slot_always(VT_BYTE_OFFSET, entry.payload_offset as i64);
        builder.push_slot_always(VT_PACKET_INFO, PacketInfo(entry.stream, entry.payload_bytes));
        builder.push_slot_always(VT_NUM_ELEMENTS, entry.n_elements as i64);
        builder.push_slot_always(VT_TIMESTAMP_START, entry.span_us[0]);
        builder.push_slot_always(VT_TIMESTAMP_END, entry.span_us[1]);
        definitions.push(builder.end_table(table));
    }
    let definitions = builder.create_vector(&definitions);
    let table = builder.start_table();
    builder.push_slot_always(VT_TABLE, definitions);
    let root = builder.end_table(table);
    builder.finish_size_prefixed(root, Some(IDENTIFIER));
    builder.finished_data().to_vec()
}

/// Number of packets in a table; the error describes what was found instead.
pub(super) fn count(payload: &[u8]) -> Result<usize, String> {
    if payload.get(8..12) != Some(IDENTIFIER.as_bytes()) {
        return Err("bytes without the identifier FTAB".to_owned());
    }
    overflow::check(payload, true)?;
    let options = VerifierOptions { max_tables: payload.len(), ..VerifierOptions::default() };
    let root = flatbuffers::size_prefixed_root_with_opts::<Root<'_>>(&options, payload)
        .map_err(|error| one_line(&error))?;
    Ok(root.0.get::<Definitions<'_>>(VT_TABLE, None).map_or(0, |definitions| definitions.len()))
}

type Definitions<'a> = ForwardsUOffset<Vector<'a, ForwardsUOffset<TableDefinition<'a>>>>;

/// The root table, after verification.
struct Root<'a>(Table<'a>);

impl<'a> Follow<'a> for Root<'a> {
    type Inner = Self;
    fn follow(buf: &'a [u8], loc: usize) -> Self {
        Self(Table { buf, loc })
    }
}

impl Verifiable for Root<'_> {
    fn run_verifier(verifier: &mut Verifier<'_, '_>, pos: usize) -> Result<(), InvalidFlatbuffer> {
        let table = verifier.visit_table(pos)?;
        table.visit_field::<Definitions<'_>>("Table", VT_TABLE, false)?.finish();
        Ok(())
    }
}

/// One definition; only its structure is verified, its fields are not read.
struct TableDefinition<'a>(
    #[expect(dead_code, reason = "the shape of a followed table")] Table<'a>,
);

impl<'a> Follow<'a> for TableDefinition<'a> {
    type Inner = Self;
    fn follow(buf: &'a [u8], loc: usize) -> Self {
        Self(Table { buf, loc })
    }
}

impl Verifiable for TableDefinition<'_> {
    fn run_verifier(verifier: &mut Verifier<'_, '_>, pos: usize) -> Result<(), InvalidFlatbuffer> {
        let table = verifier.visit_table(pos)?;
        table
            .visit_field::<i64>("ByteOffset", VT_BYTE_OFFSET, false)?
            .visit_field::<i64>("NumElements", VT_NUM_ELEMENTS, false)?
            .visit_field::<i64>("TimestampStart", VT_TIMESTAMP_START, false)?
            .visit_field::<i64>("TimestampEnd", VT_TIMESTAMP_END, false)?
            .finish();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_counts_what_was_put_in_and_no_cut_of_it_passes() {
        let entry = TableEntry {
            payload_offset: 99,
            stream: 1,
            payload_bytes: 7,
            n_elements: 3,
            span_us: [-5, 5],
        };
        let bytes = encode(&[entry; 3]);
        assert_eq!(count(&bytes), Ok(3));
        for n in 0..bytes.len() {
            assert!(count(&bytes[..n]).is_err(), "{n} of {} bytes", bytes.len());
        }
    }
}
