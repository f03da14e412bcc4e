//! Compression of packets.

use super::MAX_PACKET_BYTES;
use aedat::base::ioheader_generated::Compression as Code;
use std::io::{self, Read, Write};

/// How the packets of a file are compressed; one way for the whole file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Compression {
    /// Not at all: 16 bytes an event, the fastest to read.
    None,
    /// LZ4 frames, which DV uses unless told otherwise.
    #[default]
    Lz4,
    /// Zstandard frames: smaller and slower.
    Zstd,
}

impl Compression {
    /// The way behind a code of the header; none for a code without meaning.
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

/// Why a payload could not be decompressed.
#[derive(Debug)]
pub(super) enum Undecodable {
    /// It grows beyond the limit given.
    TooLarge,
    /// It is not what it should be, in words.
    Damaged(String),
}

impl Undecodable {
    pub(super) fn into_text(self) -> String {
        match self {
            Self::TooLarge => "more bytes than a packet may have".to_owned(),
            Self::Damaged(found) => found,
        }
    }
}

/// Decompresses `raw` into `plain`, which is cleared first and grows to at most `limit` bytes.
pub(super) fn decompress(
    how: Compression,
    raw: &[u8],
    limit: usize,
    plain: &mut Vec<u8>,
) -> Result<(), Undecodable> {
    plain.clear();
    let read = match how {
        Compression::None => {
            plain.extend_from_slice(raw);
            Ok(raw.len())
        }
        Compression::Lz4 => {
            lz4::Decoder::new(raw).and_then(|decoder| read_up_to(decoder, limit, plain))
        }
        Compression::Zstd => zstd::stream::Decoder::with_buffer(raw)
            .and_then(|decoder| read_up_to(decoder, limit, plain)),
    };
    match read {
        Ok(n) if n > limit => Err(Undecodable::TooLarge),
        Ok(_) => Ok(()),
        Err(error) => Err(Undecodable::Damaged(error.to_string())),
    }
}

fn read_up_to(decoder: impl Read, limit: usize, plain: &mut Vec<u8>) -> io::Result<usize> {
    decoder.take(limit as u64 + 1).read_to_end(plain)
}

/// Compresses one payload.
pub(super) fn compress(how: Compression, plain: &[u8]) -> io::Result<Vec<u8>> {
    if plain.len() > MAX_PACKET_BYTES {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "packet above the size limit"));
    }
    match how {
        Compression::None => Ok(plain.to_vec()),
        Compression::Lz4 => {
            let mut encoder = lz4::EncoderBuilder::new().build(Vec::new())?;
            encoder.write_all(plain)?;
            let (raw, finished) = encoder.finish();
            finished.map(|()| raw)
        }
        Compression::Zstd => zstd::bulk::compress(plain, 1),
    }
}
