//! The pixel formats that libcamera gives, made into the two that evrig records.

use crate::source::SourceError;
use evrig_core::geometry::Size;
use evrig_core::raw10;

/// The memory layout of raw samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    /// RAW10: four samples in five bytes.
    Packed,
    /// 16-bit little-endian, the sample in the low bits (Pi 4).
    Right,
    /// 16-bit little-endian, the sample in the high bits (Pi 5).
    Left,
}

/// A raw format: packing, and order of the colours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RawFormat {
    packing: Packing,
    bayer: String,
}

impl RawFormat {
    /// Reads a name such as `SRGGB10_CSI2P`.
    pub(super) fn parse(name: &str) -> Result<Self, SourceError> {
        if name.contains("PISP_COMP") {
            return Err(SourceError::new(format!(
                "the raw format {name} is compressed with losses; update python3-picamera2"
            )));
        }
        let parts = name.strip_prefix('S').and_then(|rest| rest.split_at_checked(4));
        let packing = match parts {
            Some((_, "10_CSI2P")) => Some(Packing::Packed),
            Some((_, "10")) => Some(Packing::Right),
            Some((_, "16")) => Some(Packing::Left),
            _ => None,
        };
        let bayer = parts
            .map(|(bayer, _)| bayer)
            .filter(|bayer| ["RGGB", "BGGR", "GRBG", "GBRG"].contains(bayer));
        match (packing, bayer) {
            (Some(packing), Some(bayer)) => Ok(Self { packing, bayer: bayer.to_owned() }),
            _ => Err(SourceError::new(format!(
                "the raw format {name} is unknown; expected 10 bits such as SRGGB10, \
                 SRGGB10_CSI2P, or SRGGB16 of a Pi 5"
            ))),
        }
    }

    pub(super) fn bayer(&self) -> &str {
        &self.bayer
    }

    /// Rows without padding as RAW10.
    pub(super) fn to_raw10(&self, bytes: &[u8], size: Size) -> Result<Vec<u8>, SourceError> {
        let wrong = |error: raw10::Raw10Error| SourceError::new(error.to_string());
        let shift = match self.packing {
            Packing::Packed => {
                let expected =
                    raw10::row_bytes(size.width).map_err(wrong)? * usize::from(size.height);
                return right_length(bytes, expected, size).map(<[u8]>::to_vec);
            }
            Packing::Right => 0,
            Packing::Left => 6,
        };
        let pairs = right_length(bytes, 2 * size.n_pixels(), size)?.chunks_exact(2);
        let samples: Vec<u16> =
            pairs.map(|pair| u16::from_le_bytes([pair[0], pair[1]]) >> shift).collect();
        raw10::pack(&samples, size).map_err(wrong)
    }
}

/// The order of three bytes in memory; libcamera's names go from the highest byte to the lowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RgbOrder {
    /// `BGR888`: R, G, B.
    Rgb,
    /// `RGB888`: B, G, R.
    Bgr,
}

impl RgbOrder {
    pub(super) fn parse(name: &str) -> Result<Self, SourceError> {
        match name {
            "BGR888" => Ok(Self::Rgb),
            "RGB888" => Ok(Self::Bgr),
            _ => Err(SourceError::new(format!(
                "the RGB format {name} is unknown; expected BGR888 or RGB888"
            ))),
        }
    }

    /// Rows without padding as R, G, B.
    pub(super) fn to_rgb(self, bytes: &[u8], size: Size) -> Result<Vec<u8>, SourceError> {
        let mut rgb = right_length(bytes, 3 * size.n_pixels(), size)?.to_vec();
        if self == Self::Bgr {
            rgb.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
        }
        Ok(rgb)
    }
}

fn right_length(bytes: &[u8], expected: usize, size: Size) -> Result<&[u8], SourceError> {
    if bytes.len() == expected {
        return Ok(bytes);
    }
    let found = bytes.len();
    Err(SourceError::new(format!(
        "an image of {size} in this format has {expected} bytes, found {found}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_packing_of_the_same_samples_becomes_the_same_raw10() {
        let size = Size::new(4, 2);
        let samples = [0, 1, 511, 1023, 4, 3, 2, 1000];
        let packed = raw10::pack(&samples, size).unwrap();
        let bytes = |shift: u32| -> Vec<u8> {
            samples.iter().flat_map(|sample| (sample << shift).to_le_bytes()).collect()
        };
        for (name, given) in
            [("SRGGB10_CSI2P", packed.clone()), ("SRGGB10", bytes(0)), ("SRGGB16", bytes(6))]
        {
            let format = RawFormat::parse(name).unwrap();
            assert_eq!(format.to_raw10(&given, size).unwrap(), packed, "{name}");
            assert!(format.to_raw10(&given[1..], size).is_err());
            assert_eq!(format.bayer(), "RGGB");
        }
        let right = RawFormat::parse("SBGGR10").unwrap();
        assert_eq!(right.bayer(), "BGGR");
        // Left-justified samples under a right-justified name are noticed, not folded.
        assert!(right.to_raw10(&bytes(6), size).is_err());
    }

    #[test]
    fn lossy_and_unknown_formats_are_refused() {
        let message = RawFormat::parse("RGGB_PISP_COMP1").unwrap_err().to_string();
        assert!(message.contains("losses"), "{message}");
        for wrong in ["", "S", "SRGGB12", "SRGGB10_X", "SXXXX10", "R10", "Sé"] {
            assert!(RawFormat::parse(wrong).is_err(), "{wrong}");
        }
        assert!(RgbOrder::parse("XRGB8888").is_err());
    }

    #[test]
    fn libcameras_rgb888_lies_in_memory_as_blue_green_red() {
        let size = Size::new(1, 1);
        assert_eq!(RgbOrder::parse("RGB888").unwrap().to_rgb(&[1, 2, 3], size).unwrap(), [3, 2, 1]);
        assert_eq!(RgbOrder::parse("BGR888").unwrap().to_rgb(&[1, 2, 3], size).unwrap(), [1, 2, 3]);
    }
}
