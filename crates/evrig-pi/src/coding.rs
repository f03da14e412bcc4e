//! Lossless coding of the Pi's images, fast enough for a Pi.
//!
//! What makes a sensor's image hard to shrink is its noise; what a coder can take out is what
//! neighbours have in common. A sample is predicted from its neighbours to the left and above (the
//! median of left, above, and left + above - corner, as JPEG-LS does: ITU-T T.87, A.4.1), and
//! Zstandard's first level codes the rests. A raw sample's neighbours are those of its own colour,
//! two columns and two rows away. RGB becomes green and two differences to green first. An image
//! is cut into bands that know nothing of each other, so that all cores work on it.
//!
//! A coded image is, for each band in order, a little-endian `u32` of bytes and a Zstandard
//! frame.

use evrig_core::geometry::Size;
use evrig_core::raw10::{self, Raw10Error};
use rayon::prelude::*;
use std::ops::Range;

/// Bands of an image. Fixed, since both sides must cut alike; a Pi has four cores.
const N_BANDS: usize = 4;
/// Zstandard's level. Higher ones take several times as long and gain one or two per cent on noise.
const LEVEL: i32 = 1;

/// Why bytes are no coded image of a size, or an image is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CodingError {
    /// The RAW10 around it.
    #[error(transparent)]
    Raw10(#[from] Raw10Error),
    /// The image to code has another length.
    #[error("an RGB image of {size} has {expected} bytes, found {found}")]
    Length {
        /// The image's size.
        size: Size,
        /// Its bytes.
        expected: usize,
        /// What there is.
        found: usize,
    },
    /// A band is cut short or damaged.
    #[error("band {band} of {N_BANDS} of a coded image of {size}: {because}")]
    Band {
        /// Which, from 0.
        band: usize,
        /// The image's size.
        size: Size,
        /// Expected and found.
        because: String,
    },
}

/// Codes a RAW10 image without padding.
///
/// # Errors
/// When `packed` is not an image of `size`.
pub fn encode_raw10(packed: &[u8], size: Size) -> Result<Vec<u8>, CodingError> {
    let samples = raw10::unpack(packed, size, raw10::row_bytes(size.width)?)?;
    let width = usize::from(size.width);
    let bands = bands(size).into_par_iter().map(|rows| {
        let band = &samples[rows.start * width..rows.end * width];
        let plane: Vec<i16> = band.iter().map(|&sample| sample as i16).collect();
        // Low bytes first, then high bits, which are nearly all zero.
        let mut rests = vec![0; 2 * plane.len()];
        let (low, high) = rests.split_at_mut(plane.len());
        for_each_prediction::<2>(&plane, width, |at, row, predicted| {
            let low = low[at..at + width].iter_mut();
            let bytes = low.zip(high[at..at + width].iter_mut());
            for ((low, high), (&sample, &predicted)) in bytes.zip(row.iter().zip(predicted)) {
                let rest = zigzag(sample, predicted);
                (*low, *high) = (rest as u8, (rest >> 8) as u8);
            }
        });
        compress(&rests)
    });
    gather(bands.collect(), size)
}

/// The RAW10 image that was coded.
///
/// # Errors
/// When `coded` is not a coded image of `size`.
pub fn decode_raw10(coded: &[u8], size: Size) -> Result<Vec<u8>, CodingError> {
    let width = usize::from(size.width);
    let parts = scatter(coded, size)?;
    let bands = parts.into_par_iter().zip(bands(size)).enumerate().map(|(band, (part, rows))| {
        let n = rows.len() * width;
        let rests =
            decompress(part, 2 * n).map_err(|because| CodingError::Band { band, size, because })?;
        let (low, high) = rests.split_at(n);
        let rests = low.iter().zip(high).map(|(&low, &high)| i16::from_le_bytes([low, high]));
        let plane = restore::<2>(&rests.collect::<Vec<i16>>(), width, unzigzag);
        Ok(plane.into_iter().map(|sample| sample as u16).collect())
    });
    let bands: Vec<Vec<u16>> = bands.collect::<Result<_, CodingError>>()?;
    Ok(raw10::pack(&bands.concat(), size)?)
}

