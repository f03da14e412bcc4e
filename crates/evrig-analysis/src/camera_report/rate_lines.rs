//! Spectral lines of the event rate: light that flickers, parts that vibrate.
//!
//! The rate of each polarity, of the sum and of the difference is counted on the whole sensor and
//! on tiles. Averaged over stretches, the power of noise at a frequency is gamma-distributed about
//! the power of its surroundings, which may slope. A line is what noise does not explain over all
//! frequencies and series, in the whole and in either half of the time and of the pixels.

use super::SectionResult;
use super::chance::LEVEL;
use super::fourier::transform;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::{Estimate, upper_median};
use serde::Serialize;
use statrs::function::gamma::gamma_ur;
use std::f64::consts::TAU;

/// Samples of a stretch and their distance: up to 1 kHz, and with stretches of 4 s as fine as mains
/// and lamps are stable (0.2 Hz).
const MAX_SAMPLE_US: f64 = 500.0;
const STRETCH_SAMPLES: usize = 1 << 13;

/// Shortest stretch in samples: 0.25 s.
const MIN_STRETCH_SAMPLES: usize = 1 << 9;

/// Below lies the motion of the scene.
const MIN_FREQUENCY_HZ: f64 = 4.0;

/// Frequencies to either side, beyond the line itself, whose median power is the noise's.
const SURROUNDING_BINS: usize = 40;
const LINE_BINS: usize = 3;

/// Tiles of the sensor along either side.
const N_TILES: usize = 4;

/// Fewest events of a series.
const MIN_EVENTS: f64 = 200.0;

/// Lines that are reported: a work budget.
const MAX_LINES: usize = 12;

/// Probability by chance in a half, at a frequency that is fixed by then.
const HALF_LEVEL: f64 = 1e-3;

/// Harmonics of the frame rate that are left out, to within one frequency step and this share: the
/// frames' period is known that well.
const COMB_TOLERANCE: f64 = 2e-3;

/// Which events make a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RateSeries {
    /// ON events.
    On,
    /// OFF events.
    Off,
    /// All events.
    Sum,
    /// ON minus OFF events: where brightness goes up and down, at the frequency of the light.
    Difference,
}

/// Spectral lines.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RateLines {
    /// The lines, the most significant of each frequency, strongest first.
    pub lines: Vec<RateLine>,
    /// Distance of independent frequencies, Hz.
    pub resolution_hz: f64,
    /// Highest frequency, Hz.
    pub max_hz: f64,
    /// Frequencies and series that were compared.
    pub n_trials: f64,
    /// Relative amplitude that a line of the whole sensor's rate needs at least, median over the
    /// frequencies.
    pub detectable_amplitude: f64,
    /// Power of the whole sensor's rate against that of its surroundings, by frequency, for plots.
    pub spectrum: Vec<[f64; 2]>,
}

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RateLine {
    /// Frequency, Hz.
    pub frequency_hz: Estimate,
    /// Amplitude of the rate's sine, as a share of the mean rate of all events there.
    pub amplitude: Estimate,
    /// Events in which it is most significant.
    pub series: RateSeries,
    /// Column and row of the tile in a 4 x 4 grid; none for the whole sensor.
    pub tile: Option<[usize; 2]>,
    /// Probability of such a line anywhere in the search by chance.
    pub false_alarm_probability: f64,
}

/// Parts of the events that are counted: the whole, the tiles, and two halves of the pixels.
const N_PARTS: usize = 1 + N_TILES * N_TILES + 2;
const CHECKERBOARD: usize = N_PARTS - 2;

/// Counts of ON and OFF by time.
struct RateCounts {
    parts: Vec<[Vec<f32>; 2]>,
    sample_us: f64,
    n_samples: usize,
    n_stretches: usize,
}

/// Mean power by frequency.
struct RateSpectrum {
    power: Vec<f64>,
    /// Noise's power, from the surroundings.
    noise: Vec<f64>,
    n_stretches: f64,
}

