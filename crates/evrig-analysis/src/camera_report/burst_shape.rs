//! Delay, time per row and width of a burst: the residual times of its events about a line.

use super::frame_fold::FrameFold;
use super::shear_search::ShearedWindow;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::{Estimate, Moments, SplitMix};

/// Bands of rows whose mean delays give the line: enough for an error from their scatter.
const N_BANDS: usize = 16;

/// Residual bins per bin of the search: finer than any error of the delay.
const BINS_PER_SEARCH_BIN: f64 = 10.0;

/// Bins of the search to either side of the window, of which the outer half is background.
const MARGIN_BINS: f64 = 32.0;

/// Passes over the events. Background is centred on the line assumed, so that one pass moves by the
/// burst's share of the window; a burst that is found has most of it.
const N_PASSES: usize = 3;

/// Resampled shapes for the error of the width.
const N_RESAMPLES: usize = 100;

/// Rounding error of a time in whole microseconds, µs: the standard deviation of a uniform law.
const ROUNDING_US: f64 = 0.289;

/// A line of delay against row, and the burst's shape about it.
#[derive(Debug, Clone)]
pub(super) struct BurstShape {
    /// At row 0, µs since the frame's start.
    pub(super) delay_us: Estimate,
    pub(super) row_us: Estimate,
    /// Length of the interval with 90 % of the burst's events.
    pub(super) width_us: Estimate,
    /// Residual times that hold the burst.
    pub(super) window_us: [f64; 2],
}

/// Events about a line, by band of rows and residual time.
struct ResidualBands {
    counts: Vec<Vec<u32>>,
    row_sums: [f64; N_BANDS],
    row_counts: [f64; N_BANDS],
    bin_us: f64,
    half_us: f64,
}

/// Measures a burst of one polarity that the search found.
pub(super) fn shape(
    events: EventSlice<'_>,
    size: Size,
    fold: &FrameFold<'_>,
    on: bool,
    found: &ShearedWindow,
    search_bin_us: f64,
) -> Option<BurstShape> {
    let (mut delay_us, mut row_us) = (found.delay_us, found.row_us);
    let mut last = None;
    for _ in 0..N_PASSES {
        let line = [delay_us, row_us];
        let bands = ResidualBands::count(events, size, fold, on, line, found, search_bin_us);
        let fit = bands.line(found.width_us)?;
        delay_us += fit.shift_us;
        row_us += fit.slope_us;
        last = Some((fit, bands));
    }
    let (fit, bands) = last?;
    let total = bands.total();
    let quantiles = |counts: &[f64]| bands.quantiles(counts, found.width_us);
    let [first, low, high, end] = quantiles(&total)?;
    let mut widths = Moments::default();
    let mut random = SplitMix::new(1, total.len() as u64);
    for _ in 0..N_RESAMPLES {
        let resampled: Vec<f64> =
            total.iter().map(|n| (n + n.sqrt() * random.normal()).max(0.0)).collect();
        if let Some([_, low, high, _]) = quantiles(&resampled) {
            widths.push(high - low);
        }
    }
    let n = fit.excess.max(0.0) as u64;
    let pad = 0.1 * (high - low) + bands.bin_us;
    // The residuals are about the line before the last step, which is below its error.
    let window_us = [first - pad - fit.shift_us, end + pad - fit.shift_us];
    Some(BurstShape {
        delay_us: Estimate::normal(delay_us, fit.shift_error_us.hypot(ROUNDING_US), n),
        row_us: Estimate::normal(row_us, fit.slope_error_us, n),
        width_us: Estimate::normal(high - low, widths.standard_deviation().max(ROUNDING_US), n),
        window_us,
    })
}

/// Correction of a line with its errors, and the burst's events.
struct DelayLineFit {
    shift_us: f64,
    shift_error_us: f64,
    slope_us: f64,
    slope_error_us: f64,
    excess: f64,
}

impl ResidualBands {
    fn count(
        events: EventSlice<'_>,
        size: Size,
        fold: &FrameFold<'_>,
        on: bool,
        [delay_us, row_us]: [f64; 2],
        found: &ShearedWindow,
        search_bin_us: f64,
    ) -> Self {
        let bin_us = search_bin_us / BINS_PER_SEARCH_BIN;
        let half_us =
            (0.5 * found.width_us + MARGIN_BINS * search_bin_us).min(0.5 * fold.period_us - bin_us);
        let n_bins = (2.0 * half_us / bin_us) as usize;
        let mut bands = Self {
            counts: vec![vec![0; n_bins]; N_BANDS],
            row_sums: [0.0; N_BANDS],
            row_counts: [0.0; N_BANDS],
            bin_us,
            half_us,
        };
        let height = usize::from(size.height);
        let core_us = found.width_us;
        fold.visit(events.t, |i, _, since| {
            if events.on[i] != on {
                return;
            }
            let row = f64::from(events.y[i]);
            let residual = fold.wrap(since - delay_us - row_us * row);
            if residual.abs() < half_us {
                let band = usize::from(events.y[i]) * N_BANDS / height;
                let bin = ((residual + half_us) / bin_us) as usize;
                bands.counts[band][bin.min(n_bins - 1)] += 1;
                if residual.abs() < core_us {
                    bands.row_sums[band] += row;
                    bands.row_counts[band] += 1.0;
                }
            }
        });
        bands
    }

