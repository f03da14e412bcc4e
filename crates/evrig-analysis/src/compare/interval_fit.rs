//! Densities of the per-pixel intervals of both streams on common logarithmic bins, with
//! first-passage distributions fitted to each.
//!
//! A voltage that drifts from 0 at rate mu and diffuses with sigma first reaches the threshold 1
//! after a time of the **inverse Gaussian** distribution with mean 1/|mu| and shape 1/sigma^2;
//! without drift, of the **Lévy** distribution with scale 1/sigma^2 (Raw2Event, section on
//! cross-sensor calibration). Maximum likelihood has closed forms (Tweedie 1957): mean = sample
//! mean, 1/shape = mean of 1/t - 1/mean; scale = 1 / mean of 1/t.
//!
//! Errors: tiles. The fits pool all pixels. Pixels differ in drift, so a pooled sample is a
//! mixture: the likelihoods compare the two distributions and do not test either. Intervals of 0 µs
//! have no likelihood; they are left out and counted.

use super::ProfilePair;
use super::interval_bins::{FINE_PER_COARSE, FINE_PER_DECADE, N_COARSE, edge};
use super::profile::{IntervalSums, StreamProfile};
use evrig_core::stats::{Estimate, dot};
use serde::{Deserialize, Serialize};

/// Interval densities of both streams, and their distance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IntervalCurve {
    /// Edges of the bins, µs, one more than bins; cut to the range with intervals.
    pub edges_us: Vec<f64>,
    /// Earth mover's distance of log10 interval, decades: the area between the two distribution
    /// functions; the measure interval_emd without blur.
    pub distance_decades: Estimate,
    /// Real events.
    pub real: IntervalDensity,
    /// Simulated events.
    pub simulated: IntervalDensity,
}

/// Interval density of one stream and the distributions fitted to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IntervalDensity {
    /// Number of intervals, including those of 0 µs.
    pub n: u64,
    /// Intervals of 0 µs, which the fits leave out.
    pub n_zero: u64,
    /// Probability per decade in each bin.
    pub per_decade: Vec<f64>,
    /// Its standard error; empty when unknown.
    pub standard_error: Vec<f64>,
    /// The fits; absent without intervals above 0 µs.
    pub fit: Option<IntervalFit>,
}

/// First-passage distributions fitted to the intervals of one stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IntervalFit {
    /// Mean of the inverse Gaussian, µs: 1 / |drift| in thresholds per µs.
    pub mean_us: Estimate,
    /// Its shape, µs: 1 / diffusion squared, in thresholds squared per µs.
    pub shape_us: Estimate,
    /// Scale of the Lévy distribution, µs.
    pub levy_scale_us: Estimate,
    /// Log-likelihood gain per interval of the inverse Gaussian over its limit, the Lévy
    /// distribution; not negative.
    pub inverse_gaussian_over_levy_nats: Estimate,
    /// Inverse Gaussian probability per decade, averaged over each bin.
    pub inverse_gaussian_per_decade: Vec<f64>,
    /// Lévy probability per decade, averaged over each bin.
    pub levy_per_decade: Vec<f64>,
}

pub(super) fn curve(pair: &ProfilePair<'_>) -> IntervalCurve {
    let coarse = |profile: &StreamProfile| -> Vec<f64> {
        profile
            .total_histogram()
            .chunks_exact(FINE_PER_COARSE)
            .map(|bins| bins.iter().sum())
            .collect()
    };
    let (real, simulated) = (coarse(pair.real), coarse(pair.simulated));
    let is_filled = |&bin: &usize| real[bin] + simulated[bin] > 0.0;
    let first = (0..N_COARSE).find(is_filled).unwrap_or(0);
    let end = (0..N_COARSE).rev().find(is_filled).map_or(first, |last| last + 1);
    IntervalCurve {
        edges_us: (first..=end).map(|bin| edge(bin * FINE_PER_COARSE)).collect(),
        distance_decades: distance(pair),
        real: density(pair, pair.real, first, end),
        simulated: density(pair, pair.simulated, first, end),
    }
}

