//! The period of frames that the file does not hold, from the events alone.
//!
//! A readout that sweeps over the rows gives each band of rows bursts at the frame rate and its
//! harmonics. The power at the harmonics is added over bands; the best frequencies are refined by
//! folding the events, over longer and longer stretches of time.

use super::frame_fold::{FrameReference, FrameStarts};
use super::hann_spectrum::HannSpectrum;
use evrig_core::event::{EventSlice, Events};
use evrig_core::geometry::Size;

/// Frame rates of cameras with frames and events, Hz.
pub(super) const FRAME_RATE_HZ: [f64; 2] = [4.0, 125.0];

/// Harmonics that are added: bursts of a band last an eighth of a period or less.
const N_HARMONICS: usize = 8;

/// Bands of rows.
const N_BANDS: usize = 16;

/// Samples of the rate: 0.5 ms apart, so that the highest harmonic is below 1 kHz; at most 8 s.
const SAMPLE_US: f64 = 500.0;
const MAX_SAMPLES: usize = 1 << 14;
const MIN_SAMPLES: usize = 1 << 10;

/// Trial frequencies per independent one of the fundamental: harmonics need finer steps.
const OVERSAMPLING: f64 = 16.0;

/// Periods that are refined and searched for bursts: a work budget.
const MAX_PERIODS: usize = 2;

/// Phase bins of a folded band; a band's burst is as long as its rows take.
const N_PHASE_BINS: usize = 128;

/// Events of one refinement, and of the comparison of cycles, at most: a work budget.
const MAX_EVENTS: usize = 500_000;

/// Steps of a refinement to either side.
const N_STEPS: i32 = 12;

/// Multiples of a period that are tried: bursts that divide a frame's cycle into equal parts have
/// their power at a multiple of the frame rate.
const MAX_MULTIPLE: usize = 6;

/// Plausible frame cycles.
pub(super) fn frame_periods(events: EventSlice<'_>, size: Size) -> Vec<FrameStarts> {
    let Some(start_us) = events.t.first().copied() else { return Vec::new() };
    let frequencies = frequencies(events, size);
    let last_us = events.t.last().copied().unwrap_or(start_us);
    let periods = frequencies.into_iter().flat_map(|hz| {
        let period_us = refine(events, size, 1e6 / hz);
        let multiples = (1..=MAX_MULTIPLE).map(move |n| n as f64 * period_us);
        multiples.filter(|period_us| 1e6 / period_us >= FRAME_RATE_HZ[0])
    });
    let cycle = |period_us: f64| {
        let n = ((last_us - start_us) as f64 / period_us) as usize;
        let starts = (0..=n).map(|i| start_us + (i as f64 * period_us).round() as i64);
        FrameStarts::new(starts.collect(), FrameReference::FoundPeriod)
    };
    periods.map(cycle).collect()
}

/// Cycles that were compared: all rates of the range, as far apart as shifts the last frame by one
/// phase bin against the first.
pub(super) fn n_cycles(t: &[i64]) -> f64 {
    let duration_s =
        t.last().zip(t.first()).map_or(0.0, |(last, first)| (last - first) as f64 * 1e-6);
    ((FRAME_RATE_HZ[1] - FRAME_RATE_HZ[0]) * duration_s * N_PHASE_BINS as f64).max(1.0)
}

