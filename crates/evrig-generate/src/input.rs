//! Preparation of camera frames for a generator: colour channel, black level, exposure.

use crate::parameter_error::ParameterError;
use evrig_core::frame::{BayerOrder, BayerSite, Luminance, bayer_brightness};
use evrig_core::geometry::Size;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Colour channel of a mosaic or colour frame from which events are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Colour {
    /// A mosaic as it is, each pixel in its own colour, as the published generator takes it; the
    /// luma of a colour frame.
    #[default]
    Mosaic,
    /// Brightness (R + 2 G + B) / 4 of the neighbourhood in a mosaic.
    Luma,
    /// The red pixels alone, at half the width and height.
    Red,
    /// The mean of the two greens, at half the width and height.
    Green,
    /// The blue pixels alone, at half the width and height.
    Blue,
}

impl Colour {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Mosaic, Self::Luma, Self::Red, Self::Green, Self::Blue];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mosaic => "mosaic",
            Self::Luma => "luma",
            Self::Red => "red",
            Self::Green => "green",
            Self::Blue => "blue",
        }
    }
}

impl FromStr for Colour {
    type Err = ParameterError;

    fn from_str(text: &str) -> Result<Self, ParameterError> {
        let found = Self::ALL.into_iter().find(|colour| colour.name().eq_ignore_ascii_case(text));
        found.ok_or_else(|| ParameterError::unknown("colour", text, &Self::ALL.map(Self::name)))
    }
}

/// How frames become brightness.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FramePreparation {
    /// Colour channel.
    #[serde(default)]
    pub colour: Colour,
    /// Whether the stated black level is subtracted; the published generator keeps it.
    #[serde(default)]
    pub subtract_black: bool,
    /// Whether values are divided by exposure time and gain, so that automatic exposure makes no
    /// events.
    #[serde(default)]
    pub divide_exposure: bool,
}

/// A frame as the camera gave it.
#[derive(Debug, Clone, Copy)]
pub struct SourceFrame<'a> {
    /// Columns and rows.
    pub size: Size,
    /// Samples of a mosaic, and its order; none for grey and colour frames.
    pub mosaic: Option<(&'a [u16], BayerOrder)>,
    /// What a sample reads in the dark: R, green by R, green by B, B.
    pub black_dn: [f32; 4],
    /// Exposure time (s) times gain, where both are stated.
    pub exposure_gain: Option<f64>,
}

/// Prepares the frames of one stream in order.
#[derive(Debug, Clone, Default)]
pub struct FramePreparer {
    preparation: FramePreparation,
    /// Exposure time times gain of the first frame, to which the others are normalised.
    first: Option<f64>,
}

impl FramePreparer {
    /// For a new stream.
    #[must_use]
    pub const fn new(preparation: FramePreparation) -> Self {
        Self { preparation, first: None }
    }

    /// Brightness of the frame at `t_us`; `plain` is that of grey and colour frames, and of an
    /// unchanged mosaic. The signal above the black level is divided by the exposure, so the values
    /// stay in the first frame's digital units.
    pub fn prepare(&mut self, t_us: i64, image: &SourceFrame<'_>, plain: Vec<f32>) -> Luminance {
        let FramePreparation { colour, subtract_black, divide_exposure } = self.preparation;
        let (size, mut values) = match (colour, image.mosaic) {
            (Colour::Luma, Some((mosaic, _))) => (image.size, bayer_brightness(mosaic, image.size)),
            (Colour::Red | Colour::Green | Colour::Blue, Some((mosaic, order))) => {
                channel(mosaic, order, image.size, colour)
            }
            _ => (image.size, plain),
        };
        let scale = if divide_exposure { self.scale(image.exposure_gain) } else { 1.0 };
        if subtract_black || scale != 1.0 {
            let kept = if subtract_black { 0.0 } else { 1.0 };
            let width = usize::from(size.width);
            let is_mosaic = size == image.size && colour == Colour::Mosaic;
            let even = black_of(colour, image.black_dn);
            for (i, value) in values.iter_mut().enumerate() {
                let black = match image.mosaic {
                    Some((_, order)) if is_mosaic => {
                        image.black_dn[site(order, (i % width) as u16, (i / width) as u16)]
                    }
                    _ => even,
                };
                *value = ((*value - black).max(0.0) * scale + kept * black).max(0.0);
            }
        }
        Luminance { t_us, size, values }
    }

