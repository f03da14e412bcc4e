//! Spectral lines of the event rate: light that flickers, parts that vibrate.
//!
//! The rate of each polarity, of the sum and of the difference is counted on the whole sensor and
//! on tiles. Averaged over stretches, the power of noise at a frequency is gamma-distributed about
//! the power of its surroundings, which may slope. A line is what noise does not explain over all
//! frequencies and series, in the whole and in either half of the time and of the pixels.

use super::SectionResult;
use super::chance::LEVEL;
use super::rate_spectrum::{LINE_BINS, RateSpectrum};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::{Estimate, upper_median};
use serde::Serialize;

/// Samples of a stretch and their distance: up to 1 kHz, and with stretches of 4 s as fine as mains
/// and lamps are stable (0.2 Hz).
const MAX_SAMPLE_US: f64 = 500.0;
const STRETCH_SAMPLES: usize = 1 << 13;

/// Shortest stretch in samples: 0.25 s.
const MIN_STRETCH_SAMPLES: usize = 1 << 9;

/// Below lies the motion of the scene.
const MIN_FREQUENCY_HZ: f64 = 4.0;

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

/// Series that are searched.
const SERIES: [RateSeries; 4] =
    [RateSeries::On, RateSeries::Off, RateSeries::Sum, RateSeries::Difference];

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
    /// Amplitude of the rate's sine, as a share of the series' mean rate there; of the difference,
    /// as a share of all events' rate.
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
    /// Their sums.
    totals: Vec<[f64; 2]>,
    sample_us: f64,
    n_samples: usize,
    n_stretches: usize,
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
    let resolution_hz = counts.resolution_hz();
    let is_comb = |hz: f64| {
        frame_period_us.is_some_and(|us| {
            let order = hz * us * 1e-6;
            let off_hz = (order - order.round()).abs() / (us * 1e-6);
            order > 0.5 && off_hz < 1.5 * resolution_hz + COMB_TOLERANCE * hz
        })
    };
    let bins = (MIN_FREQUENCY_HZ / resolution_hz).ceil() as usize..counts.n_samples / 2;
    let n_trials = (bins.len() * SERIES.len() * (N_PARTS - 2)) as f64;
    let whole = counts.spectrum(0, RateSeries::Sum, None);
    let needed = whole.ratio_at(LEVEL / n_trials);
    let mut found: Vec<(f64, RateLine)> = Vec::new();
    for part in (0..CHECKERBOARD).filter(|part| counts.n_events(*part) >= MIN_EVENTS) {
        for of in SERIES {
            let spectrum = counts.spectrum(part, of, None);
            for bin in bins.clone() {
                let is_line = spectrum.ratio(bin) >= needed && spectrum.is_peak(bin);
                if is_line && !is_comb(bin as f64 * resolution_hz) {
                    let chance = n_trials * spectrum.chance(bin);
                    let line = counts.line(&spectrum, bin, part, of, chance);
                    found.push((spectrum.ratio(bin), line));
                }
            }
        }
    }
    let noise = upper_median(&mut whole.noise[bins.start..].to_vec()).unwrap_or(f64::NAN);
    SectionResult::Known(RateLines {
        lines: distinct_lines(&counts, found),
        resolution_hz,
        max_hz: 0.5e6 / counts.sample_us,
        n_trials,
        detectable_amplitude: counts.amplitude(needed * noise, 0, RateSeries::Sum),
        spectrum: bins.map(|bin| [bin as f64 * resolution_hz, whole.ratio(bin)]).collect(),
    })
}

/// One line of each frequency, strongest first, if either half of the events has it. Probabilities
/// of strong lines are zero in a double; their ratios to noise still differ.
fn distinct_lines(counts: &RateCounts, mut found: Vec<(f64, RateLine)>) -> Vec<RateLine> {
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let width_hz = (LINE_BINS + 1) as f64 * counts.resolution_hz();
    let mut lines: Vec<RateLine> = Vec::new();
    for (_, line) in found {
        let hz = line.frequency_hz.value;
        let is_new = |other: &RateLine| (other.frequency_hz.value - hz).abs() > width_hz;
        if lines.len() < MAX_LINES && lines.iter().all(is_new) && counts.holds_in_halves(&line) {
            lines.push(line);
        }
    }
    lines
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
        let sum = |samples: &Vec<f32>| samples.iter().copied().map(f64::from).sum();
        let totals = parts.iter().map(|[on, off]| [sum(on), sum(off)]).collect();
        Self { parts, totals, sample_us, n_samples, n_stretches }
    }

    fn resolution_hz(&self) -> f64 {
        1e6 / (self.sample_us * self.n_samples as f64)
    }

    fn n_events(&self, part: usize) -> f64 {
        self.totals[part].iter().sum()
    }

    fn n_series(&self, part: usize, of: RateSeries) -> f64 {
        let [on, off] = self.totals[part];
        match of {
            RateSeries::On => on,
            RateSeries::Off => off,
            RateSeries::Sum | RateSeries::Difference => on + off,
        }
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
        RateSpectrum::of(&stretches)
    }

    /// Amplitude of the sine with a power beyond noise, relative to the part's rate.
    fn amplitude(&self, power: f64, part: usize, of: RateSeries) -> f64 {
        // A sine of amplitude a per sample has the power (a n / 4)^2 under Hann's window.
        let per_sample = 4.0 * power.max(0.0).sqrt() / self.n_samples as f64;
        let total = (self.n_samples * self.n_stretches) as f64;
        per_sample / (self.n_series(part, of) / total).max(f64::MIN_POSITIVE)
    }

    fn line(
        &self,
        spectrum: &RateSpectrum,
        bin: usize,
        part: usize,
        series: RateSeries,
        chance: f64,
    ) -> RateLine {
        let step_hz = self.resolution_hz();
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
        let amplitude = self.amplitude(near[1], part, series);
        let n = self.n_series(part, series) as u64;
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
