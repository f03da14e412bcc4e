//! Likelihood fit of an onset to the hazard of an interval: `h Phi(ln(t/T)/s)` up to the lag at
//! which the hazard is highest, as it falls beyond where activity comes in bursts.

use super::interval_counts::{LagCounts, N_LAGS};
use evrig_core::stats::{Estimate, Z90};
use statrs::function::erf::erfc;

/// Bins per octave in which the highest hazard is sought, and events for a hazard to 20 %.
const PEAK_BINS_PER_OCTAVE: f64 = 3.0;
const MIN_PEAK_EVENTS: f64 = 25.0;

/// A later bin is higher beyond this many standard errors: about one bin in 700 by chance.
const HIGHER_Z: f64 = 3.0;

/// Lags beyond the highest hazard that are fitted too, in its lag: an octave holds its level.
const PAST_PEAK: f64 = 2.0;

/// Bins per octave, and per period about the onset: finer than the errors of a thousand intervals.
const BINS_PER_OCTAVE: f64 = 8.0;
const BINS_PER_PERIOD: f64 = 100.0;

/// Range of the onset's logarithmic width: from a bin to no onset at all.
const LOG_WIDTHS: [f64; 2] = [0.003, 1.5];

const N_PERIODS: usize = 40;
const N_WIDTHS: usize = 20;

/// Refinements of the grid, each to two steps about the best point.
const N_REFINEMENTS: usize = 2;

/// Difference of the log-likelihood at the ends of a 90 % interval: half the 0.9 quantile of
/// chi-square with one degree of freedom.
const LIKELIHOOD_90: f64 = 1.353;

/// Logarithmic 10 to 90 % rise of a normal law of unit width.
const RISE: f64 = 2.563;

/// Period and width in lags.
#[derive(Debug, Clone)]
pub(super) struct OnsetFit {
    pub(super) period: Estimate,
    pub(super) width: Estimate,
    log_width: f64,
    last_lag: usize,
}

impl OnsetFit {
    /// Lags at 10 and 90 % of the rise.
    pub(super) fn rise(&self) -> [f64; 2] {
        let half = 0.5 * RISE * self.log_width;
        [-half, half].map(|log| self.period.value * log.exp())
    }
}

/// A bin of lags: middle, events, time waited.
struct LagBin {
    lag: f64,
    n: f64,
    time: f64,
}

/// The likelihood at a period and a logarithmic width.
#[derive(Debug, Clone, Copy)]
struct OnsetPoint {
    period: f64,
    log_width: f64,
    likelihood: f64,
}

/// Fits an onset near a lag below which events are missing.
pub(super) fn fit(lags: &LagCounts, near: usize, first_lag: usize) -> Option<OnsetFit> {
    let last_lag = last_lag(lags, near);
    let near = near as f64;
    let mut periods = [near / 3.0, near * 3.0];
    let mut widths = LOG_WIDTHS;
    let mut points = Vec::new();
    let mut bins = lag_bins(lags, near, [first_lag, last_lag]);
    for refinement in 0..=N_REFINEMENTS {
        points = grid(&bins, periods, widths);
        let best = best(&points)?;
        if refinement < N_REFINEMENTS {
            periods = around(best.period, periods, N_PERIODS);
            widths = around(best.log_width, widths, N_WIDTHS);
            widths = [widths[0].max(LOG_WIDTHS[0]), widths[1].min(LOG_WIDTHS[1])];
            bins = lag_bins(lags, best.period, [first_lag, last_lag]);
        }
    }
    let best = best(&points)?;
    // The last grid may be narrower than the interval: the errors come from one that holds it.
    let bins = lag_bins(lags, best.period, [first_lag, last_lag]);
    let dispersion = dispersion(&bins, &best);
    let wide = grid(&bins, [best.period / 1.5, best.period * 1.5], LOG_WIDTHS);
    points.extend(wide);
    let within: Vec<&OnsetPoint> = points
        .iter()
        .filter(|point| point.likelihood >= best.likelihood - LIKELIHOOD_90 * dispersion)
        .collect();
    let n = bins.iter().map(|bin| bin.n).sum::<f64>() as u64;
    let of = |value: f64, of: &dyn Fn(&OnsetPoint) -> f64, floor: f64| {
        let ends = within
            .iter()
            .fold([value; 2], |[low, high], point| [low.min(of(point)), high.max(of(point))]);
        let error = (0.5 * (ends[1] - ends[0]) / Z90).max(floor);
        Estimate::with_interval(
            value,
            error,
            [ends[0].min(value - Z90 * floor), ends[1].max(value + Z90 * floor)],
            n,
        )
    };
    // Lags are whole steps, and the bins about the onset a hundredth of the period.
    let floor = 0.289 * (best.period / BINS_PER_PERIOD).max(1.0);
    Some(OnsetFit {
        period: of(best.period, &|point| point.period, floor),
        width: of(rise(&best), &rise, floor),
        log_width: best.log_width,
        last_lag,
    })
}

