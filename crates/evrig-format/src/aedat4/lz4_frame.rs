//! LZ4 frames, block by block (LZ4 frame format 1.6.4).
//!
//! DV chains blocks of 64 KiB, each of which may refer to the one before. They are decoded in
//! place one after another, which avoids the copies of a streaming decoder, and a frame
//! without its end mark is detected, which streaming decoders accept at a block's end. Frames
//! written here state their size and have independent blocks with a checksum each, so that a flipped
//! bit is found when the file is read. Checksums of blocks cover the compressed bytes, half as many
//! as the content: XXH32 of the content takes a third of the time of its compression.

use super::memory::{DecompressFailure, grow};
use lz4::block::{CompressionMode, compress_bound, compress_to_buffer};
use lz4_flex::block::{DecompressError, decompress_into_with_dict};
use std::io;
use twox_hash::XxHash32;

const MAGIC: [u8; 4] = [0x04, 0x22, 0x4d, 0x18];

/// Version 01 in the two highest bits of the flags, which end in a reserved bit and the
/// dictionary's.
const VERSION: u8 = 0x40;
/// Bits that must be as in [`VERSION`]: version, reserved, dictionary (which AEDAT4 never has).
const FIXED_FLAGS: u8 = 0xc3;
/// Flag: blocks do not refer to one another.
const IS_INDEPENDENT: u8 = 0x20;
/// Flag: a checksum follows each block.
const HAS_BLOCK_SUMS: u8 = 0x10;
/// Flag: eight bytes of content size follow the flags.
const HAS_CONTENT_SIZE: u8 = 0x08;
/// Flag: a checksum of the content follows the end.
const HAS_CONTENT_SUM: u8 = 0x04;

/// Bytes of a written frame without its blocks: magic, descriptor with the size and its checksum; end
/// mark.
const HEAD_AND_END_BYTES: usize = 15 + 4;

/// Bytes of a written block besides the compressed data: length and checksum.
const BLOCK_FRAMING_BYTES: usize = 8;

/// Largest block of a written frame, and its descriptor. Up to this size the library compresses with
/// offsets of 16 bits, an eighth faster than larger blocks and 2 % larger.
const WRITTEN_BLOCKS: (u8, usize) = BLOCK_SIZES[0];

/// Largest offset of a match.
const MAX_MATCH_OFFSET: usize = 1 << 16;

/// Bit of a block's length for an uncompressed block.
const IS_STORED: u32 = 1 << 31;

/// Descriptor and largest block, smallest first.
const BLOCK_SIZES: [(u8, usize); 4] =
    [(0x40, 1 << 16), (0x50, 1 << 18), (0x60, 1 << 20), (0x70, 1 << 22)];

/// Decompresses into the first bytes of `plain` and returns their number; `plain` grows as needed
/// and is never shrunk, because growing clears memory.
pub(super) fn decompress(
    raw: &[u8],
    limit: usize,
    plain: &mut Vec<u8>,
) -> Result<usize, DecompressFailure> {
    let mut rest = raw;
    let (flags, largest, stated) = read_head(&mut rest)?;
    let mut n = 0;
    loop {
        let length = take_u32(&mut rest)?;
        if length == 0 {
            break;
        }
        let block = take(&mut rest, (length & !IS_STORED) as usize)?;
        if flags & HAS_BLOCK_SUMS != 0 {
            check_sum(block, take_u32(&mut rest)?)?;
        }
        n += decompress_block(block, length & IS_STORED != 0, largest, n, limit, plain)?;
    }
    if flags & HAS_CONTENT_SUM != 0 {
        check_sum(&plain[..n], take_u32(&mut rest)?)?;
    }
    match stated {
        Some(stated) if stated != n as u64 => Err(damaged("an LZ4 frame of another size")),
        _ => Ok(n),
    }
}

/// Reads the head of a frame: flags, size of the largest block, and size of the content where stated.
fn read_head(rest: &mut &[u8]) -> Result<(u8, usize, Option<u64>), DecompressFailure> {
    if take(rest, 4)? != MAGIC {
        return Err(damaged("no LZ4 frame"));
    }
    let from = *rest;
    let descriptor = take(rest, 2)?;
    let (flags, code) = (descriptor[0], descriptor[1]);
    if flags & FIXED_FLAGS != VERSION {
        return Err(damaged("an LZ4 frame of another version or with a dictionary"));
    }
    let mut stated = None;
    if flags & HAS_CONTENT_SIZE != 0 {
        let [low, high] = [take_u32(rest)?, take_u32(rest)?].map(u64::from);
        stated = Some(low | high << 32);
    }
    let described = &from[..from.len() - rest.len()];
    if take(rest, 1)? != [head_sum(described)] {
        return Err(damaged("an LZ4 frame whose head does not match its checksum"));
    }
    let largest = BLOCK_SIZES.iter().find(|(descriptor, _)| *descriptor == code);
    let (_, largest) = largest.ok_or_else(|| damaged("an LZ4 frame of unknown block size"))?;
    Ok((flags, *largest, stated))
}

