//! Any frame-based generator on a drive, in steps finer than the frames the drive was made from.
//!
//! The log-intensity signal of every pixel is sampled at even instants and passed to the generator
//! as frames, so a model's law between two frames holds between two instants. A pixel is silent
//! where its signal is unknown, and restarts where it is known again.

use crate::generator::{GenerateError, Generator};
use crate::grid::pixel_centre;
use crate::parameter_error::{ParameterError, check};
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::event::{Event, Events};
use evrig_core::frame::Luminance;
use rayon::prelude::*;

/// Default sampling step of a drive, µs: an eighth of a 120 Hz frame.
pub const DRIVE_STEP_US: u32 = 1_000;

/// Instants sampled at once.
const INSTANTS_PER_BLOCK: usize = 32;

/// Pixels of a tile: their values at one instant fill a cache line.
const PIXELS_PER_TILE: usize = 16;

/// A drive as frames at even instants.
pub struct DriveFrames<'a> {
    drive: &'a dyn Drive,
    grid: TimeGrid,
    next: usize,
    /// Intensity at the instants of the current block, by tile, instant and pixel, DN.
    block: Vec<f32>,
    frame: Luminance,
}

impl<'a> DriveFrames<'a> {
    /// The part of `window_us` in which the drive has a signal, an instant every `step_us`, 10 to
    /// 100,000.
    ///
    /// # Errors
    /// A step out of range, or a drive whose white is not a brightness.
    pub fn new(
        drive: &'a dyn Drive,
        window_us: [i64; 2],
        step_us: u32,
    ) -> Result<Self, ParameterError> {
        check("step_us", f64::from(step_us), 10.0, 1e5)?;
        check("white_dn", drive.white_dn(), 1e-3, 1e9)?;
        let [first, last] = drive.span_us();
        let (first, last) = (first.max(window_us[0]), last.min(window_us[1]));
        let span = last.saturating_sub(first);
        let n = if span < 0 { 0 } else { (span / i64::from(step_us)) as usize + 1 };
        let size = drive.size();
        let values = vec![f32::NAN; size.n_pixels()];
        let grid = TimeGrid { start_us: first, step_us, n };
        let frame = Luminance { t_us: first, size, values };
        Ok(Self { drive, grid, next: 0, block: Vec::new(), frame })
    }

    /// The instants.
    #[must_use]
    pub const fn grid(&self) -> TimeGrid {
        self.grid
    }

    /// Intensity of the pixels at the next instant, DN above black, `NaN` where it is unknown; none
    /// after the last.
    pub fn next_frame(&mut self) -> Option<&Luminance> {
        if self.next >= self.grid.n {
            return None;
        }
        let at = self.next % INSTANTS_PER_BLOCK;
        if at == 0 {
            self.sample();
        }
        let n = INSTANTS_PER_BLOCK.min(self.grid.n - (self.next - at));
        let tiles = self.block.chunks_exact(n * PIXELS_PER_TILE);
        for (values, tile) in self.frame.values.chunks_mut(PIXELS_PER_TILE).zip(tiles) {
            values.copy_from_slice(&tile[at * PIXELS_PER_TILE..][..values.len()]);
        }
        self.frame.t_us = self.grid.at(self.next);
        self.next += 1;
        Some(&self.frame)
    }

    fn sample(&mut self) {
        let n = INSTANTS_PER_BLOCK.min(self.grid.n - self.next);
        let grid = TimeGrid { start_us: self.grid.at(self.next), n, ..self.grid };
        let (drive, size) = (self.drive, self.frame.size);
        let white_dn = drive.white_dn() as f32;
        let n_pixels = size.n_pixels();
        let n_tiles = n_pixels.div_ceil(PIXELS_PER_TILE);
        self.block.resize(n_tiles * PIXELS_PER_TILE * n, f32::NAN);
        let tiles = self.block.par_chunks_exact_mut(PIXELS_PER_TILE * n).enumerate();
        tiles.for_each(|(tile, block)| {
            let mut light = [f32::NAN; INSTANTS_PER_BLOCK];
            let first = tile * PIXELS_PER_TILE;
            for pixel in first..n_pixels.min(first + PIXELS_PER_TILE) {
                drive.sample(pixel_centre(size, pixel), grid, &mut light[..n]);
                for (values, light) in block.chunks_exact_mut(PIXELS_PER_TILE).zip(light) {
                    values[pixel - first] = white_dn * light.exp();
                }
            }
        });
    }
}