    fn scale(&mut self, exposure_gain: Option<f64>) -> f32 {
        match exposure_gain.filter(|value| *value > 0.0 && value.is_finite()) {
            Some(now) => (*self.first.get_or_insert(now) / now) as f32,
            None => 1.0,
        }
    }
}

fn site(order: BayerOrder, x: u16, y: u16) -> usize {
    match order.site(x, y) {
        BayerSite::Red => 0,
        BayerSite::GreenByRed => 1,
        BayerSite::GreenByBlue => 2,
        BayerSite::Blue => 3,
    }
}

/// Black level of a colour channel.
fn black_of(colour: Colour, [red, green_red, green_blue, blue]: [f32; 4]) -> f32 {
    match colour {
        Colour::Red => red,
        Colour::Green => 0.5 * (green_red + green_blue),
        Colour::Blue => blue,
        Colour::Luma | Colour::Mosaic => 0.25 * (red + green_red + green_blue + blue),
    }
}

/// One colour of a mosaic, a value for each two by two pixels.
fn channel(mosaic: &[u16], order: BayerOrder, size: Size, colour: Colour) -> (Size, Vec<f32>) {
    let half = Size::new(size.width / 2, size.height / 2);
    let mut values = Vec::with_capacity(half.n_pixels());
    for y in 0..half.height {
        for x in 0..half.width {
            let (mut sum, mut n) = (0.0, 0.0_f32);
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (2 * x + i, 2 * y + j)) {
                let is_of = match order.site(x, y) {
                    BayerSite::Red => colour == Colour::Red,
                    BayerSite::Blue => colour == Colour::Blue,
                    BayerSite::GreenByRed | BayerSite::GreenByBlue => colour == Colour::Green,
                };
                if is_of {
                    sum += f32::from(mosaic[size.index(x, y)]);
                    n += 1.0;
                }
            }
            values.push(sum / n.max(1.0));
        }
    }
    (half, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 4, height: 2 };

    /// R 100, greens 200 and 210, B 50, above a pedestal of 64, at a gain.
    fn mosaic(gain: f32) -> Vec<u16> {
        let row = |a: f32, b: f32| [a, b, a, b].map(|v| (64.0 + gain * v) as u16);
        [row(100.0, 200.0), row(210.0, 50.0)].concat()
    }

    fn prepared(preparation: FramePreparation, gains: &[f32]) -> Vec<Vec<f32>> {
        let mut preparer = FramePreparer::new(preparation);
        let one = |gain: &f32| {
            let samples = mosaic(*gain);
            let image = SourceFrame {
                size: SIZE,
                mosaic: Some((&samples, BayerOrder::Rggb)),
                black_dn: [64.0; 4],
                exposure_gain: Some(f64::from(*gain) * 0.008),
            };
            let plain = samples.iter().map(|v| f32::from(*v)).collect();
            preparer.prepare(0, &image, plain).values
        };
        gains.iter().map(one).collect()
    }

    #[test]
    fn a_camera_that_adapts_its_exposure_gives_the_same_brightness() {
        for colour in Colour::ALL {
            for subtract_black in [true, false] {
                let preparation =
                    FramePreparation { colour, subtract_black, divide_exposure: true };
                let found = prepared(preparation, &[1.0, 2.0, 0.5]);
                for later in &found[1..] {
                    for (a, b) in found[0].iter().zip(later) {
                        assert!((a - b).abs() < 0.6, "{colour:?}: {a} {b}");
                    }
                }
            }
        }
        let kept = prepared(FramePreparation::default(), &[1.0, 2.0]);
        assert!((kept[1][0] - 264.0).abs() < 1e-6 && (kept[0][0] - 164.0).abs() < 1e-6);
    }

    #[test]
    fn each_colour_is_its_own_pixels_above_black() {
        let of = |colour| {
            let preparation =
                FramePreparation { colour, subtract_black: true, divide_exposure: false };
            prepared(preparation, &[1.0]).remove(0)
        };
        assert_eq!(of(Colour::Red), [100.0, 100.0]);
        assert_eq!(of(Colour::Green), [205.0, 205.0]);
        assert_eq!(of(Colour::Blue), [50.0, 50.0]);
        assert_eq!(of(Colour::Mosaic)[..2], [100.0, 200.0]);
        assert!((of(Colour::Luma)[0] - 140.0).abs() < 1e-3);
    }
}
