//! Elements of a dataset as numbers, through filters that `hdf5-pure` does not have.

use super::blosc;
use crate::column::{Column, NumberCell, NumberKind};
use hdf5_pure::{Dataset, Datatype, DatatypeByteOrder};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Filters by their registered numbers.
const DEFLATE: u16 = 1;
const SHUFFLE: u16 = 2;
const FLETCHER32: u16 = 3;
const BLOSC: u16 = 32_001;
const ZSTD: u16 = 32_015;

/// Bytes of one dataset, at most: 16 GiB, two thousand million times.
const MAX_BYTES: u64 = 1 << 34;

/// A chunk has at most 4 GiB in HDF5.
const MAX_CHUNK_BYTES: u64 = u32::MAX as u64;

/// Bytes read at once, at least.
const BLOCK_BYTES: u64 = 1 << 20;

/// The cells of a dataset's records as columns, read block by block.
pub(super) fn read_columns(
    path: &Path,
    dataset: &Dataset,
    cells: &[NumberCell],
) -> Result<Vec<Column>, String> {
    let text = |error: hdf5_pure::Error| error.to_string();
    let shape = dataset.shape().map_err(text)?;
    let n_rows = shape.first().copied().unwrap_or(1);
    let inner = shape.iter().skip(1).product::<u64>();
    let row_bytes = dataset.element_size().map_err(text)?.saturating_mul(inner).max(1);
    if n_rows.checked_mul(row_bytes).is_none_or(|n| n > MAX_BYTES) {
        return Err("has more elements than memory".into());
    }
    let chunk_shape = dataset.chunk_shape().map_err(text)?;
    let chunk_rows = chunk_shape.and_then(|shape| shape.first().copied()).unwrap_or(1).max(1);
    let mut columns = vec![Column::default(); cells.len()];
    let mut take = |rows: &[u8]| {
        for (cell, column) in cells.iter().zip(&mut columns) {
            cell.decode(rows, row_bytes as usize, column);
        }
    };
    if dataset.filters().iter().any(|id| [BLOSC, ZSTD].contains(id)) {
        let chunk_bytes = chunk_rows.saturating_mul(row_bytes).min(MAX_CHUNK_BYTES) as usize;
        each_chunk(path, dataset, chunk_bytes, |first_row, rows| {
            let n_left = n_rows.saturating_sub(first_row).saturating_mul(row_bytes);
            take(&rows[..n_left.min(rows.len() as u64) as usize]);
        })?;
    } else {
        // Whole chunks, so that none is decompressed twice.
        let rows_per_block = (BLOCK_BYTES / row_bytes).max(1).next_multiple_of(chunk_rows);
        let mut row = 0;
        while row < n_rows {
            take(&dataset.read_raw_rows(row, rows_per_block).map_err(text)?);
            row += rows_per_block;
        }
    }
    match columns.iter().all(|column| column.len() as u64 == n_rows) {
        true => Ok(columns),
        false => Err(format!("has chunks that were never written; expected {n_rows} rows")),
    }
}

/// Gives the decompressed chunks of at most `n_bytes` in the order of their first rows.
fn each_chunk(
    path: &Path,
    dataset: &Dataset,
    n_bytes: usize,
    mut take: impl FnMut(u64, &[u8]),
) -> Result<(), String> {
    let filters = dataset.filters();
    let known = [DEFLATE, SHUFFLE, FLETCHER32, BLOSC, ZSTD];
    if let Some(id) = filters.iter().find(|id| !known.contains(id)) {
        return Err(format!("is compressed with filter {id}; rewrite it with gzip (h5repack)"));
    }
    let text = |error: hdf5_pure::Error| error.to_string();
    let (shape, chunk_shape) = (dataset.shape(), dataset.chunk_shape());
    if chunk_shape.map_err(text)?.unwrap_or_default().get(1..) != shape.map_err(text)?.get(1..) {
        return Err("is cut into columns of chunks; rewrite it with gzip (h5repack)".into());
    }
    let size = dataset.element_size().map_err(text)? as usize;
    let mut chunks = dataset.chunks().map_err(text)?;
    chunks.sort_by_key(|chunk| chunk.offset.first().copied());
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    for chunk in chunks {
        let at_chunk = |what: String| format!("chunk at byte {}: {what}", chunk.address);
        let mut data = Vec::new();
        let found = file.seek(SeekFrom::Start(chunk.address));
        let read = found.and_then(|_| (&mut file).take(chunk.storage_size).read_to_end(&mut data));
        read.map_err(|error| at_chunk(error.to_string()))?;
        for (i, id) in filters.iter().enumerate().rev() {
            if chunk.filter_mask & (1 << i) == 0 {
                data = unfilter(*id, data, size, n_bytes).map_err(at_chunk)?;
            }
        }
        take(chunk.offset.first().copied().unwrap_or(0), &data);
    }
    Ok(())
}

fn unfilter(id: u16, data: Vec<u8>, size: usize, n_bytes: usize) -> Result<Vec<u8>, String> {
    match id {
        BLOSC => blosc::decompress(&data, n_bytes),
        ZSTD => zstd::bulk::decompress(&data, n_bytes).map_err(|error| error.to_string()),
        SHUFFLE => Ok(blosc::unshuffle(&data, size)),
        FLETCHER32 => Ok(data[..data.len().saturating_sub(4)].to_vec()),
        _ => {
            let mut plain = Vec::new();
            let reader = flate2::read::ZlibDecoder::new(data.as_slice());
            let read = reader.take(n_bytes as u64).read_to_end(&mut plain);
            read.map(|_| plain).map_err(|error| error.to_string())
        }
    }
}

/// The number at `offset` in every record of `stride` bytes; none where the type is no number.
pub(super) fn number_cell(datatype: &Datatype, offset: usize, stride: usize) -> Option<NumberCell> {
    let (size, order, kind) = match datatype {
        Datatype::FixedPoint { size, byte_order, layout } if layout.signed => {
            (size, byte_order, NumberKind::Signed)
        }
        Datatype::FixedPoint { size, byte_order, .. } => (size, byte_order, NumberKind::Unsigned),
        Datatype::FloatingPoint { size, byte_order, .. } => (size, byte_order, NumberKind::Float),
        // h5py stores booleans as an enumeration of FALSE and TRUE.
        Datatype::Enumeration { base_type, .. } => return number_cell(base_type, offset, stride),
        _ => return None,
    };
    let is_big_endian = *order == DatatypeByteOrder::BigEndian;
    let cell = NumberCell { kind, n_bytes: *size as usize, is_big_endian, offset };
    (cell.is_known() && offset + cell.n_bytes <= stride).then_some(cell)
}
