//! `sensor_msgs/Image`.

use super::{MessageCursor, sensor_size};
use evrig_core::frame::{Channels, Frame, FrameTiming, Samples};
use evrig_core::time::{Davis, Stamp};

/// How the samples of a pixel are stored.
struct PixelFormat {
    channels: Channels,
    sample_bytes: usize,
    /// Red, not blue, is the first.
    is_rgb: bool,
}

/// The formats that hold brightness or plain colour. Bayer mosaics, YUV and floating-point images
/// would have to be converted on assumptions.
fn format(encoding: &str) -> Option<PixelFormat> {
    let (channels, sample_bytes, is_rgb) = match encoding {
        "mono8" | "8UC1" => (Channels::Gray, 1, false),
        "mono16" | "16UC1" => (Channels::Gray, 2, false),
        "bgr8" | "8UC3" => (Channels::Bgr, 1, false),
        "rgb8" => (Channels::Bgr, 1, true),
        "bgra8" | "8UC4" => (Channels::Bgra, 1, false),
        "rgba8" => (Channels::Bgra, 1, true),
        _ => return None,
    };
    Some(PixelFormat { channels, sample_bytes, is_rgb })
}

/// The frame of a message, or the encoding that is not read; none for a malformed message.
pub(super) fn frame(cursor: &mut MessageCursor<'_>) -> Option<Result<Frame<Davis>, String>> {
    let stamp = Stamp::from_nanos(cursor.header()?);
    let (height, width) = (cursor.u32()?, cursor.u32()?);
    let encoding = cursor.text()?;
    let is_big_endian = cursor.u8()? != 0;
    let step = cursor.u32()? as usize;
    let data = cursor.bytes()?;
    let Some(format) = format(&encoding) else { return Some(Err(encoding)) };
    let size = sensor_size(width, height)?;
    let n_pixel = format.channels.count() * format.sample_bytes;
    let n_row = usize::from(size.width) * n_pixel;
    if step < n_row || data.len() < step.checked_mul(usize::from(size.height) - 1)? + n_row {
        return None;
    }
    let rows = data.chunks(step).take(size.height.into());
    let mut bytes: Vec<u8> = rows.flat_map(|row| &row[..n_row]).copied().collect();
    if format.is_rgb {
        bytes.chunks_exact_mut(n_pixel).for_each(|pixel| pixel.swap(0, 2));
    }
    let word = |pair: &[u8]| match is_big_endian {
        true => u16::from_be_bytes([pair[0], pair[1]]),
        false => u16::from_le_bytes([pair[0], pair[1]]),
    };
    let samples = match format.sample_bytes {
        1 => Samples::U8(bytes),
        _ => Samples::U16(bytes.chunks_exact(2).map(word).collect()),
    };
    let timing = FrameTiming::from_stamp(stamp);
    Some(Ok(Frame { timing, size, origin: [0, 0], channels: format.channels, samples }))
}