/// Finds lines that are no harmonics of the frames.
pub(super) fn lines(
    events: EventSlice<'_>,
    size: Size,
    hot: &[bool],
    frame_period_us: Option<f64>,
) -> SectionResult<RateLines> {
    let [first, last] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
    let duration_us = (last - first) as f64;
    let min_us = MIN_STRETCH_SAMPLES as f64 * MAX_SAMPLE_US;
    if duration_us < min_us || (events.len() as f64) < MIN_EVENTS {
        return SectionResult::not_measured(format!(
            "too few events or too short for flicker: {} events in {:.3} s, at least {MIN_EVENTS} \
             in {:.3} s are needed",
            events.len(),
            1e-6 * duration_us,
            1e-6 * min_us
        ));
    }
    let counts = RateCounts::new(events, size, hot);
    let resolution_hz = 1e6 / (counts.sample_us * counts.n_samples as f64);
    let is_comb = |hz: f64| {
        frame_period_us.is_some_and(|us| {
            let order = hz * us * 1e-6;
            let off_hz = (order - order.round()).abs() / (us * 1e-6);
            order > 0.5 && off_hz < 1.5 * resolution_hz + COMB_TOLERANCE * hz
        })
    };
    let series = [RateSeries::On, RateSeries::Off, RateSeries::Sum, RateSeries::Difference];
    let first_bin = (MIN_FREQUENCY_HZ / resolution_hz).ceil() as usize;
    let n_bins = counts.n_samples / 2;
    let n_trials = (n_bins.saturating_sub(first_bin) * series.len() * (N_PARTS - 2)) as f64;
    let mut found: Vec<RateLine> = Vec::new();
    let mut whole = None;
    for part in 0..CHECKERBOARD {
        for of in series {
            if counts.n_events(part) < MIN_EVENTS {
                continue;
            }
            let spectrum = counts.spectrum(part, of, None);
            for bin in first_bin..n_bins {
                let chance = n_trials * spectrum.chance(bin);
                let hz = bin as f64 * resolution_hz;
                if chance <= LEVEL && spectrum.is_peak(bin) && !is_comb(hz) {
                    found.push(counts.line(&spectrum, bin, part, of, chance));
                }
            }
            if (part, of) == (0, RateSeries::Sum) {
                whole = Some(spectrum);
            }
        }
    }
    found.sort_by(|a, b| a.false_alarm_probability.total_cmp(&b.false_alarm_probability));
    let mut lines: Vec<RateLine> = Vec::new();
    for line in found {
        let hz = line.frequency_hz.value;
        let is_new = |other: &RateLine| {
            (other.frequency_hz.value - hz).abs() > (LINE_BINS + 1) as f64 * resolution_hz
        };
        if lines.len() < MAX_LINES && lines.iter().all(is_new) && counts.holds_in_halves(&line) {
            lines.push(line);
        }
    }
    let (spectrum, detectable_amplitude) = whole.map_or((Vec::new(), f64::NAN), |spectrum| {
        let at = |bin: usize| [bin as f64 * resolution_hz, spectrum.ratio(bin)];
        let needed = spectrum.ratio_at(LEVEL / n_trials);
        let noise = upper_median(&mut spectrum.noise[first_bin..].to_vec()).unwrap_or(f64::NAN);
        ((first_bin..n_bins).map(at).collect(), counts.amplitude(needed * noise, 0))
    });
    SectionResult::Known(RateLines {
        lines,
        resolution_hz,
        max_hz: 0.5e6 / counts.sample_us,
        n_trials,
        detectable_amplitude,
        spectrum,
    })
}

impl RateCounts {
    fn new(events: EventSlice<'_>, size: Size, hot: &[bool]) -> Self {
        let [first, last] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
        let duration_us = (last - first) as f64 + 1.0;
        let needed = (duration_us / MAX_SAMPLE_US).ceil() as usize;
        let n_samples = needed.next_power_of_two().min(STRETCH_SAMPLES);
        let n_stretches = (needed / n_samples).max(1);
        let total = n_stretches * n_samples;
        let sample_us = duration_us / total as f64;
        let mut parts: Vec<[Vec<f32>; 2]> =
            (0..N_PARTS).map(|_| [vec![0.0; total], vec![0.0; total]]).collect();
        let [width, height] = [size.width, size.height].map(usize::from);
        for i in 0..events.len() {
            let (x, y) = (events.x[i], events.y[i]);
            if hot.get(size.index(x, y)).copied().unwrap_or(false) {
                continue;
            }
            let sample = ((events.t[i] - first) as f64 / sample_us) as usize;
            let tile =
                usize::from(y) * N_TILES / height * N_TILES + usize::from(x) * N_TILES / width;
            let half = CHECKERBOARD + usize::from((x ^ y) & 1);
            for part in [0, 1 + tile, half] {
                parts[part][usize::from(!events.on[i])][sample.min(total - 1)] += 1.0;
            }
        }
        Self { parts, sample_us, n_samples, n_stretches }
    }

