//! Colour mosaics: which pixel has which colour, the four planes, brightness of all colours
//! together.

use crate::geometry::Size;
use crate::keyword::UnknownKeyword;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// One of the four kinds of pixels of a Bayer mosaic; the number is its place in [`BayerPlanes`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BayerSite {
    /// Red.
    Red = 0,
    /// Green in a row with red.
    GreenByRed = 1,
    /// Green in a row with blue.
    GreenByBlue = 2,
    /// Blue.
    Blue = 3,
}

/// Which colours the first two pixels of the first two rows have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum BayerOrder {
    /// Red, green; green, blue.
    Rggb,
    /// Blue, green; green, red.
    Bggr,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
}

impl FromStr for BayerOrder {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        // libcamera appends the bit depth, as in SRGGB10.
        let letters = text.trim_start_matches('S').trim_end_matches(|c: char| !c.is_alphabetic());
        match letters {
            "RGGB" => Ok(Self::Rggb),
            "BGGR" => Ok(Self::Bggr),
            "GRBG" => Ok(Self::Grbg),
            "GBRG" => Ok(Self::Gbrg),
            _ => Err(UnknownKeyword::new(text, "RGGB, BGGR, GRBG or GBRG")),
        }
    }
}

impl fmt::Display for BayerOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rggb => "RGGB",
            Self::Bggr => "BGGR",
            Self::Grbg => "GRBG",
            Self::Gbrg => "GBRG",
        })
    }
}

impl BayerOrder {
    /// The kind of the pixel at a column and row of the frame.
    #[must_use]
    pub const fn site(self, x: u16, y: u16) -> BayerSite {
        use BayerSite::{Blue, GreenByBlue, GreenByRed, Red};
        let sites = match self {
            Self::Rggb => [Red, GreenByRed, GreenByBlue, Blue],
            Self::Bggr => [Blue, GreenByBlue, GreenByRed, Red],
            Self::Grbg => [GreenByRed, Red, Blue, GreenByBlue],
            Self::Gbrg => [GreenByBlue, Blue, Red, GreenByRed],
        };
        sites[(y as usize % 2) * 2 + x as usize % 2]
    }

    /// Column and row, 0 or 1, of the first pixel of a kind.
    #[must_use]
    pub fn first(self, site: BayerSite) -> [u16; 2] {
        let cells = [[0, 0], [1, 0], [0, 1], [1, 1]];
        cells.into_iter().find(|[x, y]| self.site(*x, *y) == site).unwrap_or([0, 0])
    }
}

/// The four kinds of pixels of a mosaic, each as an image of half the size.
#[derive(Debug, Clone, PartialEq)]
pub struct BayerPlanes {
    /// Columns and rows of each plane: half the mosaic's, rounded down.
    pub size: Size,
    /// Row-major values minus the pedestal, in the mosaic's digital units; places as in
    /// [`BayerSite`]. Pixel (i, j) of a plane is pixel (2 i + x0, 2 j + y0) of the mosaic, x0, y0
    /// its [`BayerOrder::first`].
    pub values: [Vec<f32>; 4],
}

impl BayerPlanes {
    /// Splits a mosaic of `size`. `black` is the pedestal of each kind of pixel in digital units,
    /// places as in [`BayerSite`]; negative values are kept, so that noise keeps its mean.
    #[must_use]
    pub fn new(mosaic: &[u16], size: Size, order: BayerOrder, black: [f32; 4]) -> Self {
        let (width, n_columns, n_rows) =
            (usize::from(size.width), usize::from(size.width / 2), usize::from(size.height / 2));
        let mut values: [Vec<f32>; 4] = Default::default();
        const SITES: [BayerSite; 4] =
            [BayerSite::Red, BayerSite::GreenByRed, BayerSite::GreenByBlue, BayerSite::Blue];
        for ((plane, site), black) in values.iter_mut().zip(SITES).zip(black) {
            let [x0, y0] = order.first(site).map(usize::from);
            plane.reserve_exact(n_columns * n_rows);
            let rows = mosaic.chunks_exact(width.max(1)).skip(y0).step_by(2).take(n_rows);
            for row in rows {
                let row = row.iter().skip(x0).step_by(2).take(n_columns);
                plane.extend(row.map(|value| f32::from(*value) - black));
            }
        }
        Self { size: Size::new(size.width / 2, size.height / 2), values }
    }
}

