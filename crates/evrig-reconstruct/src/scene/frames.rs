//! Log-intensity signal from frames on the event pixels' own grid: linear between frames, or
//! motion-compensated.

use super::bilinear::BilinearWeights;
use super::frame_view::FrameView;
use super::interpolation::{InterpolationKernel, MovedPair};
use super::optical_flow::{FrameFlow, best_shift, flow_ends};
use super::patch::PATCH_HALF_PX;
use super::pixel_noise::PixelNoise;
use super::temporal_denoising::denoise;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use rayon::prelude::*;
use std::borrow::Borrow;
use std::sync::OnceLock;

/// Why frames cannot serve as a log-intensity signal.
#[derive(Debug, thiserror::Error)]
pub enum FramesError {
    /// One frame has no temporal change.
    #[error("{n} frames; a log-intensity signal needs at least two")]
    TooFew {
        /// Frames given.
        n: usize,
    },
    /// Frames must ascend in time and share one size.
    #[error(
        "frame {index} at {t_us} us is {size}; expected a later time than {before_us} us and \
         {expected}"
    )]
    Order {
        /// Index of the frame, from 0.
        index: usize,
        /// Its time.
        t_us: i64,
        /// Its size.
        size: Size,
        /// Time of the frame before.
        before_us: i64,
        /// Size of the first frame.
        expected: Size,
    },
    /// No pixel exceeds the black level.
    #[error("no pixel of the frames is brighter than the black level of {black_dn} DN")]
    Dark {
        /// The black level subtracted.
        black_dn: f64,
    },
}

/// Quantile of pixel values that counts as white.
const WHITE_QUANTILE: f64 = 0.995;
/// Least intensity above black whose logarithm is taken, DN: half a quantization step.
const FLOOR_DN: f64 = 0.5;
/// Frames at which the error is evaluated, approximately.
const MAX_ERROR_FRAMES: usize = 256;
/// Least share of values at the maximum that marks saturation.
const MIN_SATURATED_SHARE: f64 = 1e-4;
/// Instants between two frames, both ends included, between which a finely sampled
/// motion-compensated signal is linear.
const N_FLOW_NODES: usize = 17;
/// Tracked points in total, and the range per frame pair: a long recording has fewer in each pair.
const MAX_TRACKED_POINTS: usize = 100_000;
const POINTS_PER_PAIR: [usize; 2] = [150, 1_500];

/// Log-intensity signal from frames: linear between frames at each pixel, or interpolated along
/// optical flow.
#[derive(Debug, Clone)]
pub struct FramesDrive {
    size: Size,
    times_us: Vec<i64>,
    row_us: f64,
    white_dn: f64,
    /// Frame after frame, row-major intensities over white.
    values: Vec<f32>,
    /// Motion from each frame to the next; empty without motion compensation.
    flows: Vec<FrameFlow>,
    /// Interpolation between pixels along the motion.
    kernel: InterpolationKernel,
    /// Saturated intensity; infinite where saturated values are used as they are.
    saturated: f32,
    noise: OnceLock<PixelNoise>,
}

impl FramesDrive {
    /// From frames stamped at mid-exposure of their first row; row `y` is `y * row_us` later.
    /// `black_dn` is the reading without light, DN.
    ///
    /// # Errors
    /// With fewer than two frames, frames out of order or of different sizes, or no light at all.
    pub fn new<F: Borrow<Luminance>>(
        frames: impl IntoIterator<Item = F>,
        black_dn: f64,
        row_us: f64,
    ) -> Result<Self, FramesError> {
        // Frames are consumed one by one, so that a long recording is not held twice.
        let (mut times_us, mut values) = (Vec::new(), Vec::new());
        let mut expected = None;
        for frame in frames {
            let frame = frame.borrow();
            check_order(&times_us, frame, *expected.get_or_insert(frame.size))?;
            times_us.push(frame.t_us);
            values.extend_from_slice(&frame.values);
        }
        let n = times_us.len();
        let size = expected.filter(|_| n > 1).ok_or(FramesError::TooFew { n })?;
        let white_dn = white_level(&values, size.n_pixels()) - black_dn;
        if white_dn.is_nan() || white_dn <= FLOOR_DN {
            return Err(FramesError::Dark { black_dn });
        }
        let log_intensity = |value: f32| (f64::from(value) - black_dn).max(FLOOR_DN) / white_dn;
        values.iter_mut().for_each(|value| *value = log_intensity(*value) as f32);
        let (flows, saturated, noise) = (Vec::new(), f32::INFINITY, OnceLock::new());
        let kernel = InterpolationKernel::with_sharpness(0.0);
        Ok(Self { size, times_us, row_us, white_dn, values, flows, kernel, saturated, noise })
    }