/// Frequencies whose harmonics have the most power over all bands.
fn frequencies(events: EventSlice<'_>, size: Size) -> Vec<f64> {
    let start_us = events.t[0];
    let duration_us = (events.t[events.len() - 1] - start_us) as f64;
    let n_samples = (duration_us / SAMPLE_US) as usize;
    if n_samples < MIN_SAMPLES {
        return Vec::new();
    }
    // The power of two below: what is cut off is used by the refinement.
    let n_samples = (1_usize << n_samples.ilog2()).min(MAX_SAMPLES);
    let mut power = vec![0.0; n_samples / 2];
    let mut spectrum = HannSpectrum::new(n_samples);
    for band in 0..N_BANDS {
        add_band(events, size, band, &mut spectrum, &mut power);
    }
    let step_hz = 1e6 / (SAMPLE_US * n_samples as f64);
    let at = |hz: f64| power.get((hz / step_hz).round() as usize).copied().unwrap_or(0.0);
    let [low, high] = FRAME_RATE_HZ;
    let n_trials = ((high - low) / step_hz * OVERSAMPLING) as usize;
    let mut trials: Vec<(f64, f64)> = (0..n_trials)
        .map(|i| {
            let hz = low + i as f64 * step_hz / OVERSAMPLING;
            ((1..=N_HARMONICS).map(|order| at(order as f64 * hz)).sum(), hz)
        })
        .collect();
    trials.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut best: Vec<f64> = Vec::new();
    for (_, hz) in trials {
        if best.iter().all(|other| (other - hz).abs() > 2.0 * step_hz) {
            best.push(hz);
        }
        if best.len() == MAX_PERIODS {
            break;
        }
    }
    best
}

/// Adds the power of a band's rate, relative to its own noise.
fn add_band(
    events: EventSlice<'_>,
    size: Size,
    band: usize,
    spectrum: &mut HannSpectrum,
    power: &mut [f64],
) {
    let start_us = events.t[0];
    let n_samples = 2 * power.len();
    let mut samples = vec![0.0; n_samples];
    let mut n_events = 0.0_f64;
    for (t, y) in events.t.iter().zip(events.y) {
        let sample = ((t - start_us) as f64 / SAMPLE_US) as usize;
        if sample >= n_samples {
            break;
        }
        if usize::from(*y) * N_BANDS / usize::from(size.height) == band {
            samples[sample] += 1.0;
            n_events += 1.0;
        }
    }
    if n_events == 0.0 {
        return;
    }
    spectrum.add_power(&samples, n_events.recip(), power);
}

/// The period at which folded bands depart most from a constant rate.
fn refine(events: EventSlice<'_>, size: Size, period_us: f64) -> f64 {
    let start_us = events.t[0];
    let duration_us = (events.t[events.len() - 1] - start_us) as f64;
    let mut length_us = (SAMPLE_US * MAX_SAMPLES as f64 / 4.0).min(duration_us);
    let mut period_us = period_us;
    loop {
        let n = events.t.partition_point(|t| ((t - start_us) as f64) < length_us);
        let part = thinned(events.range(0, n));
        // One step moves the last event of the stretch by half a phase bin.
        let step_us = 0.5 * period_us * period_us / (N_PHASE_BINS as f64 * length_us);
        let trials = (-N_STEPS..=N_STEPS).map(|i| period_us + f64::from(i) * step_us);
        let scored = trials.map(|trial| (departure(part.as_slice(), size, trial), trial));
        period_us = scored.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(period_us, |best| best.1);
        if length_us >= duration_us {
            return period_us;
        }
        length_us = (4.0 * length_us).min(duration_us);
    }
}

/// Every n-th event, so that at most [`MAX_EVENTS`] are left.
pub(super) fn thinned(events: EventSlice<'_>) -> Events {
    let every = events.len().div_ceil(MAX_EVENTS).max(1);
    events.iter().step_by(every).collect()
}

/// Squares of the counts by phase and band, over their means.
fn departure(events: EventSlice<'_>, size: Size, period_us: f64) -> f64 {
    let mut counts = vec![[0.0_f64; N_PHASE_BINS]; N_BANDS];
    for i in 0..events.len() {
        let phase = ((events.t[i] - events.t[0]) as f64 / period_us).fract();
        let band = usize::from(events.y[i]) * N_BANDS / usize::from(size.height);
        counts[band][(phase * N_PHASE_BINS as f64) as usize % N_PHASE_BINS] += 1.0;
    }
    counts
        .iter()
        .map(|band| {
            let total = band.iter().sum::<f64>().max(1.0);
            band.iter().map(|n| n * n).sum::<f64>() / total
        })
        .sum()
}
