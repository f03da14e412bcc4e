//! The v2e pixel itself.

use super::parameters::V2eParameters;
use crate::grid::{FramePixelModel, PixelBlock};
use crate::limits::{FULL_SCALE_8_BIT_DN, MIN_THRESHOLD};
use crate::merge::Crossing;
use crate::random::{CounterRng, PERMANENT, RandomSource};
use crate::sequence::FrameSpan;
use std::f64::consts::{LN_10, TAU};

/// The published program offsets brightness by this (of 255) where light sets a speed, so
/// that the dark is slow but not infinitely so.
const DARK_OFFSET: f64 = 20.0;

/// The v2e model.
#[derive(Debug)]
pub(crate) struct V2e {
    parameters: V2eParameters,
    source: RandomSource,
}

/// What a pixel is and remembers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct V2ePixel {
    threshold_on: f64,
    threshold_off: f64,
    /// The pixel's own leak relative to the nominal one.
    leak: f64,
    /// Output of the low-pass, log units.
    smooth: f64,
    /// The level memorised at the last event, log units.
    memorised: f64,
    /// Rest of the silence, µs from the interval's start.
    silent_us: f64,
}

/// An event of a pixel within an interval: after so many µs, ON or OFF, and by light or noise.
#[derive(Debug, Clone, Copy)]
struct CandidateEvent {
    after_us: f64,
    on: bool,
    by_light: bool,
}

impl V2e {
    pub(crate) fn new(parameters: V2eParameters, seed: u64) -> Self {
        Self { parameters, source: RandomSource::new(seed) }
    }

    /// Brightness on a scale to 255.
    fn of_255(&self, brightness: f32) -> f64 {
        f64::from(brightness) * (FULL_SCALE_8_BIT_DN / self.parameters.full_scale_dn)
    }

    /// Linear in the dark, logarithmic above; continuous where the two meet.
    fn lin_log(&self, of_255: f64) -> f64 {
        let edge = self.parameters.linear_below;
        if of_255 <= edge { of_255 * edge.ln() / edge } else { of_255.ln() }
    }

    /// How much light there is for speed: 0.07 in the dark, 1 at full scale.
    fn relative_light(of_255: f64) -> f64 {
        ((of_255 + DARK_OFFSET) / (FULL_SCALE_8_BIT_DN + DARK_OFFSET)).min(1.0)
    }

    fn start_pixel(&self, pixel: u32, brightness: f32) -> V2ePixel {
        let p = &self.parameters;
        let mut draws = self.source.draws(pixel, PERMANENT);
        let mut about =
            |nominal: f64| (nominal + p.threshold_sd * draws.normal()).max(MIN_THRESHOLD);
        let (threshold_on, threshold_off) = (about(p.threshold_on), about(p.threshold_off));
        let leak = (p.leak_spread_decades * LN_10 * draws.normal()).exp();
        let smooth = self.lin_log(self.of_255(brightness));
        // The initial phase of the leak is drawn, or all pixels would fire at once.
        let leaked = if p.leak_rate_hz > 0.0 { draws.uniform() * threshold_on } else { 0.0 };
        let memorised = smooth - leaked;
        V2ePixel { threshold_on, threshold_off, leak, smooth, memorised, silent_us: 0.0 }
    }

    /// Low-pass and leak over an interval.
    fn follow(&self, pixel: &mut V2ePixel, of_255: f64, span_s: f64, draws: &mut CounterRng) {
        let p = &self.parameters;
        let level = self.lin_log(of_255);
        if p.cutoff_hz > 0.0 {
            let step = (Self::relative_light(of_255) * TAU * p.cutoff_hz * span_s).min(1.0);
            pixel.smooth += step * (level - pixel.smooth);
        } else {
            pixel.smooth = level;
        }
        if p.leak_rate_hz > 0.0 {
            let jitter =
                if p.leak_jitter > 0.0 { 1.0 - p.leak_jitter * draws.normal() } else { 1.0 };
            let rate = p.leak_rate_hz * pixel.leak * jitter;
            pixel.memorised -= rate * span_s * pixel.threshold_on;
        }
    }

    /// Events by the change of light, spread evenly over the interval.
    fn by_light(pixel: &V2ePixel, span_us: f64, candidates: &mut Vec<CandidateEvent>) {
        let change = pixel.smooth - pixel.memorised;
        let on = change > 0.0;
        let threshold = if on { pixel.threshold_on } else { pixel.threshold_off };
        let n = (change.abs() / threshold).floor();
        for i in 1..=n as u32 {
            let after_us = span_us * f64::from(i) / n;
            candidates.push(CandidateEvent { after_us, on, by_light: true });
        }
    }