/// A generation from a drive, instant by instant.
pub struct DriveRun<'a> {
    frames: DriveFrames<'a>,
    /// The frame the generator got last, and the pixels at which the signal is known.
    seen: Luminance,
    is_known: Vec<bool>,
    was_known: Vec<bool>,
    returned: Vec<u32>,
    made: Events,
}

impl<'a> DriveRun<'a> {
    /// Runs through a drive's frames.
    #[must_use]
    pub fn new(frames: DriveFrames<'a>) -> Self {
        let size = frames.frame.size;
        // A pixel of unknown signal is white until its signal is known.
        let values = vec![frames.drive.white_dn() as f32; size.n_pixels()];
        let unknown = vec![false; size.n_pixels()];
        Self {
            seen: Luminance { t_us: frames.grid.start_us, size, values },
            frames,
            is_known: unknown.clone(),
            was_known: unknown,
            returned: Vec::new(),
            made: Events::new(),
        }
    }

    /// Passes the next instant to the generator and appends the events since the one before;
    /// `false` when there is none left.
    ///
    /// # Errors
    /// Errors of the generator.
    pub fn step(
        &mut self,
        generator: &mut dyn Generator,
        out: &mut Events,
    ) -> Result<bool, GenerateError> {
        let Some(frame) = self.frames.next_frame() else { return Ok(false) };
        std::mem::swap(&mut self.was_known, &mut self.is_known);
        self.returned.clear();
        for (pixel, &value) in frame.values.iter().enumerate() {
            self.is_known[pixel] = value.is_finite();
            if value.is_finite() {
                self.seen.values[pixel] = value;
                if !self.was_known[pixel] {
                    self.returned.push(pixel as u32);
                }
            }
        }
        self.seen.t_us = frame.t_us;
        self.made.clear();
        generator.push(&self.seen, &mut self.made)?;
        generator.restart(&self.returned);
        let size = self.seen.size;
        let is_seen = |event: &Event| {
            let pixel = size.index(event.x, event.y);
            self.was_known[pixel] && self.is_known[pixel]
        };
        self.made.as_slice().iter().filter(is_seen).for_each(|event| out.push(event));
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voltmeter::Coefficients;
    use crate::{EsimParameters, GenerateParameters, ModelParameters, build};
    use evrig_core::geometry::Size;
    use evrig_core::stats::Moments;

    const SIZE: Size = Size { width: 40, height: 20 };
    const SPAN_US: i64 = 2_000_000;

    /// Log light of a pixel as a function of seconds; unknown where it is not finite.
    struct Known<F>(F);

    impl<F: Fn([f64; 2], f64) -> f64 + Send + Sync> Drive for Known<F> {
        fn size(&self) -> Size {
            SIZE
        }
        fn span_us(&self) -> [i64; 2] {
            [0, SPAN_US]
        }
        fn white_dn(&self) -> f64 {
            200.0
        }
        fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
            for (i, out) in out.iter_mut().enumerate() {
                *out = (self.0)(place, grid.at(i) as f64 * 1e-6) as f32;
            }
            out.iter().any(|value| value.is_finite())
        }
        fn error(&self, _: [f64; 2]) -> f32 {
            0.0
        }
    }

    fn run(drive: &dyn Drive, parameters: &GenerateParameters, step_us: u32) -> Events {
        let mut generator = build(parameters, None).unwrap();
        let frames = DriveFrames::new(drive, [i64::MIN, i64::MAX], step_us).unwrap();
        let mut run = DriveRun::new(frames);
        let mut events = Events::new();
        while run.step(generator.as_mut(), &mut events).unwrap() {}
        assert_eq!(events.as_slice().first_disorder(), None);
        events
    }

    fn esim() -> GenerateParameters {
        let parameters = EsimParameters {
            threshold_on: 0.1,
            threshold_off: 0.1,
            log_offset: 1e-9,
            full_scale_dn: 200.0,
            ..EsimParameters::PUBLISHED
        };
        let model = ModelParameters::Esim(parameters);
        GenerateParameters { model, ..GenerateParameters::from_k(Coefficients::DVS346, 1) }
    }

    fn times(events: &Events, x: u16, y: u16) -> Vec<i64> {
        let mine = events.as_slice().iter().filter(|e| (e.x, e.y) == (x, y));
        mine.map(|event| event.t).collect()
    }

