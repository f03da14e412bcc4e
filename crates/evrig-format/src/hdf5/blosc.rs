//! Blosc 1 frames, as the HDF5 filter 32001 stores them: blocks of LZ4, Zstandard or zlib data.
//!
//! Layout: <https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>. The crates for
//! Blosc bind the C library; its container is small, and the codecs are here already.

use std::io::Read;

const HEADER_BYTES: usize = 16;
const SHUFFLED: u8 = 1;
const STORED: u8 = 2;
const BIT_SHUFFLED: u8 = 4;
const UNSPLIT: u8 = 16;

/// Smallest part of a split block, and the largest type that is split (`split_block` of c-blosc).
const MIN_BUFFER_BYTES: usize = 128;
const MAX_SPLITS: usize = 16;

/// Decompresses one frame that should hold at most `n_max` bytes.
pub(super) fn decompress(frame: &[u8], n_max: usize) -> Result<Vec<u8>, String> {
    let cut = || "the Blosc frame is cut".to_owned();
    let header = frame.get(..HEADER_BYTES).ok_or_else(cut)?;
    let word = |at: usize| -> Option<usize> {
        let bytes = frame.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_le_bytes(bytes) as usize)
    };
    let (flags, type_bytes) = (header[2], usize::from(header[3]).max(1));
    let n_bytes = word(4).ok_or_else(cut)?;
    let block_bytes = word(8).ok_or_else(cut)?;
    if n_bytes > n_max || (block_bytes == 0 && n_bytes > 0) {
        return Err(format!("the Blosc frame claims {n_bytes} bytes of at most {n_max}"));
    }
    if flags & STORED != 0 {
        let stored = frame.get(HEADER_BYTES..HEADER_BYTES + n_bytes).ok_or_else(cut)?;
        return Ok(stored.to_vec());
    }
    let mut plain = Vec::with_capacity(n_bytes);
    for block in 0..n_bytes.div_ceil(block_bytes.max(1)) {
        let n = block_bytes.min(n_bytes - block * block_bytes);
        let start = word(HEADER_BYTES + 4 * block).ok_or_else(cut)?;
        let is_last_part = n < block_bytes;
        let is_split = flags & UNSPLIT == 0
            && !is_last_part
            && type_bytes <= MAX_SPLITS
            && n / type_bytes >= MIN_BUFFER_BYTES;
        let n_parts = if is_split { type_bytes } else { 1 };
        let mut at = start;
        let mut data = Vec::with_capacity(n);
        for _ in 0..n_parts {
            let length = word(at).ok_or_else(cut)?;
            let part = frame.get(at + 4..at + 4 + length).ok_or_else(cut)?;
            let n_part = n / n_parts;
            match length == n_part {
                true => data.extend_from_slice(part),
                false => data.extend(decode(flags >> 5, part, n_part)?),
            }
            at += 4 + length;
        }
        if data.len() != n {
            return Err(format!("a Blosc block holds {} of {n} bytes", data.len()));
        }
        plain.extend(match (flags & SHUFFLED != 0, flags & BIT_SHUFFLED != 0) {
            (true, _) if type_bytes > 1 => unshuffle(&data, type_bytes),
            (false, true) => bit_unshuffle(&data, type_bytes),
            _ => data,
        });
    }
    Ok(plain)
}

fn decode(codec: u8, part: &[u8], n: usize) -> Result<Vec<u8>, String> {
    match codec {
        1 => lz4_flex::block::decompress(part, n).map_err(|error| error.to_string()),
        3 => {
            let mut plain = Vec::new();
            let reader = flate2::read::ZlibDecoder::new(part);
            let read = reader.take(n as u64).read_to_end(&mut plain);
            read.map(|_| plain).map_err(|error| error.to_string())
        }
        4 => zstd::bulk::decompress(part, n).map_err(|error| error.to_string()),
        codec => Err(format!(
            "Blosc codec {codec} ({}) is not read; rewrite it with gzip (h5repack)",
            if codec == 0 { "BloscLZ" } else { "Snappy or other" }
        )),
    }
}

