//! A pixel as a hypothesis predicts it.

use super::image_pose::ImagePose;
use super::sampled_sine::interpolation_gain;
use crate::diagnose::{Evidence, PixelEvidence};
use crate::predict::{PixelLaw, PixelSignal};

/// A hypothesis applied to one pixel: filtered signal, law and clock.
#[derive(Debug)]
pub struct PredictedPixel<'a> {
    /// All data.
    pub evidence: &'a Evidence,
    /// The pixel.
    pub pixel: &'a PixelEvidence,
    /// Its law.
    pub law: PixelLaw,
    /// The signal that it compares, at every instant.
    pub signal: Vec<f32>,
    /// Time of the first instant on the events' clock, microseconds since the window's start.
    pub start_us: f64,
    /// From one instant to the next on the events' clock, microseconds.
    pub step_us: f64,
}

impl PredictedPixel<'_> {
    /// The signal as the likelihood takes it.
    #[must_use]
    pub fn light(&self) -> PixelSignal<'_> {
        let (start_us, step_us) = (self.start_us, self.step_us);
        let (signal, level) = (&self.signal, &self.pixel.light);
        PixelSignal { start_us, step_us, signal, level, knots: None }
    }

    /// A sinusoid at every instant, amplified so that its linear interpolation has unit amplitude.
    /// The phase refers to the middle of the signal, where it hardly depends on the frequency.
    pub fn swing(&self, hz: f64, phase: f64) -> impl Iterator<Item = f64> + use<> {
        let turn = std::f64::consts::TAU * hz * self.step_s();
        let (n, height) = (self.signal.len(), interpolation_gain(turn));
        (0..n).map(move |i| height * (turn * (i as f64 - 0.5 * n as f64) + phase).sin())
    }

    /// Step between instants, seconds.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        self.evidence.step_us * 1e-6
    }

    /// Displaces the image, to first order.
    pub(crate) fn displace(&mut self, pose: ImagePose) {
        if pose == ImagePose::default() {
            return;
        }
        let pixel = self.pixel;
        let place = [f64::from(pixel.x) + 0.5, f64::from(pixel.y) + 0.5];
        let source = pose.source_of(place, self.evidence.middle);
        let [dx, dy] = [0, 1].map(|i| (source[i] - place[i]) as f32);
        let [gx, gy] = &pixel.gradient;
        for ((signal, gx), gy) in self.signal.iter_mut().zip(gx).zip(gy) {
            *signal += dx * gx + dy * gy;
        }
    }

    /// Blurs the image by a variance beyond that of the map, square pixels, to first order.
    pub(crate) fn blur(&mut self, px2: f64) {
        if px2 == 0.0 {
            return;
        }
        let half = 0.5 * px2 as f32;
        for (signal, laplacian) in self.signal.iter_mut().zip(&self.pixel.laplacian) {
            // First order holds for a few tenths of log intensity only.
            *signal += (half * laplacian).clamp(-0.7, 0.7);
        }
    }
}