    fn n_events(&self, part: usize) -> f64 {
        self.parts[part].iter().flatten().map(|n| f64::from(*n)).sum()
    }

    /// Mean power over the stretches, or those of one half of the time.
    fn spectrum(&self, part: usize, of: RateSeries, half: Option<usize>) -> RateSpectrum {
        let [on, off] = &self.parts[part];
        let signs = match of {
            RateSeries::On => [1.0, 0.0],
            RateSeries::Off => [0.0, 1.0],
            RateSeries::Sum => [1.0, 1.0],
            RateSeries::Difference => [1.0, -1.0],
        };
        let n = self.n_samples;
        let samples: Vec<f64> = on
            .iter()
            .zip(off)
            .map(|(on, off)| signs[0] * f64::from(*on) + signs[1] * f64::from(*off))
            .collect();
        let stretches: Vec<&[f64]> = match half {
            None => samples.chunks_exact(n).collect(),
            // A single stretch is halved, at half the resolution.
            Some(half) if self.n_stretches == 1 => vec![&samples[half * n / 2..(half + 1) * n / 2]],
            Some(half) => {
                let middle = self.n_stretches.div_ceil(2);
                let chunks = samples.chunks_exact(n);
                let range = if half == 0 { 0..middle } else { middle..self.n_stretches };
                chunks.skip(range.start).take(range.len()).collect()
            }
        };
        let mut power = vec![0.0; stretches.first().map_or(0, |stretch| stretch.len() / 2)];
        for stretch in &stretches {
            add_power(stretch, &mut power);
        }
        let n_stretches = stretches.len().max(1) as f64;
        power.iter_mut().for_each(|power| *power /= n_stretches);
        let noise = surroundings(&power, n_stretches);
        RateSpectrum { power, noise, n_stretches }
    }

    /// Amplitude of the sine with a power beyond noise, relative to the part's rate.
    fn amplitude(&self, power: f64, part: usize) -> f64 {
        // A sine of amplitude a per sample has the power (a n / 4)^2 under Hann's window.
        let per_sample = 4.0 * power.max(0.0).sqrt() / self.n_samples as f64;
        let total = (self.n_samples * self.n_stretches) as f64;
        per_sample / (self.n_events(part) / total).max(f64::MIN_POSITIVE)
    }

    fn line(
        &self,
        spectrum: &RateSpectrum,
        bin: usize,
        part: usize,
        series: RateSeries,
        chance: f64,
    ) -> RateLine {
        let step_hz = 1e6 / (self.sample_us * self.n_samples as f64);
        // Two thirds of the power of a line under Hann's window is in its bin; the centroid of
        // three bins gives the frequency, with an error by the ratio to noise.
        let near = [bin - 1, bin, bin + 1].map(|bin| {
            let power = spectrum.power.get(bin).copied().unwrap_or(0.0);
            (power - spectrum.noise.get(bin).copied().unwrap_or(0.0)).max(0.0)
        });
        let all: f64 = near.iter().sum();
        let offset = (near[2] - near[0]) / all.max(f64::MIN_POSITIVE);
        let ratio = spectrum.ratio(bin).max(1.0);
        let error = 0.5 / (ratio * spectrum.n_stretches).sqrt();
        let amplitude = self.amplitude(near[1], part);
        let n = self.n_events(part) as u64;
        RateLine {
            frequency_hz: Estimate::normal((bin as f64 + offset) * step_hz, error * step_hz, n),
            amplitude: Estimate::normal(
                amplitude,
                amplitude / (2.0 * ratio * spectrum.n_stretches).sqrt(),
                n,
            ),
            series,
            tile: part.checked_sub(1).map(|tile| [tile % N_TILES, tile / N_TILES]),
            false_alarm_probability: chance.min(1.0),
        }
    }