    fn middle_us(&self, bin: usize) -> f64 {
        (bin as f64 + 0.5) * self.bin_us - self.half_us
    }

    /// Background per bin, from the outer half of the margin.
    fn background(&self, counts: &[f64]) -> f64 {
        let outer = (0.5 * MARGIN_BINS * BINS_PER_SEARCH_BIN) as usize;
        let outer = outer.clamp(1, counts.len() / 2);
        let sides = counts[..outer].iter().chain(&counts[counts.len() - outer..]);
        sides.sum::<f64>() / (2 * outer) as f64
    }

    fn total(&self) -> Vec<f64> {
        let n_bins = self.counts[0].len();
        (0..n_bins).map(|bin| self.counts.iter().map(|c| f64::from(c[bin])).sum()).collect()
    }

    /// Mean residual against row, over the bands; residuals beyond `core_us` are background.
    fn line(&self, core_us: f64) -> Option<DelayLineFit> {
        // Row, mean residual, weight.
        let mut means: Vec<[f64; 3]> = Vec::new();
        let mut total = 0.0;
        for (band, counts) in self.counts.iter().enumerate() {
            let counts: Vec<f64> = counts.iter().copied().map(f64::from).collect();
            let background = self.background(&counts);
            let (mut excess, mut sum, mut square) = (0.0, 0.0, 0.0);
            for (bin, n) in counts.iter().enumerate() {
                let us = self.middle_us(bin);
                if us.abs() < core_us {
                    excess += n - background;
                    sum += (n - background) * us;
                    square += n * us * us;
                }
            }
            // A band without a significant burst has no mean.
            if excess > 3.0 * (square.max(0.0).sqrt() / core_us).max(1.0) {
                let mean = sum / excess;
                let error_square =
                    (square - sum * mean).max(self.bin_us.powi(2)) / (excess * excess);
                let row = self.row_sums[band] / self.row_counts[band].max(1.0);
                means.push([row, mean, 1.0 / error_square]);
                total += excess;
            }
        }
        weighted_line(&means, total)
    }

    /// Residuals below which are 1, 5, 95 and 99 % of the burst.
    fn quantiles(&self, counts: &[f64], core_us: f64) -> Option<[f64; 4]> {
        let background = self.background(counts);
        // Twice the window holds the burst; beyond, noise of the background adds up.
        let core = (0..counts.len()).filter(|bin| self.middle_us(*bin).abs() < core_us);
        let mut sums = Vec::new();
        let mut sum = 0.0;
        for bin in core {
            sum += counts[bin] - background;
            sums.push((self.middle_us(bin) + 0.5 * self.bin_us, sum));
        }
        let at = |share: f64| sums.iter().find(|(_, s)| *s >= share * sum).map(|(us, _)| *us);
        if sum <= 0.0 {
            return None;
        }
        Some([at(0.01)?, at(0.05)?, at(0.95)?, at(0.99)?])
    }
}

/// Weighted regression of mean residuals on rows; the errors grow with the scatter.
fn weighted_line(means: &[[f64; 3]], excess: f64) -> Option<DelayLineFit> {
    let sum = |of: &dyn Fn(&[f64; 3]) -> f64| means.iter().map(of).sum::<f64>();
    let weight = sum(&|m| m[2]);
    if means.is_empty() || weight <= 0.0 {
        return None;
    }
    let row = sum(&|m| m[2] * m[0]) / weight;
    let mean = sum(&|m| m[2] * m[1]) / weight;
    let square = sum(&|m| m[2] * (m[0] - row).powi(2));
    if means.len() < 3 || square <= 0.0 {
        // Too few bands for a slope: the line keeps that of the search, with unknown error.
        let error = weight.recip().sqrt();
        let unknown = f64::NAN;
        return Some(DelayLineFit {
            shift_us: mean,
            shift_error_us: error,
            slope_us: 0.0,
            slope_error_us: unknown,
            excess,
        });
    }
    let slope = sum(&|m| m[2] * (m[0] - row) * (m[1] - mean)) / square;
    let scatter = sum(&|m| m[2] * (m[1] - mean - slope * (m[0] - row)).powi(2));
    let inflation = (scatter / (means.len() - 2) as f64).max(1.0).sqrt();
    Some(DelayLineFit {
        shift_us: mean - slope * row,
        shift_error_us: inflation * (weight.recip() + row * row / square).sqrt(),
        slope_us: slope,
        slope_error_us: inflation * square.recip().sqrt(),
        excess,
    })
}
