//! Brightness of a session's pixels over time: frame values, as the generator uses them.

use super::CalibrateError;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_core::stats::SplitMix;

/// Side of the square tiles for split and clustered errors, pixels.
pub const TILE: u16 = 8;
/// Bound on stored brightness values: 128 MiB, twice that while frames are added.
const MAX_SAMPLES: u64 = 1 << 25;
/// Lowest usable brightness, DN: below, quantisation is coarse in the logarithm.
const DARKEST_DN: f32 = 1.0;
/// Saturation values of 8- and 10-bit cameras, DN.
const FULL_SCALES_DN: [f32; 2] = [255.0, 1023.0];

/// One half of the tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TileSubset {
    /// For fitting.
    Train,
    /// For evaluation.
    HeldOut,
}

/// Brightness of the usable pixels, pixel by pixel, DN of the frames.
///
/// A pixel is usable when it is neither dark nor saturated in any frame. The criterion does not
/// depend on events.
#[derive(Debug, Clone)]
pub struct BrightnessSeries {
    size: Size,
    times_us: Vec<i64>,
    pixels: Vec<u32>,
    values: Vec<f32>,
    n_unusable: usize,
}

/// Collects frames into a [`BrightnessSeries`].
#[derive(Debug)]
pub struct BrightnessSeriesBuilder {
    size: Size,
    pixels: Vec<u32>,
    times_us: Vec<i64>,
    frames: Vec<f32>,
}

impl BrightnessSeriesBuilder {
    /// For about `n_frames` frames of `size`. Tiles are drawn with `seed` where all would exceed
    /// the memory bound.
    #[must_use]
    pub fn new(size: Size, n_frames: u64, seed: u64) -> Self {
        let columns = u32::from(size.width.div_ceil(TILE));
        let rows = u32::from(size.height.div_ceil(TILE));
        let mut tiles: Vec<u32> = (0..columns * rows).collect();
        let per_tile = u64::from(TILE) * u64::from(TILE) * n_frames.max(1);
        let n_fit = usize::try_from((MAX_SAMPLES / per_tile).max(2)).unwrap_or(usize::MAX);
        if n_fit < tiles.len() {
            tiles.sort_by_key(|&tile| SplitMix::new(seed, u64::from(tile)).bits());
            tiles.truncate(n_fit);
        }
        let is_chosen: std::collections::HashSet<u32> = tiles.into_iter().collect();
        let pixels = (0..size.n_pixels() as u32).filter(|&p| is_chosen.contains(&tile_of(size, p)));
        let pixels = pixels.collect();
        Self { size, pixels, times_us: Vec::new(), frames: Vec::new() }
    }

    /// Adds the next frame.
    ///
    /// # Errors
    /// A frame of another size, or not later than the one before.
    pub fn push(&mut self, frame: &Luminance) -> Result<(), CalibrateError> {
        let index = self.times_us.len();
        if frame.size != self.size || frame.values.len() != self.size.n_pixels() {
            let (expected, found) = (self.size, frame.size);
            return Err(CalibrateError::FrameSize { index, expected, found });
        }
        if let Some(&before_us) = self.times_us.last()
            && frame.t_us <= before_us
        {
            return Err(CalibrateError::FrameOrder { index, t_us: frame.t_us, before_us });
        }
        self.times_us.push(frame.t_us);
        self.frames.extend(self.pixels.iter().map(|&p| frame.values[p as usize]));
        Ok(())
    }

    /// The usable pixels.
    ///
    /// # Errors
    /// With fewer than two frames, or without a usable pixel.
    pub fn finish(self) -> Result<BrightnessSeries, CalibrateError> {
        let n_frames = self.times_us.len();
        if n_frames < 2 {
            return Err(CalibrateError::TooFewFrames { n: n_frames });
        }
        let n = self.pixels.len();
        let brightest = self.frames.iter().copied().fold(0.0, f32::max);
        let full = if FULL_SCALES_DN.contains(&brightest) { brightest } else { f32::INFINITY };
        let (mut pixels, mut values) = (Vec::new(), Vec::new());
        for (slot, &pixel) in self.pixels.iter().enumerate() {
            let series = || (0..n_frames).map(|frame| self.frames[frame * n + slot]);
            if series().all(|v| v.is_finite() && v >= DARKEST_DN && v < full) {
                pixels.push(pixel);
                values.extend(series());
            }
        }
        if pixels.is_empty() {
            return Err(CalibrateError::NoUsablePixel { n_pixels: n });
        }
        let n_unusable = n - pixels.len();
        Ok(BrightnessSeries {
            size: self.size,
            times_us: self.times_us,
            pixels,
            values,
            n_unusable,
        })
    }
}

