//! ESIM's pixel: log brightness, a straight line between frames, an event each time it has
//! moved by a threshold (Rebecq, Gehrig and Scaramuzza, CoRL 2018, section 3).
//!
//! Thresholds may differ from event to event: normal around their nominal value, drawn once
//! for each event of a pixel (the paper's section 4, "noise"). Within the refractory period after
//! an event the pixel is silent; its reference moves on, as in the authors' program.

use super::grid::{FramePixelModel, PixelBlock};
use super::limits::{FULL_SCALE_8_BIT_DN, MIN_THRESHOLD};
use super::merge::Crossing;
use super::parameter_error::{ParameterError, check};
use super::random::RandomSource;
use super::sequence::FrameSpan;
use serde::{Deserialize, Serialize};

/// Parameters of [`crate::GeneratorModel::Esim`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EsimParameters {
    /// Rise of log brightness for an ON event, 0.01..=10.
    pub threshold_on: f64,
    /// Fall of log brightness for an OFF event, 0.01..=10.
    pub threshold_off: f64,
    /// Standard deviation of both from event to event, 0..=1.
    pub threshold_sd: f64,
    /// Silence after an event, µs.
    pub refractory_us: f64,
    /// Added to brightness before the logarithm, as a share of full scale, so that black is finite.
    pub log_offset: f64,
    /// Brightness of white in the frames, DN: 255 for 8 bits, 1023 for 10.
    pub full_scale_dn: f64,
}

impl EsimParameters {
    /// The authors' program as published: thresholds of 0.2 and no noise.
    pub const PUBLISHED: Self = Self {
        threshold_on: 0.2,
        threshold_off: 0.2,
        threshold_sd: 0.0,
        refractory_us: 0.0,
        log_offset: 1e-3,
        full_scale_dn: FULL_SCALE_8_BIT_DN,
    };

    /// Refuses what lies outside the ranges, by name.
    ///
    /// # Errors
    /// The first parameter out of range.
    pub fn check(&self) -> Result<(), ParameterError> {
        check("threshold_on", self.threshold_on, MIN_THRESHOLD, 10.0)?;
        check("threshold_off", self.threshold_off, MIN_THRESHOLD, 10.0)?;
        check("threshold_sd", self.threshold_sd, 0.0, 1.0)?;
        check("refractory_us", self.refractory_us, 0.0, 1e9)?;
        check("log_offset", self.log_offset, 1e-12, 1.0)?;
        check("full_scale_dn", self.full_scale_dn, 1e-3, 1e9)
    }
}

/// The ESIM pixel.
#[derive(Debug)]
pub(super) struct Esim {
    parameters: EsimParameters,
    source: RandomSource,
}

/// What a pixel remembers.
#[derive(Debug, Clone, Copy)]
pub(super) struct EsimPixel {
    /// Log brightness in the frame before.
    level: f64,
    /// Log brightness at the last crossing.
    reference: f64,
    /// Number of crossings so far.
    n_crossings: u64,
    /// Rest of the silence, µs from the interval's start.
    silent_us: f64,
}

impl Esim {
    pub(super) fn new(parameters: EsimParameters, seed: u64) -> Self {
        Self { parameters, source: RandomSource::new(seed) }
    }

    fn level(&self, brightness: f32) -> f64 {
        (f64::from(brightness) / self.parameters.full_scale_dn + self.parameters.log_offset).ln()
    }

    /// Signed thresholds of crossing number `n` of a pixel, to either side.
    fn thresholds(&self, pixel: u32, n: u64) -> [f64; 2] {
        let EsimParameters { threshold_on, threshold_off, threshold_sd, .. } = self.parameters;
        if threshold_sd == 0.0 {
            return [threshold_on, -threshold_off];
        }
        let mut draws = self.source.draws(pixel, n);
        let mut about = |nominal: f64| (nominal + threshold_sd * draws.normal()).max(MIN_THRESHOLD);
        [about(threshold_on), -about(threshold_off)]
    }

    fn cross(
        &self,
        pixel: u32,
        state: &mut EsimPixel,
        end: f64,
        span_us: f64,
        mut fire: impl FnMut(f64, bool),
    ) {
        let start = state.level;
        let on = end > start;
        loop {
            let thresholds = self.thresholds(pixel, state.n_crossings);
            let next = state.reference + thresholds[usize::from(!on)];
            let is_crossed = if on { next <= end } else { next >= end };
            if !is_crossed || end == start {
                break;
            }
            let t = (span_us * (next - start) / (end - start)).clamp(0.0, span_us);
            state.reference = next;
            state.n_crossings += 1;
            if t >= state.silent_us {
                fire(t, on);
                state.silent_us = t + self.parameters.refractory_us;
            }
        }
        state.level = end;
        state.silent_us = (state.silent_us - span_us).max(0.0);
    }
}

impl FramePixelModel for Esim {
    const NAME: &'static str = "esim";

    type State = Vec<EsimPixel>;

    fn max_mean_events(&self, interval: FrameSpan) -> f64 {
        let EsimParameters { threshold_on, threshold_off, threshold_sd, .. } = self.parameters;
        let range = self.level(interval.brightest) - self.level(0.0);
        let least = threshold_on.min(threshold_off) - 2.0 * threshold_sd;
        range / least.max(MIN_THRESHOLD)
    }

    fn start(&self, _first: u32, brightness: &[f32]) -> Vec<EsimPixel> {
        let pixel = |&brightness: &f32| {
            let level = self.level(brightness);
            EsimPixel { level, reference: level, n_crossings: 0, silent_us: 0.0 }
        };
        brightness.iter().map(pixel).collect()
    }