/// Codes R, G, B bytes, rows without padding.
///
/// # Errors
/// When `rgb` is not an image of `size`.
pub fn encode_rgb(rgb: &[u8], size: Size) -> Result<Vec<u8>, CodingError> {
    let expected = 3 * size.n_pixels();
    if rgb.len() != expected {
        return Err(CodingError::Length { size, expected, found: rgb.len() });
    }
    let width = usize::from(size.width);
    let bands = bands(size).into_par_iter().map(|rows| {
        let band = &rgb[3 * rows.start * width..3 * rows.end * width];
        let n = rows.len() * width;
        let mut rests = vec![0; 3 * n];
        for which in 0..3 {
            let plane: Vec<i16> = band.chunks_exact(3).map(|pixel| part(which, pixel)).collect();
            let rests = &mut rests[which * n..(which + 1) * n];
            for_each_prediction::<1>(&plane, width, |at, row, predicted| {
                let rests = rests[at..at + width].iter_mut();
                for (rest, (&value, &predicted)) in rests.zip(row.iter().zip(predicted)) {
                    *rest = value.wrapping_sub(predicted) as u8;
                }
            });
        }
        compress(&rests)
    });
    gather(bands.collect(), size)
}

/// The R, G, B bytes that were coded.
///
/// # Errors
/// When `coded` is not a coded image of `size`.
pub fn decode_rgb(coded: &[u8], size: Size) -> Result<Vec<u8>, CodingError> {
    let width = usize::from(size.width);
    let parts = scatter(coded, size)?;
    let bands = parts.into_par_iter().zip(bands(size)).enumerate().map(|(band, (part, rows))| {
        let n = rows.len() * width;
        let rests =
            decompress(part, 3 * n).map_err(|because| CodingError::Band { band, size, because })?;
        let plane = |which: usize| {
            let rests: Vec<i16> =
                rests[which * n..(which + 1) * n].iter().map(|&rest| i16::from(rest)).collect();
            restore::<1>(&rests, width, |rest, predicted| (rest + predicted) & 0xff)
        };
        let (green, red, blue) = (plane(0), plane(1), plane(2));
        let mut rgb = vec![0; 3 * n];
        let planes = red.iter().zip(&green).zip(&blue);
        for (pixel, ((&red, &green), &blue)) in rgb.chunks_exact_mut(3).zip(planes) {
            let green = green as u8;
            pixel.copy_from_slice(&[sum(red as u8, green), green, sum(blue as u8, green)]);
        }
        Ok(rgb)
    });
    let bands: Vec<Vec<u8>> = bands.collect::<Result<_, CodingError>>()?;
    Ok(bands.concat())
}

/// Green, red less green, blue less green, of a pixel's R, G, B.
fn part(which: usize, pixel: &[u8]) -> i16 {
    i16::from(match which {
        0 => pixel[1],
        1 => difference(pixel[0], pixel[1]),
        _ => difference(pixel[2], pixel[1]),
    })
}

/// Rows of each band; the colours' pairs of rows stay together.
fn bands(size: Size) -> Vec<Range<usize>> {
    let height = usize::from(size.height);
    let edge = |band: usize| if band == N_BANDS { height } else { (height * band / N_BANDS) & !1 };
    (0..N_BANDS).map(|band| edge(band)..edge(band + 1)).collect()
}

/// A difference around 128, so that small ones of either sign are neighbours.
const fn difference(colour: u8, green: u8) -> u8 {
    colour.wrapping_sub(green).wrapping_add(128)
}

const fn sum(difference: u8, green: u8) -> u8 {
    difference.wrapping_sub(128).wrapping_add(green)
}

