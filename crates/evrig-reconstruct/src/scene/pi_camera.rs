//! The Pi camera's pixels: rays, Bayer gains and vignetting (`1 - loss (r / r_corner)^2`).

use super::error::SceneError;
use super::head::stated_ray;
use crate::roi::Lens;
use evrig_core::frame::{Channels, Frame, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::PiSensor;
use serde::{Deserialize, Serialize};

/// Levels of raw samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RawLevels {
    /// Reading without light, DN.
    pub black_dn: f64,
    /// Saturated reading; such samples are excluded.
    pub full_dn: u16,
}

#[derive(Debug, Clone)]
pub(super) struct PiCamera {
    pub(super) size: Size,
    pub(super) lens: Lens,
    raw: RawLevels,
    /// Inverse gains of the four Bayer sites, by row and column parity.
    over_gain: [f32; 4],
    /// Vignetting at the corners, as a share of the light.
    corner_loss: f64,
    /// Inverse transmission of each pixel, row-major.
    over_passed: Vec<f32>,
    /// Rays of the pixel centres, row-major; `NaN` where the distortion has no inverse.
    rays: Vec<[f32; 2]>,
}

impl PiCamera {
    pub(super) fn new(size: Size, lens: Lens, raw: RawLevels) -> Self {
        let width = usize::from(size.width);
        let ray = |i: usize| {
            let middle = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            stated_ray(&lens, middle).map_or([f32::NAN; 2], |ray| ray.map(|part| part as f32))
        };
        let rays = (0..size.n_pixels()).map(ray).collect();
        let over_passed = vec![1.0; size.n_pixels()];
        Self { size, lens, raw, over_gain: [1.0; 4], corner_loss: 0.0, over_passed, rays }
    }

    pub(super) fn corner_loss(&self) -> f64 {
        self.corner_loss
    }

    pub(super) fn set_corner_loss(&mut self, loss: f64) {
        self.corner_loss = loss;
        let width = usize::from(self.size.width);
        let passed = |i: usize| 1.0 - loss * self.squared_radius(i % width, i / width);
        self.over_passed = (0..self.size.n_pixels()).map(|i| (1.0 / passed(i)) as f32).collect();
    }

    /// Squared distance of a pixel from the image centre over that of the corners.
    pub(super) fn squared_radius(&self, x: usize, y: usize) -> f64 {
        squared_radius(self.size, [x as f64 + 0.5, y as f64 + 0.5])
    }

    /// The samples of a frame, checked against the camera's format.
    pub(super) fn samples(
        &self,
        index: usize,
        frame: &Frame<PiSensor>,
    ) -> Result<Vec<u16>, SceneError> {
        let got = (frame.size, frame.channels);
        match &frame.samples {
            Samples::U16(samples)
                if got == (self.size, Channels::Gray) && samples.len() == self.size.n_pixels() =>
            {
                Ok(samples.clone())
            }
            _ => Err(SceneError::NotRaw { index, got: frame.size, expected: self.size }),
        }
    }

    pub(super) fn middle_row(&self) -> f64 {
        (f64::from(self.size.height) - 1.0) / 2.0
    }

    /// Light of a pixel in DN of green above black; None where saturated.
    #[inline]
    pub(super) fn light(&self, samples: &[u16], x: usize, y: usize) -> Option<f32> {
        let at = y * usize::from(self.size.width) + x;
        let signal = f32::from(samples[at]) - self.raw.black_dn as f32;
        (samples[at] < self.raw.full_dn).then(|| signal * self.scale(x, y, at))
    }

    /// Light per signal of the pixel at index `at`.
    #[inline]
    fn scale(&self, x: usize, y: usize, at: usize) -> f32 {
        self.over_gain[y % 2 * 2 + x % 2] * self.over_passed[at]
    }

    pub(super) fn signal(&self, light: f64, x: usize, y: usize) -> f64 {
        light / f64::from(self.scale(x, y, y * usize::from(self.size.width) + x))
    }

    #[inline]
    pub(super) fn ray(&self, x: usize, y: usize) -> [f64; 2] {
        self.rays[y * usize::from(self.size.width) + x].map(f64::from)
    }

    /// Relative precision of a pixel's light: noise grows as the gain falls.
    #[inline]
    pub(super) fn weight(&self, x: usize, y: usize) -> f32 {
        1.0 / self.over_gain[y % 2 * 2 + x % 2]
    }