/// Brightness (R + 2 G + B) / 4 at each pixel of a mosaic, in its digital units with the pedestal
/// in it.
///
/// Every pixel is the mean of its surroundings with weights 1 2 1 along rows and along columns,
/// which weights each colour equally at every pixel: what a bilinear demosaic gives at red and blue
/// pixels, and no pattern of the mosaic between them. It blurs by a sigma of 0.71 pixels and moves
/// nothing; borders are mirrored. All bits are kept. A frame of one row or column is returned as it
/// is.
#[must_use]
pub fn bayer_brightness(mosaic: &[u16], size: Size) -> Vec<f32> {
    let (width, height) = (usize::from(size.width), usize::from(size.height));
    if width < 2 || height < 2 || mosaic.len() != width * height {
        return mosaic.iter().map(|value| f32::from(*value)).collect();
    }
    let mut sums = vec![0_u32; width];
    let mut out = Vec::with_capacity(mosaic.len());
    for y in 0..height {
        let above = if y == 0 { 1 } else { y - 1 };
        let below = if y + 1 == height { height - 2 } else { y + 1 };
        let [above, own, below] = [above, y, below].map(|row| &mosaic[row * width..][..width]);
        for (sum, ((a, o), b)) in sums.iter_mut().zip(above.iter().zip(own).zip(below)) {
            *sum = u32::from(*a) + 2 * u32::from(*o) + u32::from(*b);
        }
        let at = |sum: u32| sum as f32 / 16.0;
        out.push(at(2 * sums[0] + 2 * sums[1]));
        out.extend(sums.windows(3).map(|w| at(w[0] + 2 * w[1] + w[2])));
        out.push(at(2 * sums[width - 1] + 2 * sums[width - 2]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mosaic of even colours.
    fn mosaic(order: BayerOrder, size: Size, [r, g, b]: [u16; 3]) -> Vec<u16> {
        let rows = 0..size.height;
        rows.flat_map(|y| {
            (0..size.width).map(move |x| match order.site(x, y) {
                BayerSite::Red => r,
                BayerSite::GreenByRed | BayerSite::GreenByBlue => g,
                BayerSite::Blue => b,
            })
        })
        .collect()
    }

    const ORDERS: [BayerOrder; 4] =
        [BayerOrder::Rggb, BayerOrder::Bggr, BayerOrder::Grbg, BayerOrder::Gbrg];

    #[test]
    fn planes_hold_their_colour_and_nothing_of_the_others() {
        for order in ORDERS {
            let size = Size::new(7, 5);
            let planes = BayerPlanes::new(
                &mosaic(order, size, [300, 500, 100]),
                size,
                order,
                [64.0, 64.0, 60.0, 50.0],
            );
            assert_eq!(planes.size, Size::new(3, 2));
            for (plane, expected) in planes.values.iter().zip([236.0, 436.0, 440.0, 50.0]) {
                assert_eq!(plane, &vec![expected; 6], "{order}");
            }
        }
    }

    #[test]
    fn brightness_of_an_even_colour_has_no_pattern_up_to_the_border() {
        for order in ORDERS {
            let size = Size::new(6, 4);
            let grey = bayer_brightness(&mosaic(order, size, [301, 502, 103]), size);
            assert_eq!(grey, vec![(301.0 + 2.0 * 502.0 + 103.0) / 4.0; 24], "{order}");
        }
    }

    #[test]
    fn brightness_keeps_an_edge_where_it_is_and_its_ten_bits() {
        let size = Size::new(9, 8);
        let ramp: Vec<u16> = (0..8).flat_map(|_| (0..9).map(|x| 500 + 3 * x)).collect();
        let grey = bayer_brightness(&ramp, size);
        for x in 1..8 {
            assert!((grey[4 * 9 + x] - (500 + 3 * x) as f32).abs() < 1e-6);
        }
    }

    #[test]
    fn an_order_is_read_as_it_is_written_and_as_libcamera_writes_it() {
        for order in ORDERS {
            assert_eq!(order.to_string().parse(), Ok(order));
        }
        assert_eq!("SRGGB10".parse(), Ok(BayerOrder::Rggb));
        assert!("RGBG".parse::<BayerOrder>().unwrap_err().to_string().contains("RGBG"));
    }
}
