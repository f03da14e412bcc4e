//! A frame's images behind its head: their lengths proven before anything is unpacked.

use crate::coding::{self, CodingError};
use crate::order::Coding;
use evrig_core::geometry::Size;
use evrig_core::pi_camera::{FrameMetadata, PiFrame};
use evrig_core::raw10;
use serde::{Deserialize, Serialize};

/// The longest message: a full 12-megapixel frame, raw and RGB, and some margin.
pub const MAX_MESSAGE_BYTES: usize = 64 << 20;

/// Bytes of an image on the wire, and how they are coded.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct ImageHead {
    pub(super) n_bytes: usize,
    pub(super) coding: Coding,
}

/// A frame from its parts; its size is checked before anything is unpacked to that size.
pub(super) fn frame(
    metadata: FrameMetadata,
    raw: Option<ImageHead>,
    rgb: Option<ImageHead>,
    bytes: &[u8],
) -> Result<PiFrame, String> {
    let size = metadata.size;
    let row = raw10::row_bytes(size.width).map_err(|error| error.to_string())?;
    let lengths = [row * usize::from(size.height), 3 * size.n_pixels()];
    let in_words = || {
        let found = [raw, rgb].map(|image| image.map(|image| image.n_bytes));
        format!(
            "a frame of {size} has images of {lengths:?} bytes, found {found:?} in {}",
            bytes.len()
        )
    };
    if lengths[1] > MAX_MESSAGE_BYTES {
        return Err(format!("a frame of {size} is larger than a message may be"));
    }
    let n_raw = raw.map_or(0, |image| image.n_bytes);
    let n_rgb = rgb.map_or(0, |image| image.n_bytes);
    let is_wrong = |image: Option<ImageHead>, length| {
        image.is_some_and(|it| it.coding == Coding::Plain && it.n_bytes != length)
    };
    let split = bytes.split_at_checked(n_raw).filter(|(_, behind)| behind.len() == n_rgb);
    let Some((raw_bytes, rgb_bytes)) = split else { return Err(in_words()) };
    if is_wrong(raw, lengths[0]) || is_wrong(rgb, lengths[1]) {
        return Err(in_words());
    }
    let decoded = |image: Option<ImageHead>, bytes: &[u8], decode: Decode| {
        image.map(|image| match image.coding {
            Coding::Plain => Ok(bytes.to_vec()),
            Coding::Lossless => decode(bytes, size).map_err(|error| error.to_string()),
        })
    };
    let (raw10, rgb) = rayon::join(
        || decoded(raw, raw_bytes, coding::decode_raw10).transpose(),
        || decoded(rgb, rgb_bytes, coding::decode_rgb).transpose(),
    );
    Ok(PiFrame { metadata, raw10: raw10?, rgb: rgb? })
}

type Decode = fn(&[u8], Size) -> Result<Vec<u8>, CodingError>;
