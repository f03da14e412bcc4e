//! A pixel with noise: the exact first passage of what its comparator sees.
//!
//! Between two instants the voltage drifts evenly. White noise makes it a Brownian motion, of
//! which end, crossing and time of crossing are drawn from their exact law, as in the voltmeter.
//! Band-limited noise is an Ornstein–Uhlenbeck process: its ends of a step are exact as well, and
//! the steps are so short against its correlation time that in between it is a Brownian bridge
//! with the process's own variance at the middle of the step. While no barrier can be reached,
//! nothing is drawn.

use super::comparator_input::ComparatorInput;
use super::quiet::known_after;
use crate::pixel_model::PixelModel;
use crate::random::CounterRng;
use crate::voltmeter::{bridge_crosses, crossing_share};
use std::f64::consts::TAU;

/// A barrier farther than this many standard deviations of a step counts as out of reach; what is
/// neglected is below 2 exp(-32) a step.
const REACH: f64 = 8.0;

/// Band-limited noise farther than this from zero does not occur (1e-11 an independent value).
const BAND_REACH: f64 = 7.0;

/// The longest step, as a share of the band-limited noise's correlation time.
const MAX_SUBSTEP_IN_TAU: f64 = 0.4;

/// The shortest share of a grid step that is still cut in two.
const MIN_SUBSTEP: f64 = 1e-6;

/// The voltage stays this far inside the barriers, also after rounding.
const MAX_WITHIN_BARRIER: f64 = 1.0 - 1e-12;

/// Calls `fire` with the time of each event (steps of the grid, from its start) and its side, until
/// it returns false.
pub(super) fn simulate(
    input: &ComparatorInput,
    pixel: &PixelModel,
    step_us: f64,
    draws: &mut CounterRng,
    fire: &mut dyn FnMut(f64, bool) -> bool,
) {
    let Some(start) = input.volts.iter().position(|v| v.is_finite()) else { return };
    let mut noisy = NoisyPixel::new(input, pixel, step_us, draws);
    noisy.scatter(start, true);
    let mut i = start + 1;
    while i < input.volts.len() {
        let rise = input.volts[i] - input.volts[i - 1];
        if !rise.is_finite() {
            let Some(known) = known_after(&input.volts, i as f64) else { return };
            noisy.start_anew();
            i = known + 1;
            continue;
        }
        if !noisy.redraws(i, fire) {
            return;
        }
        if !noisy.skips(i, rise) && !noisy.through(i, rise, fire) {
            return;
        }
        i += 1;
    }
}

struct NoisyPixel<'a> {
    input: &'a ComparatorInput,
    pixel: &'a PixelModel,
    draws: &'a mut CounterRng,
    step_us: f64,
    /// Correlation time of the band-limited noise, steps of the grid.
    tau: f64,
    /// Voltage since the last reset, as last drawn.
    volts: f64,
    /// Band-limited noise over its standard deviation, as last drawn; and that deviation.
    band: f64,
    rms: f64,
    /// Drift, variance and time since the last draw.
    mean: f64,
    variance: f64,
    elapsed: f64,
    /// Until when the pixel is held at reset, steps of the grid.
    held_until: f64,
    /// The thresholds as they are now, ON and OFF.
    thresholds: [f64; 2],
    /// Chance that they are drawn anew in a step.
    redrawn: f64,
}

impl<'a> NoisyPixel<'a> {
    fn new(
        input: &'a ComparatorInput,
        pixel: &'a PixelModel,
        step_us: f64,
        draws: &'a mut CounterRng,
    ) -> Self {
        let bandwidth_hz = pixel.band.map_or(f64::INFINITY, |band| band.bandwidth_hz);
        let band = draws.normal();
        let scatter = pixel.scatter.filter(|scatter| scatter.scale > 0.0);
        let redrawn_hz = scatter.map_or(0.0, |scatter| scatter.redrawn_hz);
        Self {
            input,
            pixel,
            draws,
            step_us,
            tau: 1e6 / (TAU * bandwidth_hz * step_us),
            volts: 0.0,
            band,
            rms: 0.0,
            mean: 0.0,
            variance: 0.0,
            elapsed: 0.0,
            held_until: 0.0,
            thresholds: [pixel.threshold_on, pixel.threshold_off],
            redrawn: -(-redrawn_hz * step_us * 1e-6).exp_m1(),
        }
    }