    fn restart(&self, block: &mut PixelBlock<Vec<EsimPixel>>, i: usize) {
        let level = self.level(block.before[i]);
        // The count of crossings goes on: thresholds already drawn are not drawn again.
        block.state[i] = EsimPixel { level, reference: level, silent_us: 0.0, ..block.state[i] };
    }

    fn run(&self, block: &mut PixelBlock<Vec<EsimPixel>>, after: &[f32], interval: FrameSpan) {
        let span_us = f64::from(interval.span_us);
        for (i, (state, (&before, &after))) in
            block.state.iter_mut().zip(block.before.iter().zip(after)).enumerate()
        {
            let pixel = block.first + i as u32;
            let end = if before == after { state.level } else { self.level(after) };
            self.cross(pixel, state, end, span_us, |t, on| {
                block.hits.push(Crossing::new(pixel, t, interval.span_us, on));
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Generator;
    use crate::grid::PixelGrid;
    use evrig_core::event::Events;
    use evrig_core::frame::Luminance;
    use evrig_core::geometry::Size;
    use evrig_core::stats::Moments;

    const SPAN_US: i64 = 10_000;

    /// Pixels of one row, whose log brightness is given for each frame.
    fn run(parameters: EsimParameters, n_pixels: u16, log: &[f64]) -> Events {
        let mut generator = PixelGrid::new(Esim::new(parameters, 4), None).unwrap();
        let mut out = Events::new();
        for (i, log) in log.iter().enumerate() {
            let brightness = (log.exp() - parameters.log_offset) * parameters.full_scale_dn;
            let size = Size::new(n_pixels, 1);
            let values = vec![brightness as f32; size.n_pixels()];
            let frame = Luminance { t_us: SPAN_US * i as i64, size, values };
            generator.push(&frame, &mut out).unwrap();
        }
        out
    }

    #[test]
    fn a_ramp_fires_at_every_threshold_on_the_straight_line() {
        let parameters = EsimParameters { threshold_off: 0.1, ..EsimParameters::PUBLISHED };
        // Up by 1.1 in one frame, down by 0.55 in the next, from log brightness -2.
        let out = run(parameters, 1, &[-2.0, -0.9, -1.45]);
        let events: Vec<(i64, bool)> = out.as_slice().iter().map(|e| (e.t, e.on)).collect();
        // Line crossings of -1.8, -1.6, ..., -1.0, rounded up to the next microsecond; then
        // down from the reference -1.0 by 0.1 each.
        let up = (1..=5).map(|i| ((f64::from(i) * 0.2 / 1.1 * 1e4).ceil() as i64, true));
        let down = (1..=4)
            .map(|i| (10_000 + ((0.1 + f64::from(i) * 0.1) / 0.55 * 1e4).ceil() as i64, false));
        for (found, expected) in events.iter().zip(up.chain(down)) {
            assert!((found.0 - expected.0).abs() <= 1 && found.1 == expected.1, "{events:?}");
        }
        assert_eq!(events.len(), 9, "{events:?}");
    }

    #[test]
    fn small_steps_add_up_to_what_one_step_gives() {
        let log: Vec<f64> = (0..=100).map(|i| -3.0 + 0.021 * f64::from(i)).collect();
        let many = run(EsimParameters::PUBLISHED, 1, &log);
        assert_eq!(many.len(), 10, "2.1 log units at a threshold of 0.2");
        assert!(many.as_slice().on.iter().all(|&on| on));
    }

    #[test]
    fn no_interval_is_shorter_than_the_refractory_period_and_time_lost_is_not_made_up_for() {
        let parameters = EsimParameters { refractory_us: 3_000.0, ..EsimParameters::PUBLISHED };
        let log: Vec<f64> = (0..=20).map(|i| -6.0 + 0.3 * f64::from(i)).collect();
        let out = run(parameters, 1, &log);
        // A crossing every 6,667 us would pass; at a slope of 1 a frame they come every 2,000 us.
        let free = run(EsimParameters::PUBLISHED, 1, &log).len();
        assert_eq!(out.len(), free);
        let steep: Vec<f64> = (0..=6).map(|i| -6.0 + f64::from(i)).collect();
        let out = run(parameters, 1, &steep);
        let times = out.as_slice().t;
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= 2_999), "{times:?}");
        assert_eq!(out.len(), 15, "every second of 30 crossings");
    }

    #[test]
    fn threshold_noise_scatters_intervals_by_its_own_share() {
        let parameters = EsimParameters { threshold_sd: 0.02, ..EsimParameters::PUBLISHED };
        let log: Vec<f64> = (0..=50).map(|i| -5.0 + 0.08 * f64::from(i)).collect();
        let out = run(parameters, 2_000, &log);
        let mut last = vec![None; 2_000];
        let mut intervals = Moments::default();
        for event in out.as_slice().iter() {
            if let Some(before) = last[usize::from(event.x)].replace(event.t) {
                intervals.push((event.t - before) as f64);
            }
        }
        // A threshold of 0.2 ± 0.02 at 0.08 a frame of 10 ms: 25 ms ± 2.5 ms.
        assert!((intervals.mean() / 25_000.0 - 1.0).abs() < 0.005, "{}", intervals.mean());
        let sd = intervals.standard_deviation();
        assert!((sd / 2_500.0 - 1.0).abs() < 0.03, "{sd}");
    }

    #[test]
    fn black_and_wrong_parameters_are_taken_care_of() {
        let out = run(EsimParameters::PUBLISHED, 1, &[(1e-3_f64).ln(), 0.0]);
        assert_eq!(out.len(), 34, "6.9 log units from black to white");
        let wrong = EsimParameters { threshold_off: f64::NAN, ..EsimParameters::PUBLISHED };
        assert!(wrong.check().unwrap_err().to_string().contains("threshold_off"));
    }
}