/// The area between the distribution functions, with the signs of their difference held fixed for
/// the error.
fn distance(pair: &ProfilePair<'_>) -> Estimate {
    let distribution = |profile: &StreamProfile| -> Vec<f64> {
        let histogram = profile.total_histogram();
        let n = histogram.iter().sum::<f64>();
        let steps = histogram.iter().scan(0.0, |sum, count| {
            *sum += count / n;
            Some(*sum)
        });
        steps.collect()
    };
    let (real, simulated) = (distribution(pair.real), distribution(pair.simulated));
    let mut lifts = vec![0.0; real.len()];
    let mut lift = 0.0;
    for bin in (0..real.len()).rev() {
        let difference = simulated[bin] - real[bin];
        lift += if difference == 0.0 { 0.0 } else { difference.signum() / FINE_PER_DECADE as f64 };
        lifts[bin] = lift;
    }
    let score = |profile: &StreamProfile| -> Vec<f64> {
        let tiles = 0..profile.interval_sums.len();
        let score = |tile| -> f64 {
            profile.histogram(tile).iter().zip(&lifts).map(|(&n, lift)| f64::from(n) * lift).sum()
        };
        tiles.map(score).collect()
    };
    let (score_real, score_simulated) = (score(pair.real), score(pair.simulated));
    let (n_real, n_simulated) = (pair.real.intervals_by_tile(), pair.simulated.intervals_by_tile());
    let n = n_real.iter().chain(&n_simulated).sum::<f64>() as u64;
    pair.bootstrap.estimate(n_real.len(), n, |w| {
        dot(w, &score_simulated) / dot(w, &n_simulated) - dot(w, &score_real) / dot(w, &n_real)
    })
}

fn density(
    pair: &ProfilePair<'_>,
    profile: &StreamProfile,
    first: usize,
    end: usize,
) -> IntervalDensity {
    let by_tile = profile.intervals_by_tile();
    let n = by_tile.iter().sum::<f64>();
    let n_zero = profile.interval_sums.iter().map(|sums| sums.n_zero).sum::<u64>();
    let bins_per_decade = N_COARSE as f64 / 9.0;
    let (mut per_decade, mut standard_error) = (Vec::new(), Vec::new());
    for bin in first..end {
        let in_bin: Vec<f64> = (0..by_tile.len())
            .map(|tile| {
                let fine = bin * FINE_PER_COARSE..(bin + 1) * FINE_PER_COARSE;
                profile.histogram(tile)[fine].iter().map(|&n| f64::from(n)).sum()
            })
            .collect();
        if n > 0.0 {
            let share = in_bin.iter().sum::<f64>() / n;
            per_decade.push(share * bins_per_decade);
            let error = share_error(&in_bin, &by_tile, share) * bins_per_decade;
            standard_error.extend(error.is_finite().then_some(error));
        }
    }
    if standard_error.len() != per_decade.len() {
        standard_error.clear();
    }
    let fit = fit(pair, profile, first, end);
    IntervalDensity { n: n as u64, n_zero, per_decade, standard_error, fit }
}

/// Standard error of a share over tiles by linearisation (Cochran, Sampling Techniques, eq. 6.13),
/// which equals that of the bootstrap for a ratio and needs no replicates for each bin.
fn share_error(in_bin: &[f64], all: &[f64], share: f64) -> f64 {
    let n_tiles = all.len() as f64;
    if n_tiles < 2.0 {
        return f64::NAN;
    }
    let n = all.iter().sum::<f64>();
    let squares = in_bin.iter().zip(all).map(|(k, n)| (k - share * n).powi(2)).sum::<f64>();
    (squares * n_tiles / (n_tiles - 1.0)).sqrt() / n
}

