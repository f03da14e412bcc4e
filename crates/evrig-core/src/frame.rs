//! Frames: pixels with their exposure times.

mod bayer;

pub use bayer::{BayerOrder, BayerPlanes, BayerSite, bayer_brightness};

use crate::geometry::Size;
use crate::time::{Clock, Span, Stamp};

/// Samples of a frame in the camera's own digital units.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Samples {
    /// 8 bits per sample.
    U8(Vec<u8>),
    /// Up to 16 bits per sample, depending on the camera.
    U16(Vec<u16>),
}

/// Channels of one pixel, in memory order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// One sample: brightness, or one colour of a Bayer mosaic.
    Gray,
    /// Blue, green, red.
    Bgr,
    /// Blue, green, red, and one that is not used.
    Bgra,
}

/// Exposure and readout of a frame, on the clock of its camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameTiming<C: Clock> {
    /// The frame's own time stamp, as the camera gave it.
    pub stamp: Stamp<C>,
    /// Start and end of the first row's exposure, where the camera states them.
    pub exposure: Option<[Stamp<C>; 2]>,
    /// Start and end of the frame's readout, where the camera states them.
    pub readout: Option<[Stamp<C>; 2]>,
    /// Delay from one row's exposure to the next; zero for a global shutter.
    pub row_time: Span,
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame<C: Clock> {
    /// Exposure and readout.
    pub timing: FrameTiming<C>,
    /// Columns and rows.
    pub size: Size,
    /// Column and row of the frame's first pixel on the sensor.
    pub origin: [i16; 2],
    /// Channels of a pixel.
    pub channels: Channels,
    /// Row-major samples, `size.n_pixels() * channels.count()` of them.
    pub samples: Samples,
}

/// Brightness on a pixel grid at one instant: the input of generators.
#[derive(Debug, Clone, PartialEq)]
pub struct Luminance {
    /// Microseconds of the stream's clock; mid-exposure where it is known.
    pub t_us: i64,
    /// Columns and rows.
    pub size: Size,
    /// Row-major brightness in the frame's own digital units (8 bit: 0..=255, raw 10 bit:
    /// 0..=1023).
    pub values: Vec<f32>,
}

impl Channels {
    /// Samples per pixel.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::Gray => 1,
            Self::Bgr => 3,
            Self::Bgra => 4,
        }
    }
}

impl Samples {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(samples) => samples.len(),
            Self::U16(samples) => samples.len(),
        }
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bits per stored sample.
    #[must_use]
    pub const fn bits(&self) -> u8 {
        match self {
            Self::U8(_) => 8,
            Self::U16(_) => 16,
        }
    }
}

impl<C: Clock> FrameTiming<C> {
    /// A frame of which only the stamp is known.
    #[must_use]
    pub fn from_stamp(stamp: Stamp<C>) -> Self {
        Self { stamp, exposure: None, readout: None, row_time: Span::ZERO }
    }

    /// Middle of the exposure of row `row`; the stamp is that of row 0 where no exposure is stated.
    #[must_use]
    pub fn mid_exposure(&self, row: u16) -> Stamp<C> {
        let first_row = match self.exposure {
            Some([start, end]) => start + Span::from_nanos((end - start).as_nanos() / 2),
            None => self.stamp,
        };
        first_row + Span::from_nanos(self.row_time.as_nanos().saturating_mul(i64::from(row)))
    }
}

/// Weights of red, green and blue in brightness (ITU-R BT.601-7, section 2.5.1).
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// Brightness of red, green and blue (ITU-R BT.601-7).
#[must_use]
pub fn luma(rgb: [f32; 3]) -> f32 {
    LUMA[0] * rgb[0] + LUMA[1] * rgb[1] + LUMA[2] * rgb[2]
}

impl<C: Clock> Frame<C> {
    /// A grey frame of the whole sensor.
    #[must_use]
    pub fn gray(timing: FrameTiming<C>, size: Size, samples: Samples) -> Self {
        Self { timing, size, origin: [0, 0], channels: Channels::Gray, samples }
    }

    /// Brightness of each pixel in the frame's own digital units, row-major; colour is weighted as
    /// in BT.601.
    #[must_use]
    pub fn brightness(&self) -> Vec<f32> {
        match &self.samples {
            Samples::U8(samples) => self.weigh(samples, |sample| f32::from(*sample)),
            Samples::U16(samples) => self.weigh(samples, |sample| f32::from(*sample)),
        }
    }

    /// Brightness at mid-exposure, the input of generators.
    #[must_use]
    pub fn luminance(&self) -> Luminance {
        let t_us = self.timing.mid_exposure(0).as_micros();
        Luminance { t_us, size: self.size, values: self.brightness() }
    }

    fn weigh<T>(&self, samples: &[T], to_f32: impl Fn(&T) -> f32) -> Vec<f32> {
        match self.channels {
            Channels::Gray => samples.iter().map(to_f32).collect(),
            colour @ (Channels::Bgr | Channels::Bgra) => samples
                .chunks_exact(colour.count())
                .map(|bgr| luma([to_f32(&bgr[2]), to_f32(&bgr[1]), to_f32(&bgr[0])]))
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Davis;

    #[test]
    fn rows_see_light_one_after_another() {
        let timing = FrameTiming::<Davis> {
            exposure: Some([Stamp::from_micros(100), Stamp::from_micros(600)]),
            row_time: Span::from_micros(10),
            ..FrameTiming::from_stamp(Stamp::from_micros(600))
        };
        assert_eq!(timing.mid_exposure(0).as_micros(), 350);
        assert_eq!(timing.mid_exposure(5).as_micros(), 400);
    }

    #[test]
    fn white_is_as_bright_in_colour_as_in_gray() {
        let frame = Frame::<Davis> {
            timing: FrameTiming::from_stamp(Stamp::from_micros(0)),
            size: Size::new(2, 1),
            origin: [0, 0],
            channels: Channels::Bgr,
            samples: Samples::U8(vec![255, 255, 255, 0, 0, 100]),
        };
        let brightness = frame.brightness();
        assert!((brightness[0] - 255.0).abs() < 1e-4);
        assert!((brightness[1] - 29.9).abs() < 1e-4, "red alone weighs 0.299");
    }
}