    /// Events by shot noise: two Poisson processes, faster in the dark and at low thresholds, drawn
    /// as one whose events fall to either side.
    fn by_noise(
        &self,
        pixel: &V2ePixel,
        of_255: f64,
        span_us: f64,
        draws: &mut CounterRng,
        candidates: &mut Vec<CandidateEvent>,
    ) {
        let p = &self.parameters;
        let dimmed = 1.0 - (1.0 - p.shot_noise_at_full_scale) * Self::relative_light(of_255);
        let per_us = 0.5e-6 * p.shot_noise_rate_hz * dimmed;
        let [on, off] =
            [p.threshold_on / pixel.threshold_on, p.threshold_off / pixel.threshold_off];
        let rate = per_us * (on + off);
        let mut after_us = 0.0;
        loop {
            let uniform = draws.uniform();
            // -ln u >= 1 - u: mostly that shows without the logarithm that the wait is too long.
            if 1.0 - uniform > rate * (span_us - after_us) {
                break;
            }
            after_us -= uniform.ln() / rate;
            if after_us > span_us {
                break;
            }
            let on = draws.uniform() * (on + off) < on;
            candidates.push(CandidateEvent { after_us, on, by_light: false });
        }
    }

    /// Lets the candidates through that do not fall into silence; resets by those of light.
    fn fire(
        &self,
        pixel: &mut V2ePixel,
        candidates: &mut [CandidateEvent],
        mut fire: impl FnMut(f64, bool),
    ) {
        candidates.sort_by(|a, b| a.after_us.total_cmp(&b.after_us));
        for candidate in candidates.iter().filter(|candidate| candidate.after_us > 0.0) {
            if candidate.after_us < pixel.silent_us {
                continue;
            }
            fire(candidate.after_us, candidate.on);
            pixel.silent_us = candidate.after_us + self.parameters.refractory_us;
            if candidate.by_light {
                pixel.memorised +=
                    if candidate.on { pixel.threshold_on } else { -pixel.threshold_off };
            }
        }
    }
}

impl FramePixelModel for V2e {
    const NAME: &'static str = "v2e";

    type State = Vec<V2ePixel>;

    fn max_mean_events(&self, interval: FrameSpan) -> f64 {
        let p = &self.parameters;
        let span_s = f64::from(interval.span_us) * 1e-6;
        let least = p.threshold_on.min(p.threshold_off) - 4.0 * p.threshold_sd;
        let range = self.lin_log(self.of_255(interval.brightest));
        let noise = p.shot_noise_rate_hz * p.shot_noise_at_full_scale.max(1.0) * span_s;
        // 4 standard deviations of the leak's spread and jitter.
        let leak = p.leak_rate_hz * (4.0 * p.leak_spread_decades * LN_10).exp() * span_s;
        range / least.max(MIN_THRESHOLD) + noise + leak * (1.0 + 4.0 * p.leak_jitter)
    }

    fn start(&self, first: u32, brightness: &[f32]) -> Vec<V2ePixel> {
        let pixels = brightness.iter().zip(first..);
        pixels.map(|(&brightness, pixel)| self.start_pixel(pixel, brightness)).collect()
    }

    fn restart(&self, block: &mut PixelBlock<Vec<V2ePixel>>, i: usize) {
        block.state[i] = self.start_pixel(block.first + i as u32, block.before[i]);
    }

    fn run(&self, block: &mut PixelBlock<Vec<V2ePixel>>, after: &[f32], interval: FrameSpan) {
        let span_us = f64::from(interval.span_us);
        let has_noise = self.parameters.shot_noise_rate_hz > 0.0;
        let mut candidates = Vec::new();
        for (i, (pixel, &after)) in block.state.iter_mut().zip(after).enumerate() {
            let number = block.first + i as u32;
            let of_255 = self.of_255(after);
            let mut draws = self.source.draws(number, interval.index);
            self.follow(pixel, of_255, span_us * 1e-6, &mut draws);
            candidates.clear();
            Self::by_light(pixel, span_us, &mut candidates);
            if has_noise {
                self.by_noise(pixel, of_255, span_us, &mut draws, &mut candidates);
            }
            self.fire(pixel, &mut candidates, |t, on| {
                block.hits.push(Crossing::new(number, t, interval.span_us, on));
            });
            pixel.silent_us = (pixel.silent_us - span_us).max(0.0);
        }
    }
}