fn head_sum(descriptor: &[u8]) -> u8 {
    (XxHash32::oneshot(0, descriptor) >> 8) as u8
}

fn check_sum(bytes: &[u8], expected: u32) -> Result<(), DecompressFailure> {
    if XxHash32::oneshot(0, bytes) == expected {
        Ok(())
    } else {
        Err(damaged("an LZ4 frame that does not match its checksum"))
    }
}

/// Decompresses one block to `plain[n..]` and returns the number of bytes.
fn decompress_block(
    block: &[u8],
    is_stored: bool,
    largest: usize,
    n: usize,
    limit: usize,
    plain: &mut Vec<u8>,
) -> Result<usize, DecompressFailure> {
    let room = largest.min(limit - n);
    grow(plain, n + room);
    let (before, after) = plain.split_at_mut(n);
    let target = &mut after[..room];
    let is_full = || {
        if room < largest {
            DecompressFailure::TooLarge
        } else {
            damaged("an LZ4 block above its size")
        }
    };
    if is_stored {
        let Some(target) = target.get_mut(..block.len()) else { return Err(is_full()) };
        target.copy_from_slice(block);
        return Ok(block.len());
    }
    let reach = &before[n.saturating_sub(MAX_MATCH_OFFSET)..];
    decompress_into_with_dict(block, target, reach).map_err(|error| match error {
        DecompressError::OutputTooSmall { .. } => is_full(),
        error => DecompressFailure::Damaged(format!("an LZ4 block with an error ({error})")),
    })
}

fn take_u32(rest: &mut &[u8]) -> Result<u32, DecompressFailure> {
    let bytes = take(rest, 4)?;
    Ok(bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte)))
}

fn take<'a>(rest: &mut &'a [u8], n: usize) -> Result<&'a [u8], DecompressFailure> {
    rest.split_off(..n).ok_or_else(|| damaged("an LZ4 frame that ends early"))
}

fn damaged(found: &str) -> DecompressFailure {
    DecompressFailure::Damaged(found.to_owned())
}

/// Compresses to a frame, in `out` from the byte `at`, and returns its end; `out` grows as needed
/// and is never shrunk.
pub(super) fn compress(plain: &[u8], out: &mut Vec<u8>, at: usize) -> io::Result<usize> {
    let (code, largest) = WRITTEN_BLOCKS;
    let n_blocks = plain.len().div_ceil(largest);
    let block_bytes = compress_bound(plain.len().min(largest))? + BLOCK_FRAMING_BYTES;
    grow(out, at + HEAD_AND_END_BYTES + n_blocks * block_bytes);
    let mut end = at;
    put(out, &mut end, &MAGIC);
    let flags = VERSION | IS_INDEPENDENT | HAS_BLOCK_SUMS | HAS_CONTENT_SIZE;
    put(out, &mut end, &[flags, code]);
    put(out, &mut end, &(plain.len() as u64).to_le_bytes());
    let sum = head_sum(&out[at + MAGIC.len()..end]);
    put(out, &mut end, &[sum]);
    for block in plain.chunks(largest) {
        let mode = Some(CompressionMode::FAST(1));
        let n = compress_to_buffer(block, mode, false, &mut out[end + 4..])?;
        if n < block.len() {
            put(out, &mut end, &(n as u32).to_le_bytes());
            end += n;
        } else {
            put(out, &mut end, &(block.len() as u32 | IS_STORED).to_le_bytes());
            put(out, &mut end, block);
        }
        let sum = XxHash32::oneshot(0, &out[end - n.min(block.len())..end]);
        put(out, &mut end, &sum.to_le_bytes());
    }
    put(out, &mut end, &[0; 4]);
    Ok(end)
}