/// The rest modulo 1024 as 0, -1, 1, -2, 2, ... are 0, 1, 2, 3, 4, ...
const fn zigzag(sample: i16, predicted: i16) -> i16 {
    let rest = ((sample - predicted) << 6) >> 6;
    ((rest << 1) ^ (rest >> 15)) & raw10::MAX_SAMPLE as i16
}

const fn unzigzag(rest: i16, predicted: i16) -> i16 {
    let rest = rest & raw10::MAX_SAMPLE as i16;
    (predicted + ((rest >> 1) ^ -(rest & 1))) & raw10::MAX_SAMPLE as i16
}

/// The median of left, above, and the plane through left, above and corner.
fn median(left: i16, above: i16, corner: i16) -> i16 {
    // Not `clamp`, which would look whether its bounds are in order.
    (left + above - corner).min(left.max(above)).max(left.min(above))
}

/// Hands out each row, with where it begins, and what its samples are predicted to be from those
/// `STEP` columns to the left and `STEP` rows above. Whole rows at a time, for the sake of SIMD.
fn for_each_prediction<const STEP: usize>(
    plane: &[i16],
    width: usize,
    mut take: impl FnMut(usize, &[i16], &[i16]),
) {
    let mut predicted = vec![0; width];
    let step = STEP.min(width);
    for (y, row) in plane.chunks_exact(width.max(1)).enumerate() {
        let (edge, inner) = predicted.split_at_mut(step);
        if y < STEP {
            edge.fill(0);
            inner.copy_from_slice(&row[..width - step]);
        } else {
            let above = &plane[(y - STEP) * width..(y - STEP + 1) * width];
            edge.copy_from_slice(&above[..step]);
            let neighbours = row.iter().zip(&above[step..]).zip(above);
            for (predicted, ((&left, &above), &corner)) in inner.iter_mut().zip(neighbours) {
                *predicted = median(left, above, corner);
            }
        }
        take(y * width, row, &predicted);
    }
}

/// The samples from their rests; each needs the ones before it.
fn restore<const STEP: usize>(
    rests: &[i16],
    width: usize,
    sample: impl Fn(i16, i16) -> i16,
) -> Vec<i16> {
    let mut plane = vec![0; rests.len()];
    for (y, rests) in rests.chunks_exact(width.max(1)).enumerate() {
        let (done, rest) = plane.split_at_mut(y * width);
        let row = &mut rest[..width];
        if y < STEP {
            for x in 0..width {
                let predicted = if x < STEP { 0 } else { row[x - STEP] };
                row[x] = sample(rests[x], predicted);
            }
            continue;
        }
        let above = &done[(y - STEP) * width..(y - STEP + 1) * width];
        for x in 0..STEP.min(width) {
            row[x] = sample(rests[x], above[x]);
        }
        for x in STEP..width {
            row[x] = sample(rests[x], median(row[x - STEP], above[x], above[x - STEP]));
        }
    }
    plane
}

fn compress(rests: &[u8]) -> Result<Vec<u8>, String> {
    zstd::bulk::compress(rests, LEVEL).map_err(|error| error.to_string())
}

fn decompress(coded: &[u8], n_bytes: usize) -> Result<Vec<u8>, String> {
    let bytes = zstd::bulk::decompress(coded, n_bytes).map_err(|error| error.to_string())?;
    let found = bytes.len();
    if found == n_bytes { Ok(bytes) } else { Err(format!("expected {n_bytes} rests, got {found}")) }
}

fn gather(bands: Vec<Result<Vec<u8>, String>>, size: Size) -> Result<Vec<u8>, CodingError> {
    let mut coded = Vec::new();
    for (band, bytes) in bands.into_iter().enumerate() {
        let bytes = bytes.map_err(|because| CodingError::Band { band, size, because })?;
        coded.extend((bytes.len() as u32).to_le_bytes());
        coded.extend(bytes);
    }
    Ok(coded)
}