    /// Leaves saturated values out: the signal is `NaN` where a frame reached the end of its range.
    #[must_use]
    pub fn without_saturated(mut self) -> Self {
        let most = self.values.iter().copied().fold(0.0, f32::max);
        let n_most = self.values.iter().filter(|value| **value >= most).count();
        // The maximum of a few pixels is no saturation.
        if n_most as f64 >= MIN_SATURATED_SHARE * self.values.len() as f64 {
            self.saturated = most;
        }
        self
    }

    /// Temporal denoising of static regions. Motion must be estimated before. [`Drive::noise`]
    /// stays that of single frames, since regions that change keep it.
    #[must_use]
    pub fn denoised(mut self) -> Self {
        let noise = self.frame_noise().clone();
        denoise(&mut self.values, self.size.n_pixels(), &noise, self.saturated);
        self
    }

    /// Motion-compensated (optical-flow) interpolation between frames. It stays linear where no
    /// motion is tracked.
    #[must_use]
    pub fn motion_compensated(mut self) -> Self {
        let n = self.times_us.len() - 1;
        let most = (MAX_TRACKED_POINTS / n).clamp(POINTS_PER_PAIR[0], POINTS_PER_PAIR[1]);
        let noise = self.frame_noise();
        let pairs = (0..n).into_par_iter();
        self.flows = pairs
            .map(|k| FrameFlow::estimate(self.view(k), self.view(k + 1), noise, most))
            .collect();
        self.kernel = InterpolationKernel::fitted(n, |k| MovedPair {
            views: [self.view(k), self.view(k + 1)],
            flow: &self.flows[k],
            noise: self.frame_noise(),
            saturated: self.saturated,
        });
        self
    }

    fn view(&self, frame: usize) -> FrameView<'_> {
        let n = self.size.n_pixels();
        FrameView { size: self.size, values: &self.values[frame * n..(frame + 1) * n] }
    }

    /// The light between two frames along the optical flow; None where nothing moves.
    fn along_flow(&self, frame: usize, place: [f64; 2]) -> Option<AlongFlow<'_>> {
        let flow = self.flows.get(frame)?;
        let place = [place[0] - 0.5, place[1] - 0.5].map(|p| p as f32);
        flow.candidates(place).next()?;
        let noise = self.frame_noise().at(self.view(frame).at(place));
        Some(AlongFlow { drive: self, flow, frame, place, noise, nodes: [None; N_FLOW_NODES] })
    }

    /// Times of the frames' first rows, microseconds.
    #[must_use]
    pub fn times_us(&self) -> &[i64] {
        &self.times_us
    }

    /// Bilinear weights at a position; None outside the outermost pixel centres, and with motion
    /// within half a patch of them.
    fn corners(&self, place: [f64; 2]) -> Option<BilinearWeights> {
        let [x, y] = place.map(|p| p - 0.5);
        let [right, bottom] = [self.size.width, self.size.height].map(|n| f64::from(n) - 1.0);
        // Motion is found by patches, which at the border lack pixels.
        let least = if self.flows.is_empty() { 0.0 } else { PATCH_HALF_PX as f64 };
        let is_inside =
            (least..=right - least).contains(&x) && (least..=bottom - least).contains(&y);
        is_inside.then(|| self.view(0).corners([x as f32, y as f32]))
    }

    /// Interpolated log intensity of a frame; `NaN` where a neighbour is saturated.
    fn log_intensity(&self, frame: usize, corners: &BilinearWeights) -> f32 {
        self.log_unless_saturated(frame, corners, |view| corners.value(view.values))
    }

    /// Logarithm of an intensity between the pixels of a frame; `NaN` where one of them is saturated.
    fn log_unless_saturated(
        &self,
        frame: usize,
        corners: &BilinearWeights,
        intensity: impl FnOnce(FrameView<'_>) -> f32,
    ) -> f32 {
        let view = self.view(frame);
        let is_saturated = corners.max_value(view.values) >= self.saturated;
        if is_saturated { f32::NAN } else { intensity(view).ln() }
    }

    fn frame_noise(&self) -> &PixelNoise {
        self.noise.get_or_init(|| {
            // Half a step of eight bits bounds the noise of noise-free frames.
            let least = FLOOR_DN / self.white_dn.max(255.0);
            PixelNoise::estimate(&self.values, self.size.n_pixels(), least as f32)
        })
    }
}

/// The light at a position between two frames, along the optical flow.
struct AlongFlow<'a> {
    drive: &'a FramesDrive,
    flow: &'a FrameFlow,
    frame: usize,
    place: [f32; 2],
    noise: f32,
    nodes: [Option<f32>; N_FLOW_NODES],
}

