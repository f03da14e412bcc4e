//! Grey images for search and corner fit, from each kind of frame.

use evrig_core::frame::{Channels, Frame, Samples};
use evrig_core::time::Clock;

/// Meaning of a frame's samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SampleFormat {
    /// Brightness or colour: APS and RGB frames.
    Brightness,
    /// Bayer mosaic of 2 x 2 cells with green on one diagonal: raw frames of the Pi. The colour
    /// order does not matter: the four sites are balanced on the tag, which is grey.
    Mosaic {
        /// Reading without light, DN.
        black_level_dn: f64,
    },
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct GreyImage {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
    pub(super) scale: usize,
}

/// Columns `x0..x1` and rows `y0..y1` of a grey image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelWindow {
    pub(super) x0: usize,
    pub(super) y0: usize,
    pub(super) x1: usize,
    pub(super) y1: usize,
}

impl PixelWindow {
    pub(super) fn n_pixels(&self) -> usize {
        (self.x1 - self.x0) * (self.y1 - self.y0)
    }
}

impl GreyImage {
    /// Image for the search: brightness, or the mean of each 2 x 2 cell above black. None when the
    /// frame holds too few samples for its size.
    pub(super) fn to_search<C: Clock>(frame: &Frame<C>, format: SampleFormat) -> Option<Self> {
        let (width, height) = (usize::from(frame.size.width), usize::from(frame.size.height));
        let is_whole = frame.samples.len() >= width * height * frame.channels.count();
        if width < 2 || height < 2 || !is_whole {
            return None;
        }
        match format {
            SampleFormat::Brightness => {
                Some(Self { width, height, values: frame.brightness(), scale: 1 })
            }
            SampleFormat::Mosaic { black_level_dn } => {
                if frame.channels != Channels::Gray {
                    return None;
                }
                let black = black_level_dn as f32;
                let values = match &frame.samples {
                    Samples::U8(samples) => cells(samples, width, height, black),
                    Samples::U16(samples) => cells(samples, width, height, black),
                };
                Some(Self { width: width / 2, height: height / 2, values, scale: 2 })
            }
        }
    }

    /// The mosaic at full resolution within a window, with the four Bayer sites scaled to equal
    /// means; zero elsewhere.
    pub(super) fn balanced<C: Clock>(frame: &Frame<C>, black_dn: f64, window: PixelWindow) -> Self {
        let (width, height) = (usize::from(frame.size.width), usize::from(frame.size.height));
        let sample = |i: usize| match &frame.samples {
            Samples::U8(samples) => f32::from(samples[i]),
            Samples::U16(samples) => f32::from(samples[i]),
        };
        let pixels = || {
            (window.y0..window.y1).flat_map(move |y| (window.x0..window.x1).map(move |x| (x, y)))
        };
        let place = |x: usize, y: usize| 2 * (y % 2) + x % 2;
        let mut sums = [0.0_f64; 4];
        let mut counts = [0.0_f64; 4];
        let mut values = vec![0.0; width * height];
        for (x, y) in pixels() {
            let above_black = sample(y * width + x) - black_dn as f32;
            values[y * width + x] = above_black;
            sums[place(x, y)] += f64::from(above_black);
            counts[place(x, y)] += 1.0;
        }
        let means: Vec<f64> = sums.iter().zip(counts).map(|(sum, n)| sum / n).collect();
        let mean = means.iter().sum::<f64>() / 4.0;
        for (x, y) in pixels() {
            let own = means[place(x, y)];
            // A site without signal is not scaled.
            let gain = if own > 1e-3 * mean.abs() { mean / own } else { 1.0 };
            values[y * width + x] *= gain as f32;
        }
        Self { width, height, values, scale: 1 }
    }

    /// The mirror image, left and right exchanged.
    pub(super) fn mirrored(&self) -> Self {
        let rows = self.values.chunks(self.width.max(1));
        let values = rows.flat_map(|row| row.iter().rev().copied()).collect();
        Self { width: self.width, height: self.height, values, scale: self.scale }
    }

    pub(super) fn whole(&self) -> PixelWindow {
        PixelWindow { x0: 0, y0: 0, x1: self.width, y1: self.height }
    }