/// The period in a part of the events, with the width of the whole.
pub(super) fn period_with_width(lags: &LagCounts, whole: &OnsetFit, first_lag: usize) -> Estimate {
    let bins = lag_bins(lags, whole.period.value, [first_lag, whole.last_lag]);
    let period = whole.period.value;
    let points = grid(&bins, [period / 2.0, period * 2.0], [whole.log_width; 2]);
    let Some(start) = best(&points) else { return Estimate::unknown() };
    let points = grid(&bins, [start.period / 1.1, start.period * 1.1], [whole.log_width; 2]);
    let Some(best) = best(&points) else { return Estimate::unknown() };
    let dispersion = dispersion(&bins, &best);
    let wide = grid(&bins, [period / 2.0, period * 2.0], [whole.log_width; 2]);
    let within = points
        .iter()
        .chain(&wide)
        .filter(|point| point.likelihood >= best.likelihood - LIKELIHOOD_90 * dispersion);
    let ends = within.fold([best.period; 2], |[low, high], point| {
        [low.min(point.period), high.max(point.period)]
    });
    let floor = 0.289 * (period / BINS_PER_PERIOD).max(1.0);
    let error = (0.5 * (ends[1] - ends[0]) / Z90).max(floor);
    Estimate::normal(best.period, error, bins.iter().map(|bin| bin.n).sum::<f64>() as u64)
}

/// Time between 10 and 90 % of the rise.
fn rise(point: &OnsetPoint) -> f64 {
    let half = 0.5 * RISE * point.log_width;
    2.0 * point.period * half.sinh()
}

/// Two steps of a logarithmic grid to either side.
fn around(value: f64, [low, high]: [f64; 2], n: usize) -> [f64; 2] {
    let ratio = (high / low).powf(2.0 / (n - 1) as f64);
    [value / ratio, value * ratio]
}

fn best(points: &[OnsetPoint]) -> Option<OnsetPoint> {
    let finite = points.iter().filter(|point| point.likelihood.is_finite());
    finite.max_by(|a, b| a.likelihood.total_cmp(&b.likelihood)).copied()
}

/// Bins of lags: logarithmic, and fine about the period.
fn lag_bins(lags: &LagCounts, period: f64, [first_lag, last_lag]: [usize; 2]) -> Vec<LagBin> {
    let n_octaves = (last_lag as f64).max(2.0).log2();
    let coarse = (0..=(n_octaves * BINS_PER_OCTAVE) as i32)
        .map(|i| 2_f64.powf(f64::from(i) / BINS_PER_OCTAVE));
    let fine = (0..=(0.8 * BINS_PER_PERIOD) as i32)
        .map(|i| period * (0.6 + f64::from(i) / BINS_PER_PERIOD));
    let mut edges: Vec<usize> = coarse.chain(fine).map(|lag| lag.round() as usize).collect();
    edges.extend([first_lag, last_lag]);
    edges.sort_unstable();
    edges.dedup();
    let pairs = edges.windows(2).filter(|edge| edge[0] >= first_lag && edge[1] <= last_lag);
    pairs
        .map(|edge| {
            let (n, time) = lags.between(edge[0], edge[1]);
            LagBin { lag: (0.5 * (edge[0] + edge[1]) as f64 - 0.5).max(0.25), n, time }
        })
        .filter(|bin| bin.time > 0.0)
        .collect()
}

