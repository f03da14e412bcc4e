//! Elements of a dataset as numbers, through filters that `hdf5-pure` does not have.

use super::blosc;
use crate::BLOCK_BYTES;
use crate::column::{Column, NumberCell, NumberKind};
use hdf5_pure::{Chunk as StoredChunk, Dataset, Datatype, DatatypeByteOrder};
use rayon::prelude::*;
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

/// Chunks of this size together are decompressed in parallel.
const PARALLEL_BYTES: usize = 1 << 20;

/// A chunk has at most 4 GiB in HDF5.
const MAX_CHUNK_BYTES: u64 = u32::MAX as u64;

/// Columns of a dataset, up to where its file is cut or damaged.
pub(super) struct StoredColumns {
    pub(super) columns: Vec<Column>,
    pub(super) damage: Option<String>,
}

/// The cells of a dataset's records as columns, read block by block.
///
/// # Errors
/// When no record can be read.
pub(super) fn read_columns(
    path: &Path,
    dataset: &Dataset,
    cells: &[NumberCell],
) -> Result<StoredColumns, String> {
    let text = |error: hdf5_pure::Error| error.to_string();
    let shape = dataset.shape().map_err(text)?;
    let n_rows = shape.first().copied().unwrap_or(1);
    let inner = shape.iter().skip(1).product::<u64>();
    let row_bytes = dataset.element_size().map_err(text)?.saturating_mul(inner).max(1);
    if n_rows.checked_mul(row_bytes).is_none_or(|n| n > MAX_BYTES) {
        return Err("has more elements than memory".into());
    }
    let mut columns = vec![Column::default(); cells.len()];
    let mut n_read = 0;
    let mut take = |rows: &[u8]| {
        let n_left = (n_rows - n_read).saturating_mul(row_bytes);
        let rows = &rows[..n_left.min(rows.len() as u64) as usize];
        for (cell, column) in cells.iter().zip(&mut columns) {
            cell.decode(rows, row_bytes as usize, column);
        }
        n_read += rows.len() as u64 / row_bytes;
        n_read
    };
    let chunk_shape = dataset.chunk_shape().map_err(text)?.unwrap_or_default();
    let chunk_rows = chunk_shape.first().copied().unwrap_or(1).max(1);
    let end = if is_decompressed_here(dataset, &shape, &chunk_shape) {
        let chunk_bytes = chunk_rows.saturating_mul(row_bytes).min(MAX_CHUNK_BYTES) as usize;
        each_chunk(path, dataset, chunk_bytes, &mut take)
    } else {
        // Whole chunks, so that none is decompressed twice.
        let n = (BLOCK_BYTES as u64 / row_bytes).max(1).next_multiple_of(chunk_rows);
        each_block(dataset, n_rows, n, &mut take)
    };
    match end {
        Err(what) if n_read == 0 && n_rows > 0 => Err(what),
        Ok(()) if n_read == n_rows => Ok(StoredColumns { columns, damage: None }),
        end => {
            let why = end.err().unwrap_or_else(|| "the others were never written".into());
            let damage = format!("holds {n_read} of {n_rows} rows: {why}");
            Ok(StoredColumns { columns, damage: Some(damage) })
        }
    }
}

/// Whether a dataset is of chunks of whole rows, through filters that are undone here.
fn is_decompressed_here(dataset: &Dataset, shape: &[u64], chunk_shape: &[u64]) -> bool {
    let filters = dataset.filters();
    let known = [DEFLATE, SHUFFLE, FLETCHER32, BLOSC, ZSTD];
    // `hdf5-pure` checks the sums of the other filters.
    let is_foreign = filters.iter().any(|id| [BLOSC, ZSTD].contains(id));
    chunk_shape.get(1..) == shape.get(1..)
        && filters.iter().all(|id| known.contains(id))
        && (is_foreign || !filters.contains(&FLETCHER32))
}

/// Gives blocks of at most `n` rows to `take`, which returns how many rows it has.
fn each_block(
    dataset: &Dataset,
    n_rows: u64,
    mut n: u64,
    take: &mut impl FnMut(&[u8]) -> u64,
) -> Result<(), String> {
    let mut row = 0;
    while row < n_rows {
        match dataset.read_raw_rows(row, n) {
            Ok(rows) => row = take(&rows),
            // A cut is in this block: its first rows are before the cut.
            Err(_) if n > 1 => n /= 2,
            Err(error) => return Err(unreadable(dataset, &error)),
        }
    }
    Ok(())
}

fn unreadable(dataset: &Dataset, error: &hdf5_pure::Error) -> String {
    let known = [DEFLATE, SHUFFLE, FLETCHER32];
    match dataset.filters().iter().find(|id| !known.contains(id)) {
        Some(id) => format!("filter {id}: {error}; rewrite it with gzip (h5repack)"),
        None => error.to_string(),
    }
}

/// Gives the decompressed chunks of at most `n_bytes` in the order of their first rows to `take`,
/// which returns how many rows it has. Ends before a chunk that was never written.
fn each_chunk(
    path: &Path,
    dataset: &Dataset,
    n_bytes: usize,
    take: &mut impl FnMut(&[u8]) -> u64,
) -> Result<(), String> {
    let text = |error: hdf5_pure::Error| error.to_string();
    let filters = dataset.filters();
    let size = dataset.element_size().map_err(text)? as usize;
    let mut chunks = dataset.chunks().map_err(text)?;
    chunks.sort_by_key(|chunk| chunk.offset.first().copied());
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    let n_parallel = (PARALLEL_BYTES / n_bytes.max(1)).max(1);
    let mut n_read = 0;
    for chunks in chunks.chunks(n_parallel) {
        let stored: Vec<_> = chunks.iter().map(|chunk| stored_bytes(&mut file, chunk)).collect();
        let plain = stored.into_par_iter().zip(chunks).map(|(stored, chunk)| {
            let used = filters.iter().enumerate().rev();
            let mut used = used.filter(|(i, _)| chunk.filter_mask & (1 << i) == 0);
            used.try_fold(stored?, |data, (_, id)| unfilter(*id, data, size, n_bytes))
        });
        for (plain, chunk) in plain.collect::<Vec<_>>().into_iter().zip(chunks) {
            if chunk.offset.first() != Some(&n_read) {
                return Ok(());
            }
            let at_chunk = |what: String| format!("chunk at byte {}: {what}", chunk.address);
            n_read = take(&plain.map_err(at_chunk)?);
        }
    }
    Ok(())
}

/// The bytes of a chunk, all of them.
fn stored_bytes(file: &mut File, chunk: &StoredChunk) -> Result<Vec<u8>, String> {
    let mut data = Vec::new();
    let found = file.seek(SeekFrom::Start(chunk.address));
    let read = found.and_then(|_| file.take(chunk.storage_size).read_to_end(&mut data));
    match read {
        Ok(n) if n as u64 == chunk.storage_size => Ok(data),
        Ok(_) => Err("the file is cut".into()),
        Err(error) => Err(error.to_string()),
    }
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