    /// Whether a line is in either half of the time, and, of the whole sensor, of the pixels.
    fn holds_in_halves(&self, line: &RateLine) -> bool {
        let part = line.tile.map_or(0, |[x, y]| 1 + y * N_TILES + x);
        let hz = line.frequency_hz.value;
        let holds = |spectrum: &RateSpectrum| {
            let step_hz = 0.5e6 / (self.sample_us * spectrum.power.len() as f64);
            let bin = (hz / step_hz).round() as usize;
            (bin.saturating_sub(1)..=bin + 1).any(|bin| spectrum.chance(bin) < HALF_LEVEL)
        };
        let in_time = (0..2).all(|half| holds(&self.spectrum(part, line.series, Some(half))));
        let in_pixels = line.tile.is_some()
            || (0..2).all(|half| holds(&self.spectrum(CHECKERBOARD + half, line.series, None)));
        in_time && in_pixels
    }
}

impl RateSpectrum {
    fn ratio(&self, bin: usize) -> f64 {
        match (self.power.get(bin), self.noise.get(bin)) {
            (Some(power), Some(noise)) if *noise > 0.0 => power / noise,
            _ => 0.0,
        }
    }

    /// Probability that noise has the power of a bin or more.
    fn chance(&self, bin: usize) -> f64 {
        let ratio = self.ratio(bin);
        if ratio <= 1.0 { 1.0 } else { gamma_ur(self.n_stretches, self.n_stretches * ratio) }
    }

    /// The ratio to noise that noise exceeds with a probability.
    fn ratio_at(&self, chance: f64) -> f64 {
        let (mut low, mut high) = (1.0, 1e3);
        for _ in 0..60 {
            let middle: f64 = 0.5 * (low + high);
            let is_below = gamma_ur(self.n_stretches, self.n_stretches * middle) > chance;
            (low, high) = if is_below { (middle, high) } else { (low, middle) };
        }
        high
    }

    fn is_peak(&self, bin: usize) -> bool {
        let from = bin.saturating_sub(LINE_BINS);
        let near = &self.power[from..(bin + LINE_BINS + 1).min(self.power.len())];
        near.iter().all(|power| *power <= self.power[bin])
    }
}

/// Adds the power of a stretch under Hann's window, which keeps slow changes out of high
/// frequencies.
fn add_power(stretch: &[f64], power: &mut [f64]) {
    let n = stretch.len();
    let mean = stretch.iter().sum::<f64>() / n as f64;
    let mut re: Vec<f64> = stretch
        .iter()
        .enumerate()
        .map(|(i, value)| (value - mean) * 0.5 * (1.0 - (TAU * i as f64 / n as f64).cos()))
        .collect();
    let mut im = vec![0.0; n];
    transform(&mut re, &mut im);
    for (bin, power) in power.iter_mut().enumerate() {
        *power += re[bin] * re[bin] + im[bin] * im[bin];
    }
}

/// Mean power of noise at each frequency: the median of the surroundings over the median of a
/// gamma variable with mean one (Wilson and Hilferty).
fn surroundings(power: &[f64], n_stretches: f64) -> Vec<f64> {
    let median = (1.0 - 1.0 / (9.0 * n_stretches)).powi(3);
    let median = if n_stretches < 1.5 { std::f64::consts::LN_2 } else { median };
    let mut near = Vec::with_capacity(2 * SURROUNDING_BINS);
    (0..power.len())
        .map(|bin| {
            near.clear();
            let from = bin.saturating_sub(SURROUNDING_BINS).max(1);
            let to = (bin + SURROUNDING_BINS + 1).min(power.len());
            let around = (from..to).filter(|other| other.abs_diff(bin) > LINE_BINS);
            near.extend(around.map(|other| power[other]));
            upper_median(&mut near).unwrap_or(0.0) / median
        })
        .collect()
}
