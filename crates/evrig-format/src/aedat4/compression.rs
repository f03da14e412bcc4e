//! Compression of packets.

use super::memory::{DecompressFailure, grow};
use super::{MAX_PACKET_BYTES, lz4_frame};
use aedat::base::ioheader_generated::Compression as Code;
use evrig_core::keyword::UnknownKeyword;
use std::cell::RefCell;
use std::io::{self, Read};
use std::str::FromStr;

/// The fastest of the usual levels.
const ZSTD_LEVEL: i32 = 1;

/// Compression of the packets of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Compression {
    /// None: 16 bytes per event, the fastest to read.
    None,
    /// LZ4 frames, the default of DV.
    #[default]
    Lz4,
    /// Zstandard frames: smaller and slower.
    Zstd,
}

impl Compression {
    /// The compression of a header's code; none for an unknown code.
    pub(super) fn from_code(code: Code) -> Option<Self> {
        match code {
            Code::None => Some(Self::None),
            Code::Lz4 | Code::Lz4High => Some(Self::Lz4),
            Code::Zstd | Code::ZstdHigh => Some(Self::Zstd),
            _ => None,
        }
    }

    pub(super) fn code(self) -> Code {
        match self {
            Self::None => Code::None,
            Self::Lz4 => Code::Lz4,
            Self::Zstd => Code::Zstd,
        }
    }

    /// The name in the header's description.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "NONE",
            Self::Lz4 => "LZ4",
            Self::Zstd => "ZSTD",
        }
    }
}

impl FromStr for Compression {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        match text {
            "none" => Ok(Self::None),
            "lz4" => Ok(Self::Lz4),
            "zstd" => Ok(Self::Zstd),
            _ => Err(UnknownKeyword::new(text, "none, lz4 or zstd")),
        }
    }
}

thread_local! {
    /// Buffer between decompression and decoding, or encoding and compression. It is kept
    /// because newly allocated memory is cleared page by page, which costs more
    /// than decoding does.
    static SCRATCH: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

thread_local! {
    /// The compressor's tables, kept for the same reason.
    static ZSTD: RefCell<Option<zstd::bulk::Compressor<'static>>> = const { RefCell::new(None) };
}

/// Scratch above this size is given back after use.
const KEPT_SCRATCH_BYTES: usize = 1 << 23;

/// Lends the thread's scratch buffer, whose length and content are arbitrary.
pub(super) fn with_scratch<T>(act: impl FnOnce(&mut Vec<u8>) -> T) -> T {
    SCRATCH.with(|scratch| {
        // The scratch is only in use here if `act` came back to this thread for another packet.
        let mut own = scratch.take();
        let result = act(&mut own);
        if own.len() <= KEPT_SCRATCH_BYTES {
            scratch.replace(own);
        }
        result
    })
}

/// Decompresses `raw` and passes the result on; takes at most `limit` bytes of memory for it.
pub(super) fn decompress<T>(
    compression: Compression,
    raw: &[u8],
    limit: usize,
    pass_on: impl FnOnce(&[u8]) -> T,
) -> Result<T, DecompressFailure> {
    match compression {
        Compression::None => Ok(pass_on(raw)),
        Compression::Lz4 => with_scratch(|plain| {
            let n = lz4_frame::decompress(raw, limit, plain)?;
            Ok(pass_on(&plain[..n]))
        }),
        Compression::Zstd => with_scratch(|plain| {
            plain.clear();
            let n = zstd::stream::Decoder::with_buffer(raw)
                .and_then(|decoder| decoder.take(limit as u64 + 1).read_to_end(plain))
                .map_err(|error| DecompressFailure::Damaged(error.to_string()))?;
            if n > limit { Err(DecompressFailure::TooLarge) } else { Ok(pass_on(plain)) }
        }),
    }
}

/// Compresses one payload to `out`, from the byte `at`, and returns its end; `out` grows as
/// needed and is never shrunk.
pub(super) fn compress(
    compression: Compression,
    plain: &[u8],
    out: &mut Vec<u8>,
    at: usize,
) -> io::Result<usize> {
    if plain.len() > MAX_PACKET_BYTES {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "packet above the size limit"));
    }
    match compression {
        Compression::None => {
            grow(out, at + plain.len());
            out[at..at + plain.len()].copy_from_slice(plain);
            Ok(at + plain.len())
        }
        Compression::Lz4 => lz4_frame::compress(plain, out, at),
        Compression::Zstd => {
            grow(out, at + zstd::zstd_safe::compress_bound(plain.len()));
            ZSTD.with(|own| {
                let mut own = own.borrow_mut();
                let compressor = match &mut *own {
                    Some(compressor) => compressor,
                    none => none.insert(zstd::bulk::Compressor::new(ZSTD_LEVEL)?),
                };
                Ok(at + compressor.compress_to_buffer(plain, &mut out[at..])?)
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_a_description_are_understood_and_others_are_refused() {
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
            assert_eq!(compression.name().to_lowercase().parse(), Ok(compression));
        }
        for wrong in ["", "LZ4", "gzip"] {
            let error = wrong.parse::<Compression>().unwrap_err().to_string();
            assert!(error.contains("none, lz4 or zstd"), "{error}");
        }
    }
}