    /// Gains of the four Bayer sites; the larger green is one.
    pub(super) fn gains(&self) -> [f64; 4] {
        self.over_gain.map(|over| 1.0 / f64::from(over))
    }

    /// Sets the gains from a high quantile of each Bayer site.
    pub(super) fn balance<'a>(&mut self, frames: impl Iterator<Item = &'a [u16]>) {
        let width = usize::from(self.size.width);
        let mut counts = vec![[0_u64; 4]; usize::from(self.raw.full_dn) + 1];
        for samples in frames {
            for (i, sample) in samples.iter().enumerate().step_by(3) {
                let site = i / width % 2 * 2 + i % width % 2;
                if let Some(count) = counts.get_mut(usize::from(*sample)) {
                    count[site] += 1;
                }
            }
        }
        let white = |site: usize| {
            let all: u64 = counts.iter().map(|count| count[site]).sum();
            let mut above = all / 10;
            let at = counts.iter().rposition(|count| {
                let here = count[site];
                let found = above < here;
                above = above.saturating_sub(here);
                found
            });
            (at.unwrap_or(0) as f64 - self.raw.black_dn).max(1.0)
        };
        let whites = [0, 1, 2, 3].map(white);
        let most = whites.into_iter().fold(1.0, f64::max);
        self.over_gain = whites.map(|white| (most / white) as f32);
    }

    /// Divides out the ratio of each site's readings to the map.
    pub(super) fn rebalance(&mut self, ratios: [f64; 4]) {
        for (over, ratio) in self.over_gain.iter_mut().zip(ratios) {
            if ratio.is_finite() && ratio > 0.2 {
                *over /= ratio as f32;
            }
        }
    }
}

/// Squared distance from the image centre over that of the corners.
pub(super) fn squared_radius(size: Size, [x, y]: [f64; 2]) -> f64 {
    let half = [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0];
    ((x - half[0]).powi(2) + (y - half[1]).powi(2)) / (half[0].powi(2) + half[1].powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_lens_loses_towards_the_corners_is_made_good() {
        let lens = Lens { focal_px: 100.0, centre_px: [8.0, 8.0], distortion: [0.0; 5] };
        let raw = RawLevels { black_dn: 64.0, full_dn: 1023 };
        let mut camera = PiCamera::new(Size::new(16, 16), lens, raw);
        camera.set_corner_loss(0.4);
        let white = |i: usize| 64.0 + 500.0 * (1.0 - 0.4 * camera.squared_radius(i % 16, i / 16));
        let samples: Vec<u16> = (0..256).map(|i| white(i).round() as u16).collect();
        for (x, y) in [(0, 0), (8, 8), (15, 3)] {
            assert!((camera.light(&samples, x, y).unwrap() - 500.0).abs() < 1.5);
        }
        assert!((camera.signal(500.0, 8, 8) - 500.0).abs() < 1.0);
    }

    #[test]
    fn the_places_of_the_mosaic_are_balanced_on_white_and_cut_off_light_is_none() {
        let lens = Lens { focal_px: 100.0, centre_px: [8.0, 8.0], distortion: [0.0; 5] };
        let raw = RawLevels { black_dn: 64.0, full_dn: 1023 };
        let mut camera = PiCamera::new(Size::new(16, 16), lens, raw);
        let whites = [360_u16, 600, 600, 420];
        let sample = |i: usize| {
            let white = whites[i / 16 % 2 * 2 + i % 2];
            64 + if i / 16 < 8 { white } else { white / 4 }
        };
        let mut samples: Vec<u16> = (0..256).map(sample).collect();
        samples[0] = 1023;
        camera.balance(std::iter::once(samples.as_slice()));
        assert_eq!(camera.light(&samples, 0, 0), None);
        for (x, y) in [(1, 0), (2, 0), (3, 3), (4, 7)] {
            assert!((camera.light(&samples, x, y).unwrap() - 600.0).abs() < 2.0);
        }
        assert!((camera.light(&samples, 2, 12).unwrap() - 150.0).abs() < 1.0);
        assert_eq!(camera.ray(8, 8), [0.5, 0.5].map(|p: f64| f64::from((p / 100.0) as f32)));
    }
}
