//! Interpolation between the pixels of a frame, as sharp as the frames allow.

use super::bilinear;
use super::frame_view::FrameView;
use super::optical_flow::{FrameFlow, best_shift, flow_ends};
use super::pixel_noise::PixelNoise;
use rayon::prelude::*;

/// Neighbours of a position in a row or column.
const N_TAPS: usize = 8;
/// Positions between two pixels for which weights are tabulated.
const N_PHASES: usize = 1_024;
/// Frame pairs from which the sharpness is fitted, and the distance of the compared pixels.
const MAX_PAIRS: usize = 64;
const SPACING_PX: usize = 2;

/// Separable interpolation, between cubic convolution (sharpness 0) and a windowed sinc (1). Thin
/// lines keep the contrast that bilinear interpolation takes from them; a sinc keeps more of it, but
/// rings at edges that the pixels do not resolve, and at noise.
#[derive(Debug, Clone)]
pub(super) struct InterpolationKernel {
    /// Weights of the neighbours by the distance from the fourth.
    weights: Vec<[f32; N_TAPS]>,
}

/// Weights of cubic convolution (Keys, IEEE Trans. ASSP 29, 1981, a = -1/2) at a distance from the
/// fourth of eight neighbours: exact for a parabola.
fn cubic(u: f32) -> [f32; N_TAPS] {
    let before = u * (-0.5 + u * (1.0 - 0.5 * u));
    let first = 1.0 + u * u * (-2.5 + 1.5 * u);
    let second = u * (0.5 + u * (2.0 - 1.5 * u));
    [0.0, 0.0, before, first, second, 0.5 * u * u * (u - 1.0), 0.0, 0.0]
}