impl AlongFlow<'_> {
    /// Logarithm of the intensity a share of the way from the earlier frame to the later.
    fn at(&self, share: f32) -> f32 {
        let views = [self.drive.view(self.frame), self.drive.view(self.frame + 1)];
        let shifts = self.flow.candidates(self.place);
        let shift = best_shift(views, self.place, share, shifts, self.noise);
        let [from, to] = flow_ends(self.place, share, shift);
        let kernel = &self.drive.kernel;
        let log_intensity = |k: usize, end| {
            let corners = views[k].corners(end);
            self.drive
                .log_unless_saturated(self.frame + k, &corners, |view| kernel.value(view, end))
        };
        let [before, after] = [log_intensity(0, from), log_intensity(1, to)];
        before + (after - before) * share
    }

    /// The same, linear between nodes that are evaluated once.
    fn between_nodes(&mut self, share: f32) -> f32 {
        let last = N_FLOW_NODES - 1;
        let at = share * last as f32;
        let i = (at as usize).min(last - 1);
        let [a, b] = [i, i + 1].map(|i| match self.nodes[i] {
            Some(value) => value,
            None => *self.nodes[i].insert(self.at(i as f32 / last as f32)),
        });
        a + (b - a) * (at - i as f32)
    }
}

fn check_order(before_us: &[i64], frame: &Luminance, expected: Size) -> Result<(), FramesError> {
    let (index, t_us, size) = (before_us.len(), frame.t_us, frame.size);
    match before_us.last() {
        Some(&before_us) if t_us <= before_us || size != expected => {
            Err(FramesError::Order { index, t_us, size, before_us, expected })
        }
        _ => Ok(()),
    }
}

/// White level: a high quantile over a subset of the frames.
fn white_level(values: &[f32], n_pixels: usize) -> f64 {
    let frames = values.chunks(n_pixels.max(1));
    let step = frames.len().div_ceil(16);
    let mut values: Vec<f32> = frames.step_by(step).flatten().copied().collect();
    values.sort_by(f32::total_cmp);
    f64::from(values[((values.len() - 1) as f64 * WHITE_QUANTILE) as usize])
}

impl Drive for FramesDrive {
    fn size(&self) -> Size {
        self.size
    }

    fn span_us(&self) -> [i64; 2] {
        let last = self.times_us.len() - 1;
        let rows = self.row_us * f64::from(self.size.height.saturating_sub(1));
        [self.times_us[0] + rows.max(0.0).ceil() as i64, self.times_us[last] + rows.min(0.0) as i64]
    }

    fn white_dn(&self) -> f64 {
        self.white_dn
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        out.fill(f32::NAN);
        let Some(corners) = self.corners(place) else { return false };
        let row_delay_us = self.row_us * (place[1] - 0.5);
        let last = self.times_us.len() - 1;
        let (mut frame, mut any) = (0, false);
        let (mut before, mut after) =
            (self.log_intensity(0, &corners), self.log_intensity(1, &corners));
        let mut along_flow = self.along_flow(0, place);
        for (i, out) in out.iter_mut().enumerate().take(grid.n) {
            let t_us = grid.at(i) as f64 - row_delay_us;
            while frame + 1 < last && t_us >= self.times_us[frame + 1] as f64 {
                frame += 1;
                (before, after) = (after, self.log_intensity(frame + 1, &corners));
                along_flow = self.along_flow(frame, place);
            }
            let (t0, t1) = (self.times_us[frame] as f64, self.times_us[frame + 1] as f64);
            if (t0..=t1).contains(&t_us) {
                let share = ((t_us - t0) / (t1 - t0)) as f32;
                let is_fine = f64::from(grid.step_us) * (N_FLOW_NODES as f64) < t1 - t0;
                *out = match &mut along_flow {
                    None => before + (after - before) * share,
                    Some(along_flow) if is_fine => along_flow.between_nodes(share),
                    Some(along_flow) => along_flow.at(share),
                };
                any |= out.is_finite();
            }
        }
        any
    }

    fn noise(&self, place: [f64; 2]) -> f32 {
        let log_intensity =
            self.corners(place).map(|corners| self.log_intensity(0, &corners).exp());
        let log_intensity =
            log_intensity.filter(|log_intensity| log_intensity.is_finite()).unwrap_or(1.0);
        self.frame_noise().at(log_intensity) / log_intensity
    }