/// Undoes the byte shuffle: first all first bytes, then all second bytes, ...
pub(super) fn unshuffle(data: &[u8], size: usize) -> Vec<u8> {
    let mut plain = data.to_vec();
    match size {
        0 | 1 => {}
        // Lengths that the compiler knows are several times faster.
        2 => join_planes::<2>(data, plain.as_chunks_mut().0),
        4 => join_planes::<4>(data, plain.as_chunks_mut().0),
        8 => join_planes::<8>(data, plain.as_chunks_mut().0),
        _ => {
            let n = data.len() / size;
            for (i, record) in plain.chunks_exact_mut(size).enumerate() {
                for (j, byte) in record.iter_mut().enumerate() {
                    *byte = data[j * n + i];
                }
            }
        }
    }
    plain
}

/// Gathers each record from planes of its first bytes, its second bytes, and so on.
fn join_planes<const N: usize>(planes: &[u8], records: &mut [[u8; N]]) {
    let n = records.len();
    let planes: [&[u8]; N] = std::array::from_fn(|j| &planes[j * n..(j + 1) * n]);
    for (i, record) in records.iter_mut().enumerate() {
        *record = planes.map(|plane| plane[i]);
    }
}

/// Undoes the bit shuffle of the elements, whose number is cut to a multiple of eight.
fn bit_unshuffle(data: &[u8], size: usize) -> Vec<u8> {
    let n = data.len() / size / 8 * 8;
    let mut plain = data.to_vec();
    plain[..n * size].fill(0);
    for bit in 0..size * 8 {
        let row = &data[bit * n / 8..(bit + 1) * n / 8];
        for i in 0..n {
            let set = (row[i / 8] >> (i % 8)) & 1;
            plain[i * size + bit / 8] |= set << (bit % 8);
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shuffle(data: &[u8], size: usize) -> Vec<u8> {
        let n = data.len() / size;
        (0..data.len()).map(|i| data[i % n * size + i / n]).collect()
    }

    /// A frame of blocks, each of parts as long as the layout demands.
    fn frame(
        codec: u8,
        flags: u8,
        size: u8,
        n_bytes: usize,
        block: usize,
        parts: &[u8],
    ) -> Vec<u8> {
        let n_blocks = n_bytes.div_ceil(block);
        let mut bytes = vec![2, 1, flags | (codec << 5), size];
        let lengths = [n_bytes as u32, block as u32, (16 + 4 * n_blocks + parts.len()) as u32];
        bytes.extend(lengths.iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend((0..n_blocks).flat_map(|_| (16 + 4 * n_blocks as u32).to_le_bytes()));
        bytes.extend(parts);
        bytes
    }

    fn part(data: &[u8]) -> Vec<u8> {
        [&(data.len() as u32).to_le_bytes()[..], data].concat()
    }

    #[test]
    fn split_shuffled_and_stored_frames_are_decompressed() {
        let plain: Vec<u8> = (0..512_u32).flat_map(|i| (i / 3).to_le_bytes()).collect();
        let shuffled = shuffle(&plain, 4);
        let zstd = part(&zstd::bulk::compress(&shuffled, 3).unwrap());
        let whole = frame(4, SHUFFLED | UNSPLIT, 4, plain.len(), plain.len(), &zstd);
        assert_eq!(decompress(&whole, plain.len()).unwrap(), plain);
        let lanes = shuffled.chunks(512);
        let lz4: Vec<u8> = lanes.flat_map(|lane| part(&lz4_flex::block::compress(lane))).collect();
        let split = frame(1, SHUFFLED, 4, plain.len(), plain.len(), &lz4);
        assert_eq!(decompress(&split, plain.len()).unwrap(), plain);
        let header = frame(1, STORED, 4, 8, 8, &[])[..HEADER_BYTES].to_vec();
        assert_eq!(decompress(&[&header[..], &plain[..8]].concat(), 8).unwrap(), plain[..8]);
        assert!(decompress(&split[..100], plain.len()).unwrap_err().contains("cut"));
        assert!(decompress(&whole, 16).unwrap_err().contains("claims"));
    }

    #[test]
    fn shuffled_bits_return_to_their_elements() {
        let plain: Vec<u8> = (0..16_u16).flat_map(|i| (i * 1_000).to_le_bytes()).collect();
        let mut bits = vec![0_u8; 32];
        for (i, element) in plain.chunks(2).enumerate() {
            for bit in 0..16 {
                bits[bit * 2 + i / 8] |= ((element[bit / 8] >> (bit % 8)) & 1) << (i % 8);
            }
        }
        assert_eq!(bit_unshuffle(&bits, 2), plain);
    }
}