    #[test]
    fn esim_fires_when_a_known_swing_crosses_its_levels_not_when_frames_come() {
        // Of a half wave the levels 0.1 to 0.5 are crossed on the way out, 0.4 to 0 on the way
        // back.
        let drive = Known(|_, t: f64| 0.55 * (std::f64::consts::TAU * t).sin() - 1.0);
        let events = run(&drive, &esim(), 1_000);
        let found = times(&events, 7, 3);
        let mut expected = Vec::new();
        for half in 0..4 {
            let start = 0.5 * f64::from(half);
            let after = |n: u8| (0.1 * f64::from(n) / 0.55).asin() / std::f64::consts::TAU;
            expected.extend((1..=5).map(|n| start + after(n)));
            expected.extend((0..=4).rev().map(|n| start + 0.5 - after(n)));
        }
        // The last level is met at the very end.
        assert!(found.len() + 1 >= expected.len(), "{} {}", found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            let apart_us = *found as f64 - expected * 1e6;
            assert!(apart_us.abs() < 5.0, "{found} {expected}");
        }
    }

    #[test]
    fn the_voltmeters_intervals_on_a_known_slope_have_the_laws_mean_and_spread() {
        // A light signal that rises evenly for two seconds; k1 ln L crosses a threshold every 50
        // ms.
        let slope = 2.0;
        let k = Coefficients::new([10.0, 1e-9, 0.0, 0.0, 0.0, 3e-4]).unwrap();
        let drive = Known(move |_, t: f64| slope * t - 5.0);
        let events = run(&drive, &GenerateParameters::from_k(k, 3), 1_000);
        let mut intervals = Moments::default();
        for (x, y) in (0..SIZE.width).flat_map(|x| (0..SIZE.height).map(move |y| (x, y))) {
            let times = times(&events, x, y);
            times.windows(2).for_each(|pair| intervals.push((pair[1] - pair[0]) as f64 * 1e-6));
        }
        // Drift 20/s: b is large, so the law is the inverse Gaussian of one barrier.
        let (drift, sigma) = (10.0 * slope, 3e-4 * 1e3);
        let (mean, sd) = (1.0 / drift, sigma / drift.powf(1.5));
        let error = sd / (intervals.count() as f64).sqrt();
        // Long intervals are cut off by the window's end: less than one in forty a pixel.
        assert!((intervals.mean() - mean).abs() < 4.0 * error + 0.002 * mean, "{intervals:?}");
        assert!((intervals.standard_deviation() / sd - 1.0).abs() < 0.03, "{intervals:?} {sd}");
    }

    #[test]
    fn every_model_is_silent_where_nothing_is_known_and_begins_anew_behind() {
        // Steps of light in the dark stretch would make a burst at its end.
        let drive = Known(|place: [f64; 2], t: f64| {
            let is_hidden = (0.5..1.0).contains(&t) || place[0] < 10.0;
            if is_hidden { f64::NAN } else { -2.0 + 0.5 * t + if t > 0.7 { 1.4 } else { 0.0 } }
        });
        let voltmeter = Coefficients::new([10.0, 1e-9, 0.0, 0.0, 0.0, 1e-6]).unwrap();
        let v2e = crate::V2eParameters { full_scale_dn: 200.0, ..crate::V2eParameters::CLEAN };
        let v2e = crate::V2eParameters {
            threshold_on: 0.1,
            threshold_off: 0.1,
            threshold_sd: 0.0,
            linear_below: 2.0,
            ..v2e
        };
        let base = GenerateParameters::from_k(voltmeter, 1);
        for parameters in
            [base.clone(), esim(), GenerateParameters { model: ModelParameters::V2e(v2e), ..base }]
        {
            let events = run(&drive, &parameters, 1_000);
            let hidden = |event: &evrig_core::event::Event| {
                event.x < 10 || (500_000..1_000_000).contains(&event.t)
            };
            assert!(!events.as_slice().iter().any(|event| hidden(&event)), "{parameters:?}");
            // 0.25 in the logarithm before, 0.5 behind: 2 and 5 (or, on the edge, 4) thresholds.
            let found = times(&events, 20, 10);
            let before = found.iter().filter(|t| **t < 500_000).count();
            assert!(before == 2 && (6..=7).contains(&found.len()), "{parameters:?} {found:?}");
        }
    }

    #[test]
    fn what_cannot_be_stepped_through_is_refused_by_name() {
        let drive = Known(|_, _| 0.0);
        let error = DriveFrames::new(&drive, [0, 10], 5).err().unwrap().to_string();
        assert!(error.contains("step_us"), "{error}");
        let mut late = DriveFrames::new(&drive, [SPAN_US + 1, SPAN_US + 9], 1_000).unwrap();
        assert!(late.next_frame().is_none());
    }
}