    /// From the deviation of each frame from the line between its neighbours: an upper bound. If
    /// all of it is noise, the difference of two linearly interpolated values has 0.94 of its
    /// standard deviation (twice 2/3 of a frame's variance, against the 3/2 measured here). Of a
    /// true curvature between frames it has a quarter.
    fn error(&self, place: [f64; 2]) -> f32 {
        let Some(corners) = self.corners(place) else { return f32::NAN };
        let inner = 1..self.times_us.len().saturating_sub(1);
        let step = inner.len().div_ceil(MAX_ERROR_FRAMES).max(1);
        let (mut sum, mut n) = (0.0_f32, 0);
        for frame in inner.step_by(step) {
            let [a, b, c] = [frame - 1, frame, frame + 1].map(|k| self.times_us[k] as f64);
            let [x, y, z] = [frame - 1, frame, frame + 1].map(|k| self.log_intensity(k, &corners));
            let beside = y - x - (z - x) * ((b - a) / (c - a)) as f32;
            if beside.is_finite() {
                sum += beside.powi(2);
                n += 1;
            }
        }
        if n == 0 { f32::NAN } else { 0.94 * (sum / n as f32).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(t_us: i64, values: [f32; 4]) -> Luminance {
        let size = Size { width: 2, height: 2 };
        Luminance { t_us, size, values: values.to_vec() }
    }

    #[test]
    fn the_signal_is_straight_in_the_logarithm_between_frames_at_each_rows_time() {
        let frames = [frame(0, [110.0; 4]), frame(1_000, [60.0; 4]), frame(3_000, [35.0; 4])];
        let drive = FramesDrive::new(&frames, 10.0, 100.0).unwrap();
        assert!((drive.white_dn() - 100.0).abs() < 1e-9);
        let grid = TimeGrid { start_us: 0, step_us: 100, n: 32 };
        let upper = drive.curve(0, 0, grid).unwrap();
        let lower = drive.curve(1, 1, grid).unwrap();
        assert!((upper.values()[5] + 0.5 * 2.0_f32.ln()).abs() < 1e-6);
        assert!((upper.values()[20] + 1.5 * 2.0_f32.ln()).abs() < 1e-6);
        assert!(lower.values()[0].is_nan(), "the second row is exposed 100 us later");
        assert!((lower.values()[6] - upper.values()[5]).abs() < 1e-6);
        assert!(upper.values()[31].is_nan(), "nothing is known behind the last frame");
        assert_eq!(drive.span_us(), [100, 3_000]);
    }

    #[test]
    fn a_frame_at_the_end_of_its_range_determines_no_light() {
        let frames =
            [frame(0, [40.0, 255.0, 255.0, 60.0]), frame(1_000, [30.0, 255.0, 80.0, 255.0])];
        let drive = FramesDrive::new(&frames, 0.0, 0.0).unwrap().without_saturated();
        let grid = TimeGrid { start_us: 0, step_us: 250, n: 5 };
        let known = |x, y| {
            drive
                .curve(x, y, grid)
                .map(|curve| curve.values().iter().filter(|value| value.is_finite()).count())
        };
        assert_eq!(known(0, 0), Some(5));
        assert_eq!([known(1, 0), known(0, 1), known(1, 1)], [None; 3], "saturated before or after");
        let interpolate = FramesDrive::new(&frames, 0.0, 0.0).unwrap();
        assert!(interpolate.curve(1, 0, grid).is_some(), "saturated values are kept by default");
    }

    #[test]
    fn frames_that_cannot_serve_are_refused_with_the_reason() {
        let one = FramesDrive::new(&[frame(0, [1.0; 4])], 0.0, 0.0).unwrap_err();
        assert!(one.to_string().contains("at least two"));
        let still = [frame(5, [1.0; 4]), frame(5, [1.0; 4])];
        assert!(FramesDrive::new(&still, 0.0, 0.0).unwrap_err().to_string().contains("frame 1"));
        let dark = [frame(0, [8.0; 4]), frame(5, [8.0; 4])];
        assert!(FramesDrive::new(&dark, 8.0, 0.0).unwrap_err().to_string().contains("8 DN"));
    }

    #[test]
    fn the_error_is_that_of_the_frames_noise_and_nothing_on_a_line() {
        let line: Vec<_> =
            (0..9).map(|i| frame(1_000 * i, [100.0 * (0.05 * i as f32).exp(); 4])).collect();
        let straight = FramesDrive::new(&line, 0.0, 0.0).unwrap();
        assert!(straight.error([1.0, 1.0]) < 1e-4);
        // Noise that alternates by 0.1 in the logarithm: a frame is 0.2 off its neighbours' line.
        let jagged: Vec<_> = (0..9)
            .map(|i| frame(1_000 * i, [if i % 2 == 0 { 100.0 } else { 100.0 * 0.2_f32.exp() }; 4]))
            .collect();
        let jagged = FramesDrive::new(&jagged, 0.0, 0.0).unwrap();
        assert!((jagged.error([1.0, 1.0]) - 0.94 * 0.2).abs() < 1e-3);
        assert!(jagged.error([0.2, 1.0]).is_nan(), "outside the outermost middles");
    }
}