    fn start_anew(&mut self) {
        (self.volts, self.mean, self.variance, self.elapsed) = (0.0, 0.0, 0.0, 0.0);
        self.held_until = 0.0;
        self.band = self.draws.normal();
    }

    fn has_band(&self) -> bool {
        !self.input.band_rms.is_empty()
    }

    fn variance_of(&self, i: usize) -> f64 {
        self.input.variance.get(i).copied().unwrap_or(0.0)
    }

    /// Whether no barrier can be reached in the step before instant `i`; the step is then taken
    /// without drawing.
    fn skips(&mut self, i: usize, rise: f64) -> bool {
        if self.held_until > (i - 1) as f64 {
            return false;
        }
        let variance = self.variance + self.variance_of(i);
        let mean = self.mean + rise;
        let (low, high) = (self.mean.min(mean), self.mean.max(mean));
        let mut reach = [REACH * variance.sqrt(); 2];
        if self.has_band() {
            let most = BAND_REACH * self.rms.max(self.input.band_rms[i]);
            let now = self.band * self.rms;
            reach = [reach[0] + (most - now).max(0.0), reach[1] + (most + now).max(0.0)];
        }
        let [on, off] = self.thresholds;
        let inside = self.volts + high + reach[0] < on && self.volts + low - reach[1] > -off;
        if inside {
            (self.mean, self.variance) = (mean, variance);
            self.elapsed += 1.0;
        }
        inside
    }

    /// Makes the deferred draws, so that voltage and noise hold at the start of the step.
    fn catch_up(&mut self, i: usize) {
        if self.elapsed > 0.0 {
            self.volts += self.mean + self.variance.sqrt() * self.draws.normal();
            let before = self.band * self.rms;
            self.decay(self.elapsed);
            self.volts += self.band * self.rms - before;
            (self.mean, self.variance, self.elapsed) = (0.0, 0.0, 0.0);
        }
        if self.has_band() {
            let rms = self.input.band_rms[i];
            // With the first value the noise is already there: it is no change.
            if self.rms > 0.0 {
                self.volts += self.band * (rms - self.rms);
            }
            self.rms = rms;
        }
        self.keep_inside();
    }

    fn keep_inside(&mut self) {
        let [on, off] = self.thresholds;
        self.volts = self.volts.clamp(-off * MAX_WITHIN_BARRIER, on * MAX_WITHIN_BARRIER);
    }

    /// Moves the band-limited noise by a time.
    fn decay(&mut self, steps: f64) {
        if self.has_band() {
            let kept = (-steps / self.tau).exp();
            self.band = kept * self.band + (1.0 - kept * kept).sqrt() * self.draws.normal();
        }
    }

    /// The pixel fires at a time in the step before instant `i`; whether to go on.
    fn fires(
        &mut self,
        i: usize,
        at: f64,
        on: bool,
        fire: &mut dyn FnMut(f64, bool) -> bool,
    ) -> bool {
        let latency = self.pixel.latency_us / self.step_us;
        self.volts = 0.0;
        let hold = self.pixel.refractory_us / self.step_us + latency;
        if hold > 0.0 {
            self.held_until = at + hold;
        }
        self.scatter(i, true);
        fire(at + latency, on)
    }

    /// Draws thresholds anew; behind an event such as have not been passed already.
    fn scatter(&mut self, i: usize, is_fresh: bool) {
        let Some(&scale) = self.input.scatter.get(i) else { return };
        let nominal = [self.pixel.threshold_on, self.pixel.threshold_off];
        self.thresholds = nominal.map(|theta| {
            let passed = if is_fresh { 1.0 / (1.0 + (theta / scale).exp()) } else { 0.0 };
            let share = passed + (1.0 - passed) * self.draws.uniform();
            theta + scale * (share / (1.0 - share)).ln()
        });
    }

    /// Perhaps draws thresholds anew at the start of the step before instant `i`, at which the
    /// pixel fires if the voltage is beyond them; whether to go on.
    fn redraws(&mut self, i: usize, fire: &mut dyn FnMut(f64, bool) -> bool) -> bool {
        let start = (i - 1) as f64;
        let waits = self.held_until > start;
        if self.redrawn <= 0.0 || waits || self.draws.uniform() >= self.redrawn {
            return true;
        }
        self.catch_up(i);
        self.scatter(i, false);
        let [on, off] = self.thresholds;
        let is_on = self.volts >= on;
        if is_on || self.volts <= -off { self.fires(i, start, is_on, fire) } else { true }
    }