/// Copies bytes to `end` and advances it; `out` must be long enough.
fn put(out: &mut [u8], end: &mut usize, bytes: &[u8]) {
    out[*end..*end + bytes.len()].copy_from_slice(bytes);
    *end += bytes.len();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::{Read, Write};

    /// Bytes that compress like events do: some repeat, some do not.
    fn bytes_of(n: usize, seed: u64) -> Vec<u8> {
        let mut state = seed | 1;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 56) as u8
        };
        (0..n).map(|i| if i % 16 < 5 { next() } else { (i % 16) as u8 }).collect()
    }

    fn decompressed(raw: &[u8], limit: usize) -> Result<Vec<u8>, DecompressFailure> {
        let mut plain = vec![7; 10];
        let n = decompress(raw, limit, &mut plain)?;
        Ok(plain[..n].to_vec())
    }

    fn frame_of(plain: &[u8]) -> Vec<u8> {
        // What the memory held before does not show.
        let mut out = vec![0xee; 1_000];
        let end = compress(plain, &mut out, 3).unwrap();
        out[3..end].to_vec()
    }

    /// A frame as the C library writes it with these choices.
    fn c_frame(plain: &[u8], is_linked: bool, size: lz4::BlockSize, has_sums: bool) -> Vec<u8> {
        use lz4::liblz4::BlockChecksum::{BlockChecksumEnabled, NoBlockChecksum};
        let mut encoder = lz4::EncoderBuilder::new()
            .block_size(size)
            .block_mode(if is_linked {
                lz4::BlockMode::Linked
            } else {
                lz4::BlockMode::Independent
            })
            .block_checksum(if has_sums { BlockChecksumEnabled } else { NoBlockChecksum })
            .checksum(if has_sums {
                lz4::ContentChecksum::ChecksumEnabled
            } else {
                lz4::ContentChecksum::NoChecksum
            })
            .build(Vec::new())
            .unwrap();
        encoder.write_all(plain).unwrap();
        let (raw, finished) = encoder.finish();
        finished.unwrap();
        raw
    }

    #[test]
    fn frames_of_the_c_library_are_read_whatever_their_options() {
        use lz4::BlockSize::{Max1MB, Max4MB, Max64KB, Max256KB};
        for n in [0, 1, 100, 65_536, 65_537, 300_000, 5_000_000] {
            let plain = bytes_of(n, 5);
            for size in [Max64KB, Max256KB, Max1MB, Max4MB] {
                for (is_linked, has_sums) in [(true, false), (false, false), (true, true)] {
                    let raw = c_frame(&plain, is_linked, size.clone(), has_sums);
                    assert!(decompressed(&raw, n).unwrap() == plain, "{n} bytes");
                }
            }
        }
    }

    #[test]
    fn the_c_library_reads_our_frames_of_every_size() {
        for n in [0, 1, 65_536, 65_537, 262_145, 1_048_577, 4_194_304, 9_000_000] {
            let plain = bytes_of(n, 9);
            let raw = frame_of(&plain);
            let mut back = Vec::new();
            lz4::Decoder::new(raw.as_slice()).unwrap().read_to_end(&mut back).unwrap();
            assert!(back == plain, "{n} bytes");
            assert!(decompressed(&raw, n).unwrap() == plain, "{n} bytes");
        }
    }

    #[test]
    fn a_frame_cut_anywhere_is_damaged() {
        let plain = bytes_of(70_000, 1);
        for has_sums in [false, true] {
            let raw = c_frame(&plain, true, lz4::BlockSize::Max64KB, has_sums);
            for cut in (0..raw.len()).step_by(97).chain(raw.len() - 12..raw.len()) {
                let outcome = decompressed(&raw[..cut], 1 << 20);
                let is_damaged = matches!(outcome, Err(DecompressFailure::Damaged(_)));
                assert!(is_damaged, "cut at {cut} of {}", raw.len());
            }
        }
    }

    #[test]
    fn nothing_grows_beyond_the_limit() {
        let plain = vec![0; 3 << 20];
        for raw in [
            frame_of(&plain),
            c_frame(&plain, true, lz4::BlockSize::Max64KB, false),
            c_frame(&plain, true, lz4::BlockSize::Max64KB, true),
        ] {
            let mut space = Vec::new();
            let error = decompress(&raw, plain.len() - 1, &mut space).unwrap_err();
            assert!(matches!(error, DecompressFailure::TooLarge), "{error:?}");
            assert!(space.len() <= plain.len());
        }
    }

    proptest! {
        #[test]
        fn what_goes_in_comes_out(plain in prop::collection::vec(any::<u8>(), 0..3_000)) {
            let raw = frame_of(&plain);
            prop_assert_eq!(decompressed(&raw, plain.len()).unwrap(), plain);
        }

        #[test]
        fn a_changed_byte_in_our_frames_is_found_if_it_matters(
            at in any::<prop::sample::Index>(), change in 1..=u8::MAX,
        ) {
            let plain = bytes_of(70_000, 3);
            let mut raw = frame_of(&plain);
            let at = at.index(raw.len());
            raw[at] ^= change;
            // A match may be found elsewhere as well; then the content is the same.
            let is_found = decompressed(&raw, 1 << 20).map_or(true, |same| same == plain);
            prop_assert!(is_found, "byte {}", at);
        }

        #[test]
        fn damage_never_panics(seed in any::<u64>(), at in any::<prop::sample::Index>(), value in any::<u8>()) {
            let mut raw = c_frame(&bytes_of(70_000, seed), true, lz4::BlockSize::Max64KB, false);
            let at = at.index(raw.len());
            raw[at] = value;
            let _ = decompressed(&raw, 1 << 20);
        }
    }
}