fn fit(
    pair: &ProfilePair<'_>,
    profile: &StreamProfile,
    first: usize,
    end: usize,
) -> Option<IntervalFit> {
    let column = |of: fn(&IntervalSums) -> f64| -> Vec<f64> {
        profile.interval_sums.iter().map(of).collect()
    };
    let (n, sum, inverses) =
        (column(|s| s.n as f64), column(IntervalSums::sum), column(IntervalSums::sum_of_inverses));
    let n_intervals = n.iter().sum::<f64>() as u64;
    if n_intervals == 0 {
        return None;
    }
    let means = |w: &[f64]| {
        let n = dot(w, &n);
        (dot(w, &sum) / n, dot(w, &inverses) / n)
    };
    let shape = |(mean, inverse): (f64, f64)| 1.0 / (inverse - 1.0 / mean);
    let estimate =
        |of: &(dyn Fn(&[f64]) -> f64 + Sync)| pair.bootstrap.estimate(n.len(), n_intervals, of);
    let mean_us = estimate(&|w| means(w).0);
    let shape_us = estimate(&|w| shape(means(w)));
    let levy_scale_us = estimate(&|w| 1.0 / means(w).1);
    // Both log-likelihoods share -3/2 <ln t> and the constants at their maxima.
    let gain = estimate(&|w| 0.5 * (shape(means(w)) * means(w).1).ln());
    let per_decade = |distribution: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let at = |bin: usize| distribution(edge(bin * FINE_PER_COARSE));
        (first..end).map(|bin| (at(bin + 1) - at(bin)) * N_COARSE as f64 / 9.0).collect()
    };
    Some(IntervalFit {
        mean_us,
        shape_us,
        levy_scale_us,
        inverse_gaussian_over_levy_nats: gain,
        inverse_gaussian_per_decade: per_decade(&|t| {
            inverse_gaussian_distribution(t, mean_us.value, shape_us.value)
        }),
        levy_per_decade: per_decade(&|t| levy_distribution(t, levy_scale_us.value)),
    })
}

/// P(T <= t) of the inverse Gaussian; the second term in logarithms against overflow.
fn inverse_gaussian_distribution(t: f64, mean: f64, shape: f64) -> f64 {
    if !shape.is_finite() {
        // All intervals are equal: a point mass.
        return if t >= mean { 1.0 } else { 0.0 };
    }
    let root = (shape / t).sqrt();
    let far = -root * (t / mean + 1.0);
    let near = normal_distribution(root * (t / mean - 1.0));
    near + (2.0 * shape / mean + log_normal_distribution(far)).exp()
}

/// P(T <= t) of the Lévy distribution from 0.
fn levy_distribution(t: f64, scale: f64) -> f64 {
    statrs::function::erf::erfc((scale / (2.0 * t)).sqrt())
}

fn normal_distribution(z: f64) -> f64 {
    0.5 * statrs::function::erf::erfc(-z / std::f64::consts::SQRT_2)
}

/// ln of the normal distribution function; asymptotic series (Abramowitz and Stegun 26.2.12) far
/// below zero.
fn log_normal_distribution(z: f64) -> f64 {
    if z > -25.0 {
        return normal_distribution(z).ln();
    }
    let s = 1.0 / (z * z);
    let series = 1.0 - s * (1.0 - 3.0 * s * (1.0 - 5.0 * s));
    -0.5 * z * z - (-z).ln() - 0.5 * (2.0 * std::f64::consts::PI).ln() + series.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distribution_functions_are_those_of_scipy() {
        // scipy.stats.invgauss.cdf(t, mean / shape, scale=shape)
        for (t, mean, shape, expected) in [
            (50.0, 100.0, 80.0, 0.406_636_673_054_179_33),
            (300.0, 100.0, 80.0, 0.945_405_221_473_443),
            (9.9e3, 1e4, 1e8, 0.158_643_034_034_000_46),
            (1e3, 1e4, 1e6, 0.0),
        ] {
            let found = inverse_gaussian_distribution(t, mean, shape);
            assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
        }
        // scipy.stats.levy.cdf(t, scale=80)
        for (t, expected) in [(10.0, 0.004_677_734_981_047_266), (1e3, 0.777_297_410_789_521_5)] {
            assert!((levy_distribution(t, 80.0) - expected).abs() < 1e-9);
        }
        // scipy.stats.norm.logcdf(-30)
        assert!((log_normal_distribution(-30.0) + 454.321_243_956_343_27).abs() < 1e-6);
    }
}