    /// Goes through the step before instant `i` with all its events; whether to go on.
    fn through(&mut self, i: usize, rise: f64, fire: &mut dyn FnMut(f64, bool) -> bool) -> bool {
        self.catch_up(i);
        let start = (i - 1) as f64;
        let variance = self.variance_of(i);
        let mut at = 0.0;
        while at < 1.0 {
            if self.held_until > start + at {
                let until = (self.held_until - start).min(1.0);
                self.decay(until - at);
                self.volts = 0.0;
                at = until;
                continue;
            }
            let piece = self.piece(rise, variance, 1.0 - at);
            match self.take(&piece) {
                Some((share, on)) => {
                    at += share * piece.span;
                    if !self.fires(i, start + at, on, fire) {
                        return false;
                    }
                }
                None => at += piece.span,
            }
        }
        true
    }

    /// The longest piece of the rest of a step in which at most one barrier can be reached.
    fn piece(&self, rise: f64, variance: f64, rest: f64) -> SubStep {
        let mut span = if self.has_band() { rest.min(MAX_SUBSTEP_IN_TAU * self.tau) } else { rest };
        loop {
            let (mut pull, mut kept, mut band_variance) = (0.0, 1.0, 0.0);
            if self.has_band() {
                kept = (-span / self.tau).exp();
                pull = self.band * self.rms * (kept - 1.0);
                band_variance = 4.0 * self.rms * self.rms * (0.5 * span / self.tau).tanh();
            }
            let mean = rise * span;
            let white = variance * span;
            let sd = (white + band_variance).sqrt();
            let (above, below) = (self.thresholds[0] - self.volts, self.thresholds[1] + self.volts);
            let up = above <= REACH * sd + (mean + pull).max(0.0);
            let down = below <= REACH * sd + (-mean - pull).max(0.0);
            let near = match (up, down) {
                (true, true) if span > MIN_SUBSTEP => {
                    span *= 0.5;
                    continue;
                }
                (true, _) => Some((above, true)),
                (false, true) => Some((below, false)),
                (false, false) => None,
            };
            return SubStep { span, mean, white, kept, band_variance, sd, near };
        }
    }

    /// Takes a piece; gives the share of it at which the pixel fires, and the side.
    fn take(&mut self, piece: &SubStep) -> Option<(f64, bool)> {
        let mut by = piece.mean;
        if piece.white > 0.0 {
            by += piece.white.sqrt() * self.draws.normal();
        }
        let mut band = self.band;
        if piece.band_variance > 0.0 {
            let spread = (1.0 - piece.kept * piece.kept).sqrt();
            band = piece.kept * band + spread * self.draws.normal();
            by += (band - self.band) * self.rms;
        }
        if let Some((distance, on)) = piece.near {
            let towards = if on { by } else { -by };
            if towards >= distance || bridge_crosses(distance, towards, piece.sd, self.draws) {
                let share = crossing_share(distance, towards, piece.sd, self.draws);
                self.stop_at(piece, share, if on { distance } else { -distance });
                return Some((share, on));
            }
        }
        self.band = band;
        self.volts += by;
        self.keep_inside();
        None
    }

    /// What the band-limited noise is where the voltage has moved by `by` at a share of the piece:
    /// its part of what drift does not explain.
    fn stop_at(&mut self, piece: &SubStep, share: f64, by: f64) {
        if piece.band_variance > 0.0 {
            let part = piece.band_variance / (piece.sd * piece.sd);
            self.band += part * (by - share * piece.mean) / self.rms;
        }
    }
}

/// A stretch of a step in which at most one barrier can be reached.
struct SubStep {
    /// Its length, steps of the grid.
    span: f64,
    /// Drift of signal and leak.
    mean: f64,
    /// Variance of the white noise.
    white: f64,
    /// What is left of the band-limited noise at the end.
    kept: f64,
    /// Variance of the bridge that represents the band-limited noise.
    band_variance: f64,
    /// Standard deviation of both.
    sd: f64,
    /// Distance to the barrier within reach, and its side.
    near: Option<(f64, bool)>,
}