fn scatter(mut coded: &[u8], size: Size) -> Result<Vec<&[u8]>, CodingError> {
    let mut parts = Vec::with_capacity(N_BANDS);
    for band in 0..N_BANDS {
        let cut = coded
            .split_first_chunk()
            .and_then(|(length, rest)| rest.split_at_checked(u32::from_le_bytes(*length) as usize));
        let Some((part, rest)) = cut else {
            let because = format!("{} bytes are left, too few for it", coded.len());
            return Err(CodingError::Band { band, size, because });
        };
        parts.push(part);
        coded = rest;
    }
    if coded.is_empty() {
        return Ok(parts);
    }
    let because = format!("{} bytes follow it", coded.len());
    Err(CodingError::Band { band: N_BANDS - 1, size, because })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    #[test]
    fn rests_come_back_for_every_sample_and_prediction() {
        for sample in 0..1024 {
            for predicted in 0..1024 {
                assert_eq!(unzigzag(zigzag(sample, predicted), predicted), sample);
            }
        }
        assert_eq!([zigzag(5, 5), zigzag(4, 5), zigzag(6, 5)], [0, 1, 2]);
    }

    #[test]
    fn a_smooth_image_shrinks_and_noise_does_not_grow_much() {
        let size = Size::new(64, 64);
        let smooth: Vec<u16> = (0..size.n_pixels()).map(|at| (at % 64 + at / 64) as u16).collect();
        let packed = raw10::pack(&smooth, size).unwrap();
        assert!(encode_raw10(&packed, size).unwrap().len() * 4 < packed.len());
        let mut random = StdRng::seed_from_u64(1);
        let noise: Vec<u8> = (0..3 * size.n_pixels()).map(|_| random.random()).collect();
        let coded = encode_rgb(&noise, size).unwrap();
        assert!(coded.len() < noise.len() + noise.len() / 50, "{}", coded.len());
    }

    #[test]
    fn cut_or_damaged_images_are_errors_that_state_where() {
        let size = Size::new(16, 16);
        let rgb: Vec<u8> = (0..3 * size.n_pixels()).map(|at| (at * 7) as u8).collect();
        let coded = encode_rgb(&rgb, size).unwrap();
        for n in 0..coded.len() {
            let error = decode_rgb(&coded[..n], size).unwrap_err().to_string();
            assert!(error.contains("of a coded image of 16 x 16"), "{error}");
        }
        let longer = [coded.as_slice(), b"x"].concat();
        assert!(decode_rgb(&longer, size).unwrap_err().to_string().contains("1 bytes follow"));
        assert!(decode_rgb(&coded, Size::new(16, 18)).is_err());
        assert!(encode_rgb(&rgb, Size::new(16, 18)).is_err());
    }

    proptest! {
        #[test]
        fn images_come_back_bit_for_bit(
            groups in 1_u16..12, height in 0_u16..30, seed in any::<u64>(), spread in 1_u16..1024,
        ) {
            let size = Size::new(groups * 4, height);
            let mut random = StdRng::seed_from_u64(seed);
            let samples: Vec<u16> =
                (0..size.n_pixels()).map(|_| random.random_range(0..spread)).collect();
            let packed = raw10::pack(&samples, size).unwrap();
            let coded = encode_raw10(&packed, size).unwrap();
            prop_assert_eq!(decode_raw10(&coded, size).unwrap(), packed);
            let rgb: Vec<u8> = (0..3 * size.n_pixels()).map(|_| random.random()).collect();
            let coded = encode_rgb(&rgb, size).unwrap();
            prop_assert_eq!(decode_rgb(&coded, size).unwrap(), rgb);
        }

        #[test]
        fn noise_is_an_error_but_never_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(decode_rgb(&bytes, Size::new(8, 8)).is_err());
            prop_assert!(decode_raw10(&bytes, Size::new(8, 8)).is_err());
        }
    }
}