fn grid(bins: &[LagBin], periods: [f64; 2], widths: [f64; 2]) -> Vec<OnsetPoint> {
    let log_steps = |[low, high]: [f64; 2], n: usize| {
        let n = if high > low { n } else { 1 };
        (0..n).map(move |i| low * (high / low).powf(i as f64 / (n - 1).max(1) as f64))
    };
    let mut points = Vec::new();
    for log_width in log_steps(widths, N_WIDTHS) {
        for period in log_steps(periods, N_PERIODS) {
            let likelihood = profile(bins, period, log_width).0;
            points.push(OnsetPoint { period, log_width, likelihood });
        }
    }
    points
}

/// Log-likelihood with the best level of the hazard, and that level.
fn profile(bins: &[LagBin], period: f64, log_width: f64) -> (f64, f64) {
    let (mut n, mut time, mut likelihood) = (0.0, 0.0, 0.0);
    for bin in bins {
        let rise = bin.rise(period, log_width);
        n += bin.n;
        time += bin.time * rise;
        if bin.n > 0.0 {
            likelihood += bin.n * rise.ln();
        }
    }
    if n <= 0.0 || time <= 0.0 {
        return (f64::NEG_INFINITY, f64::NAN);
    }
    (likelihood + n * (n / time).ln() - n, n / time)
}

impl LagBin {
    /// Share of the hazard that has set in. Events below a hard onset are improbable, not
    /// impossible: duplicates, noise.
    fn rise(&self, period: f64, log_width: f64) -> f64 {
        let log_lag = (self.lag / period).ln();
        (0.5 * erfc(-log_lag / log_width / std::f64::consts::SQRT_2)).max(1e-9)
    }
}

/// The last lag of the fit: past the first bin from `near` on that no bin of the next octave
/// exceeds.
fn last_lag(lags: &LagCounts, near: usize) -> usize {
    let edge =
        |i: i32| (near as f64 * 2_f64.powf(f64::from(i) / PEAK_BINS_PER_OCTAVE)).round() as usize;
    let per_octave = PEAK_BINS_PER_OCTAVE as i32;
    // Half an octave below: the hazard may be highest right where events are missing least.
    let bins: Vec<(f64, f64, usize)> = (-per_octave / 2..)
        .map(|i| (edge(i), edge(i + 1)))
        .take_while(|(from, _)| *from < N_LAGS)
        .filter(|(from, to)| from < to)
        .map(|(from, to)| {
            let (n, time) = lags.between(from, to);
            (n, time, to)
        })
        .collect();
    let hazard = |bin: &(f64, f64, usize)| bin.0 / bin.1.max(1.0);
    let is_higher = |bin: &(f64, f64, usize), other: &(f64, f64, usize)| {
        let error = (hazard(bin).powi(2) / bin.0.max(1.0)
            + hazard(other).powi(2) / other.0.max(1.0))
        .sqrt();
        hazard(other) - hazard(bin) > HIGHER_Z * error
    };
    let is_peak = |i: usize| {
        let next = &bins[i + 1..(i + 1 + per_octave as usize).min(bins.len())];
        bins[i].0 >= MIN_PEAK_EVENTS && !next.iter().any(|other| is_higher(&bins[i], other))
    };
    let peak = (0..bins.len()).find(|i| is_peak(*i));
    let end = peak.map_or(4.0 * near as f64, |i| PAST_PEAK * bins[i].2 as f64);
    (end as usize).clamp(2, N_LAGS)
}

/// Pearson's statistic per degree of freedom, at least 1: activity that clusters makes counts vary
/// by more than Poisson's law.
fn dispersion(bins: &[LagBin], best: &OnsetPoint) -> f64 {
    let (_, level) = profile(bins, best.period, best.log_width);
    let (mut sum, mut n_bins) = (0.0, 0.0_f64);
    for bin in bins {
        let mean = bin.time * bin.rise(best.period, best.log_width) * level;
        // Below one expected event Pearson's statistic follows no chi-square law.
        if mean > 1.0 {
            sum += (bin.n - mean).powi(2) / mean;
            n_bins += 1.0;
        }
    }
    (sum / (n_bins - 3.0).max(1.0)).max(1.0)
}