impl BrightnessSeries {
    /// Columns and rows of the pixel grid.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Times of the frames, µs of the events' clock.
    #[must_use]
    pub fn times_us(&self) -> &[i64] {
        &self.times_us
    }

    /// Row-major numbers of the usable pixels, ascending.
    #[must_use]
    pub fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    /// Pixels left out as dark or saturated.
    #[must_use]
    pub const fn n_unusable(&self) -> usize {
        self.n_unusable
    }

    /// Brightness of usable pixel `slot` in every frame.
    #[must_use]
    pub fn series(&self, slot: usize) -> &[f32] {
        let n = self.times_us.len();
        &self.values[slot * n..(slot + 1) * n]
    }

    /// Usable pixels of a subset, at most `most`: whole tiles drawn with `seed`.
    pub(super) fn slots(&self, part: TileSubset, most: usize, seed: u64) -> Vec<u32> {
        let mine = |&slot: &u32| self.part(self.pixels[slot as usize]) == part;
        let mut slots: Vec<u32> = (0..self.pixels.len() as u32).filter(mine).collect();
        if slots.len() > most {
            let tile = |slot: u32| u64::from(self.tile(self.pixels[slot as usize]));
            slots.sort_by_cached_key(|&slot| (SplitMix::new(seed, tile(slot)).bits(), slot));
            slots.truncate(most);
        }
        slots
    }

    /// The tile of a pixel.
    #[must_use]
    pub fn tile(&self, pixel: u32) -> u32 {
        tile_of(self.size, pixel)
    }

    /// The subset of a pixel: tiles alternate in a checkerboard.
    #[must_use]
    pub fn part(&self, pixel: u32) -> TileSubset {
        part_of(self.size, pixel)
    }
}

/// The tile of a pixel, row-major.
fn tile_of(size: Size, pixel: u32) -> u32 {
    let (x, y) = (pixel % u32::from(size.width), pixel / u32::from(size.width));
    y / u32::from(TILE) * u32::from(size.width.div_ceil(TILE)) + x / u32::from(TILE)
}

pub(super) fn part_of(size: Size, pixel: u32) -> TileSubset {
    let (x, y) = (pixel % u32::from(size.width), pixel / u32::from(size.width));
    let is_even = (x / u32::from(TILE) + y / u32::from(TILE)).is_multiple_of(2);
    if is_even { TileSubset::Train } else { TileSubset::HeldOut }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(t_us: i64, values: [f32; 4]) -> Luminance {
        Luminance { t_us, size: Size::new(2, 2), values: values.to_vec() }
    }

    #[test]
    fn dark_and_cut_off_pixels_are_left_out() {
        let mut builder = BrightnessSeriesBuilder::new(Size::new(2, 2), 2, 0);
        builder.push(&frame(0, [10.0, 0.0, 255.0, 30.0])).unwrap();
        builder.push(&frame(5, [11.0, 9.0, 200.0, 31.0])).unwrap();
        let brightness = builder.finish().unwrap();
        assert_eq!((brightness.pixels(), brightness.n_unusable()), (&[0, 3][..], 2));
        assert_eq!(brightness.series(1), [30.0, 31.0]);
    }

    #[test]
    fn frames_out_of_order_and_of_another_size_are_named() {
        let mut builder = BrightnessSeriesBuilder::new(Size::new(2, 2), 2, 0);
        builder.push(&frame(5, [10.0; 4])).unwrap();
        let error = builder.push(&frame(5, [10.0; 4])).unwrap_err().to_string();
        assert!(error.contains("frame 1 at 5 us"), "{error}");
        let wide = Luminance { t_us: 9, size: Size::new(4, 1), values: vec![1.0; 4] };
        let error = builder.push(&wide).unwrap_err().to_string();
        assert!(error.contains("4 x 1") && error.contains("2 x 2"), "{error}");
        assert!(builder.finish().is_err());
    }

    #[test]
    fn long_recordings_are_thinned_by_whole_tiles() {
        let size = Size::new(64, 64);
        let builder = BrightnessSeriesBuilder::new(size, MAX_SAMPLES / 640, 3);
        assert_eq!(builder.pixels.len(), 640);
        let tiles: std::collections::HashSet<u32> =
            builder.pixels.iter().map(|&p| tile_of(size, p)).collect();
        assert_eq!(tiles.len(), 10);
    }
}
