//! Memory for packets, and the failure to decompress one into it.

/// Why a payload could not be decompressed.
#[derive(Debug)]
pub(super) enum DecompressFailure {
    /// It grows beyond the limit given.
    TooLarge,
    /// Description of the damage.
    Damaged(String),
}

impl DecompressFailure {
    pub(super) fn into_text(self) -> String {
        match self {
            Self::TooLarge => "more bytes than a packet may have".to_owned(),
            Self::Damaged(found) => found,
        }
    }
}

/// Makes memory at least `n` bytes long.
pub(super) fn grow(memory: &mut Vec<u8>, n: usize) {
    if memory.len() < n {
        memory.resize(n, 0);
    }
}
