//! RAW10, the packing in which a camera sends 10-bit samples.
//!
//! MIPI CSI-2 (section "RAW10") packs four samples into five bytes: the eight high bits of each, in
//! order, then one byte with the four pairs of low bits, the first sample's lowest. A row is as
//! many whole groups as it has samples, so its width is a multiple of four; a sensor's buffer may
//! pad rows at their end, which is what `stride` is for.

use crate::geometry::Size;

/// The highest sample.
pub const MAX_SAMPLE: u16 = 1023;

/// Why samples or bytes do not make a RAW10 image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Raw10Error {
    /// RAW10 packs four samples at a time.
    #[error("RAW10 has rows of a multiple of 4 samples, not of {width}; crop the image")]
    Width {
        /// Samples in a row.
        width: u16,
    },
    /// Too few or too many bytes or samples.
    #[error("a RAW10 image of {size} has {expected} {what}, found {found}")]
    Length {
        /// The image's size.
        size: Size,
        /// What is counted.
        what: &'static str,
        /// How many there should be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// More than ten bits.
    #[error("sample {index} is {value}, above {MAX_SAMPLE}: not a 10-bit image")]
    Sample {
        /// Which.
        index: usize,
        /// What it is.
        value: u16,
    },
}

/// Bytes of a packed row without padding.
///
/// # Errors
/// When the width is no multiple of four.
pub fn row_bytes(width: u16) -> Result<usize, Raw10Error> {
    if width.is_multiple_of(4) {
        Ok(usize::from(width) / 4 * 5)
    } else {
        Err(Raw10Error::Width { width })
    }
}

/// Packs samples, row after row without padding.
///
/// # Errors
/// When they are not an image of `size`, or one has more than ten bits.
pub fn pack(samples: &[u16], size: Size) -> Result<Vec<u8>, Raw10Error> {
    let n_bytes = row_bytes(size.width)? * usize::from(size.height);
    check_length(size, "samples", size.n_pixels(), samples.len())?;
    if let Some(index) = samples.iter().position(|sample| *sample > MAX_SAMPLE) {
        return Err(Raw10Error::Sample { index, value: samples[index] });
    }
    let mut packed = Vec::with_capacity(n_bytes);
    for group in samples.chunks_exact(4) {
        packed.extend(group.iter().map(|sample| (sample >> 2) as u8));
        let low = |k: usize| ((group[k] & 3) as u8) << (2 * k);
        packed.push(low(0) | low(1) | low(2) | low(3));
    }
    Ok(packed)
}

/// Unpacks rows `stride` bytes apart; the last row may lack its padding.
///
/// # Errors
/// When `packed` is not an image of `size`.
pub fn unpack(packed: &[u8], size: Size, stride: usize) -> Result<Vec<u16>, Raw10Error> {
    let row = row_bytes(size.width)?;
    let height = usize::from(size.height);
    let least = stride.max(row) * height.saturating_sub(1) + if height == 0 { 0 } else { row };
    let most = stride.max(row) * height;
    if stride < row || packed.len() < least || packed.len() > most {
        return Err(Raw10Error::Length {
            size,
            what: "bytes",
            expected: most,
            found: packed.len(),
        });
    }
    let mut samples = Vec::with_capacity(size.n_pixels());
    for line in packed.chunks(stride.max(1)).take(height) {
        for group in line[..row].chunks_exact(5) {
            let sample = |k: usize| (u16::from(group[k]) << 2) | u16::from(group[4] >> (2 * k) & 3);
            samples.extend([sample(0), sample(1), sample(2), sample(3)]);
        }
    }
    Ok(samples)
}

fn check_length(
    size: Size,
    what: &'static str,
    expected: usize,
    found: usize,
) -> Result<(), Raw10Error> {
    if expected == found { Ok(()) } else { Err(Raw10Error::Length { size, what, expected, found }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn four_samples_are_four_high_bytes_and_their_low_bits() {
        // High bits first, low bits from the first sample upwards: CSI-2, figure of RAW10.
        let table: [([u16; 4], [u8; 5]); 4] = [
            ([0, 0, 0, 0], [0, 0, 0, 0, 0]),
            ([1023, 1023, 1023, 1023], [255, 255, 255, 255, 255]),
            ([1, 2, 3, 4], [0, 0, 0, 1, 0b00_11_10_01]),
            ([0x3fc, 0x001, 0x200, 0x155], [0xff, 0x00, 0x80, 0x55, 0b01_00_01_00]),
        ];
        let size = Size::new(4, 1);
        for (samples, bytes) in table {
            assert_eq!(pack(&samples, size).unwrap(), bytes);
            assert_eq!(unpack(&bytes, size, 5).unwrap(), samples);
        }
    }

    #[test]
    fn padding_at_the_end_of_rows_is_passed_over() {
        let size = Size::new(4, 2);
        let packed = [1, 0, 0, 0, 0, 99, 99, 2, 0, 0, 0, 0];
        assert_eq!(unpack(&packed, size, 7).unwrap(), [4, 0, 0, 0, 8, 0, 0, 0]);
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(matches!(pack(&[0; 6], Size::new(6, 1)), Err(Raw10Error::Width { width: 6 })));
        assert!(matches!(pack(&[0; 3], Size::new(4, 1)), Err(Raw10Error::Length { found: 3, .. })));
        let eleven_bits = pack(&[0, 0, 1024, 0], Size::new(4, 1));
        assert_eq!(eleven_bits, Err(Raw10Error::Sample { index: 2, value: 1024 }));
        for (n, stride) in [(4, 5), (6, 5), (5, 4), (0, 0)] {
            assert!(unpack(&vec![0; n], Size::new(4, 1), stride).is_err(), "{n} by {stride}");
        }
    }

    proptest! {
        #[test]
        fn packing_and_unpacking_gives_the_samples_back(
            groups in 1_u16..20, height in 1_u16..12, seed in any::<u64>(), pad in 0_usize..9,
        ) {
            let size = Size::new(groups * 4, height);
            let sample = |i: usize| (seed.wrapping_mul(i as u64 * 2 + 1) >> 37) as u16 & MAX_SAMPLE;
            let samples: Vec<u16> = (0..size.n_pixels()).map(sample).collect();
            let packed = pack(&samples, size).unwrap();
            let row = row_bytes(size.width).unwrap();
            let padded: Vec<u8> =
                packed.chunks(row).flat_map(|line| line.iter().copied().chain(vec![7; pad])).collect();
            prop_assert_eq!(unpack(&padded, size, row + pad).unwrap(), samples);
        }
    }
}
