//! Elements of a dataset as numbers, through filters that `hdf5-pure` does not have.

use super::blosc;
use crate::npy::Column;
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

/// The unfiltered bytes of a dataset.
pub(super) fn read_bytes(path: &Path, dataset: &Dataset) -> Result<Vec<u8>, String> {
    let filters = dataset.filters();
    if !filters.iter().any(|id| [BLOSC, ZSTD].contains(id)) {
        return dataset.read_raw().map_err(|error| error.to_string());
    }
    let known = [DEFLATE, SHUFFLE, FLETCHER32, BLOSC, ZSTD];
    if let Some(id) = filters.iter().find(|id| !known.contains(id)) {
        return Err(format!("is compressed with filter {id}; rewrite it with gzip (h5repack)"));
    }
    let text = |error: hdf5_pure::Error| error.to_string();
    let shape = dataset.shape().map_err(text)?;
    let chunk_shape = dataset.chunk_shape().map_err(text)?.unwrap_or_default();
    let size = dataset.element_size().map_err(text)?;
    let inner: u64 = shape.iter().skip(1).product();
    let n_bytes = shape.iter().try_fold(size, |n, side| n.checked_mul(*side));
    let n_bytes = n_bytes.filter(|n| *n <= MAX_BYTES).ok_or("has more elements than memory")?;
    if chunk_shape.get(1..) != shape.get(1..) {
        return Err("is cut into columns of chunks; rewrite it with gzip (h5repack)".into());
    }
    let chunk_bytes = chunk_shape.iter().product::<u64>() * size;
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    let mut stored = Vec::new();
    for chunk in dataset.chunks().map_err(text)? {
        let io = |error: std::io::Error| format!("chunk at byte {}: {error}", chunk.address);
        file.seek(SeekFrom::Start(chunk.address)).map_err(io)?;
        stored.clear();
        (&mut file).take(chunk.storage_size).read_to_end(&mut stored).map_err(io)?;
        let mut data = std::mem::take(&mut stored);
        for (i, id) in filters.iter().enumerate().rev() {
            if chunk.filter_mask & (1 << i) == 0 {
                data = unfilter(*id, data, size as usize, chunk_bytes as usize)
                    .map_err(|what| format!("chunk at byte {}: {what}", chunk.address))?;
            }
        }
        let start = chunk.offset.first().copied().unwrap_or(0).saturating_mul(inner * size);
        if start >= n_bytes {
            continue;
        }
        let end = (start + data.len() as u64).min(n_bytes);
        if bytes.len() < end as usize {
            bytes.resize(end as usize, 0);
        }
        bytes[start as usize..end as usize].copy_from_slice(&data[..(end - start) as usize]);
    }
    bytes.resize(n_bytes as usize, 0);
    Ok(bytes)
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

/// The numbers that lie `offset` bytes into every record of `stride` bytes; none where the type is
/// no number.
pub(super) fn numbers(
    bytes: &[u8],
    datatype: &Datatype,
    offset: usize,
    stride: usize,
) -> Option<Column> {
    let (size, order, is_signed) = match datatype {
        Datatype::FixedPoint { size, byte_order, layout } => {
            (*size as usize, byte_order, Some(layout.signed))
        }
        Datatype::FloatingPoint { size, byte_order, .. } => (*size as usize, byte_order, None),
        // h5py stores booleans as an enumeration of FALSE and TRUE.
        Datatype::Enumeration { base_type, .. } => {
            return numbers(bytes, base_type, offset, stride);
        }
        _ => return None,
    };
    let is_big_endian = *order == DatatypeByteOrder::BigEndian;
    if stride == 0 || offset + size > stride {
        return None;
    }
    let cells = NumberCells { bytes, offset, stride, is_big_endian };
    match size {
        1 => cells.column::<1>(is_signed),
        2 => cells.column::<2>(is_signed),
        4 => cells.column::<4>(is_signed),
        8 => cells.column::<8>(is_signed),
        _ => None,
    }
}

/// Where the numbers of a column are in the bytes of a dataset.
struct NumberCells<'a> {
    bytes: &'a [u8],
    offset: usize,
    stride: usize,
    is_big_endian: bool,
}

impl NumberCells<'_> {
    /// Numbers of `N` bytes: signed or unsigned, or floats.
    fn column<const N: usize>(&self, is_signed: Option<bool>) -> Option<Column> {
        let bits = self.bytes.chunks_exact(self.stride).map(|record| {
            let mut cell = [0; 8];
            cell[..N].copy_from_slice(&record[self.offset..self.offset + N]);
            if self.is_big_endian {
                cell[..N].reverse();
            }
            u64::from_le_bytes(cell)
        });
        let unused = 64 - 8 * N as u32;
        Some(match (is_signed, N) {
            (Some(true), _) => {
                Column::Int(bits.map(|bits| ((bits << unused) as i64) >> unused).collect())
            }
            (Some(false), _) => {
                Column::Int(bits.map(|bits| i64::try_from(bits).unwrap_or(i64::MAX)).collect())
            }
            (None, 4) => {
                Column::Float(bits.map(|bits| f32::from_bits(bits as u32).into()).collect())
            }
            (None, 8) => Column::Float(bits.map(f64::from_bits).collect()),
            (None, _) => return None,
        })
    }
}