    /// The pixels around points (in the frame's pixels) with a margin, at least 32 on a side where
    /// the image allows; None when the points lie outside.
    pub(super) fn window(&self, points: &[[f64; 2]], margin: f64) -> Option<PixelWindow> {
        let scale = self.scale as f64;
        let span = |axis: usize, length: usize| {
            let parts = points.iter().map(|point| point[axis] / scale);
            let low = parts.clone().fold(f64::INFINITY, f64::min) - margin / scale;
            let high = parts.fold(f64::NEG_INFINITY, f64::max) + margin / scale;
            let spare = ((32.0 - (high - low)) / 2.0).max(0.0);
            let from = (low - spare).floor().max(0.0);
            let to = (high + spare).ceil().min(length as f64);
            (to - from >= 16.0).then_some((from as usize, to as usize))
        };
        let (x0, x1) = span(0, self.width)?;
        let (y0, y1) = span(1, self.height)?;
        Some(PixelWindow { x0, y0, x1, y1 })
    }

    /// Smallest and largest mean over the window's blocks of 8 x 8 pixels: a range robust to noise.
    pub(super) fn block_range(&self, window: PixelWindow) -> [f32; 2] {
        let [mut low, mut high] = [f32::INFINITY, f32::NEG_INFINITY];
        for y in (window.y0..window.y1.saturating_sub(7)).step_by(8) {
            for x in (window.x0..window.x1.saturating_sub(7)).step_by(8) {
                let rows = (y..y + 8).map(|row| row * self.width + x);
                let sum: f32 = rows.map(|at| self.values[at..at + 8].iter().sum::<f32>()).sum();
                low = low.min(sum / 64.0);
                high = high.max(sum / 64.0);
            }
        }
        [low, high]
    }

    /// Range of the block means; zero without blocks.
    pub(super) fn contrast(&self) -> f32 {
        let [low, high] = self.block_range(self.whole());
        (high - low).max(0.0)
    }
}

/// Mean of each 2 x 2 cell above black; an odd last column or row is left out.
fn cells<T: Copy + Into<f32>>(samples: &[T], width: usize, height: usize, black: f32) -> Vec<f32> {
    let mut values = Vec::with_capacity((width / 2) * (height / 2));
    for rows in samples.chunks_exact(2 * width).take(height / 2) {
        let (upper, lower) = rows.split_at(width);
        let cells = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        values.extend(cells.map(|(a, b)| {
            let sum: f32 = a[0].into() + a[1].into() + b[0].into() + b[1].into();
            sum / 4.0 - black
        }));
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::frame::FrameTiming;
    use evrig_core::geometry::Size;
    use evrig_core::time::{PiSensor, Stamp};

    fn mosaic() -> Frame<PiSensor> {
        // Red 0.5, green 1, blue 0.25 of a brightness that rises to the right by cells.
        let brightness = |x: usize| 100.0 + 40.0 * (x / 2) as f64;
        let gain = |x: usize, y: usize| [[0.5, 1.0], [1.0, 0.25]][y % 2][x % 2];
        let sample = |i: usize| (64.0 + gain(i % 5, i / 5) * brightness(i % 5)) as u16;
        Frame::gray(
            FrameTiming::from_stamp(Stamp::from_nanos(0)),
            Size::new(5, 4),
            Samples::U16((0..20).map(sample).collect()),
        )
    }

    #[test]
    fn a_mosaic_is_searched_at_half_its_resolution_above_black() {
        let format = SampleFormat::Mosaic { black_level_dn: 64.0 };
        let grey = GreyImage::to_search(&mosaic(), format).unwrap();
        assert_eq!((grey.width, grey.height, grey.scale), (2, 2, 2));
        let share = (0.5 + 1.0 + 1.0 + 0.25) / 4.0;
        assert!((grey.values[0] - 100.0 * share).abs() < 0.5);
        assert!((grey.values[3] - 140.0 * share).abs() < 0.5);
    }

    #[test]
    fn a_balanced_mosaic_shows_no_colour() {
        let window = PixelWindow { x0: 0, y0: 0, x1: 4, y1: 4 };
        let grey = GreyImage::balanced(&mosaic(), 64.0, window);
        let cell = [grey.values[0], grey.values[1], grey.values[5], grey.values[6]];
        assert!(cell.iter().all(|v| (v - cell[0]).abs() < 1.0), "{cell:?}");
    }

    #[test]
    fn a_frame_with_too_few_samples_is_no_image() {
        let mut frame = mosaic();
        frame.samples = Samples::U16(vec![0; 19]);
        assert_eq!(GreyImage::to_search(&frame, SampleFormat::Brightness), None);
    }
}