/// Weights of a sinc windowed by the main lobe of another one (Duchon, J. Appl. Meteorol. 18, 1979),
/// with sum one.
fn sinc(u: f32) -> [f32; N_TAPS] {
    let half = (N_TAPS / 2) as f32;
    let sinc = |x: f32| {
        let angle = x * std::f32::consts::PI;
        if angle == 0.0 { 1.0 } else { angle.sin() / angle }
    };
    let weights: [f32; N_TAPS] = std::array::from_fn(|i| {
        let distance = i as f32 + 1.0 - half - u;
        sinc(distance) * sinc(distance / half)
    });
    let sum: f32 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

impl InterpolationKernel {
    pub(super) fn with_sharpness(sharpness: f32) -> Self {
        let weights = |phase: usize| {
            let u = phase as f32 / N_PHASES as f32;
            let (soft, sharp) = (cubic(u), sinc(u));
            std::array::from_fn(|i| soft[i] + sharpness * (sharp[i] - soft[i]))
        };
        Self { weights: (0..=N_PHASES).map(weights).collect() }
    }

    /// That which best predicts the logarithm of frames from the ones before, along their motion.
    pub(super) fn fitted<'a>(n_pairs: usize, pair: impl Fn(usize) -> MovedPair<'a> + Sync) -> Self {
        let kernels = [0.0, 1.0].map(Self::with_sharpness);
        let pairs = (0..n_pairs).into_par_iter().step_by(n_pairs.div_ceil(MAX_PAIRS).max(1));
        let sums = pairs.map(|k| pair(k).regression(&kernels));
        let [product, square] = sums.reduce(|| [0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let sharpness = if square > 0.0 { (product / square).clamp(0.0, 1.0) } else { 0.0 };
        Self::with_sharpness(sharpness as f32)
    }

    /// The neighbours around a position among `n`, clamped beyond the border, and their weights.
    fn neighbours(&self, at: f32, n: usize) -> ([usize; N_TAPS], &[f32; N_TAPS]) {
        let ([first, _], u) = bilinear::neighbours(at, n);
        let before = N_TAPS / 2 - 1;
        let taps = std::array::from_fn(|i| (first + i).saturating_sub(before).min(n - 1));
        (taps, &self.weights[(u * N_PHASES as f32 + 0.5) as usize])
    }

    /// The value at a position in pixels from the middle of the first pixel; the nearest pixel's
    /// where an undershoot leaves no light.
    pub(super) fn value(&self, view: FrameView<'_>, [x, y]: [f32; 2]) -> f32 {
        let (columns, across) = self.neighbours(x, view.width());
        let (rows, down) = self.neighbours(y, view.height());
        let along = |row: usize| -> f32 {
            let line = &view.values[row * view.width()..][..view.width()];
            columns.iter().zip(across).map(|(column, weight)| line[*column] * weight).sum()
        };
        let value: f32 = rows.iter().zip(down).map(|(row, weight)| along(*row) * weight).sum();
        if value > 0.0 { value } else { view.at([x.round(), y.round()]) }
    }
}

/// Two consecutive frames and the motion between them.
pub(super) struct MovedPair<'a> {
    pub(super) views: [FrameView<'a>; 2],
    pub(super) flow: &'a FrameFlow,
    pub(super) noise: &'a PixelNoise,
    /// Intensity from which a pixel is saturated.
    pub(super) saturated: f32,
}

impl MovedPair<'_> {
    /// Sums of the regression of the second frame's logarithms on the difference of the predictions
    /// by two kernels.
    fn regression(&self, kernels: &[InterpolationKernel; 2]) -> [f64; 2] {
        let [width, height] = [self.views[0].width(), self.views[0].height()];
        let places = (0..height)
            .step_by(SPACING_PX)
            .flat_map(|y| (0..width).step_by(SPACING_PX).map(move |x| [x as f32, y as f32]));
        let seen = places.filter_map(|place| self.moved(place));
        seen.fold([0.0; 2], |[product, square], (from, intensity)| {
            let [soft, sharp] = [0, 1].map(|i| kernels[i].value(self.views[0], from).ln());
            let difference = f64::from(sharp - soft);
            let residual = f64::from(intensity.ln() - soft);
            [product + residual * difference, square + difference * difference]
        })
    }

    /// Where the light of a pixel of the second frame was in the first, and its intensity; None
    /// where nothing moves, at the border, and near saturated pixels.
    fn moved(&self, place: [f32; 2]) -> Option<([f32; 2], f32)> {
        self.flow.candidates(place).next()?;
        let [before, after] = self.views;
        let noise = self.noise.at(before.at(place));
        let shift = best_shift(self.views, place, 1.0, self.flow.candidates(place), noise);
        let [from, _] = flow_ends(place, 1.0, shift);
        let margin = (N_TAPS / 2) as f32;
        let is_inside = |at: f32, n: usize| (margin..=n as f32 - 1.0 - margin).contains(&at);
        if !is_inside(from[0], before.width()) || !is_inside(from[1], before.height()) {
            return None;
        }
        let intensity = after.at(place);
        let most = before.corners(from).max_value(before.values).max(intensity);
        (shift != [0.0; 2] && most < self.saturated).then_some((from, intensity))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;

    #[test]
    fn a_parabola_is_read_back_and_no_light_is_left_at_an_edge() {
        let size = Size { width: 16, height: 15 };
        let curved = |x: f32, y: f32| 20.0 + 0.5 * x * x - 0.25 * y * y + 0.1 * x * y;
        let values: Vec<f32> = (0..240).map(|i| curved((i % 16) as f32, (i / 16) as f32)).collect();
        let view = FrameView { size, values: &values };
        let soft = InterpolationKernel::with_sharpness(0.0);
        for [x, y] in [[2.0, 3.0], [3.25, 2.5], [5.75, 4.125]] {
            assert!((soft.value(view, [x, y]) - curved(x, y)).abs() < 1e-4);
        }
        let edge: Vec<f32> = (0..240).map(|i| if i % 16 < 8 { 0.001 } else { 1.0 }).collect();
        let view = FrameView { size, values: &edge };
        let sharp = InterpolationKernel::with_sharpness(1.0);
        for kernel in [soft, sharp] {
            assert!((0..150).all(|i| kernel.value(view, [0.1 * i as f32, 3.0]) > 0.0));
        }
    }

    #[test]
    fn a_sinc_keeps_the_contrast_of_lines_that_cubic_convolution_takes() {
        let size = Size { width: 40, height: 1 };
        let wave = |x: f32| 1.0 + 0.5 * (2.2 * x).cos();
        let values: Vec<f32> = (0..40).map(|i| wave(i as f32)).collect();
        let view = FrameView { size, values: &values };
        let error = |sharpness| {
            let kernel = InterpolationKernel::with_sharpness(sharpness);
            let misses =
                (50..300).map(|i| 0.1 * i as f32).map(|x| kernel.value(view, [x, 0.0]) - wave(x));
            misses.map(f32::abs).fold(0.0, f32::max)
        };
        assert!(error(0.0) > 0.15 && error(1.0) < 0.03, "{} {}", error(0.0), error(1.0));
    }
}
