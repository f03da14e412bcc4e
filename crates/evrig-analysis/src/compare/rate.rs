//! Events per second over time, both streams by polarity, each with a 90 % band.
//!
//! 240 equal bins of the window. The band is that of a Poisson count, widened by the index of
//! dispersion D = sum (n1 - n2)^2 / sum (n1 + n2) of the two halves of each bin, which is 1 for
//! independent events. A trend across a bin raises D, so the band is conservative. Band: Poisson
//! limits of n/D events (Garwood, Biometrika 28, 1936), times D.

use super::ProfilePair;
use super::profile::N_HALF_BINS;
use serde::{Deserialize, Serialize};
use statrs::function::gamma::{gamma_lr, ln_gamma};

/// Rates of both streams.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RateCurve {
    /// Start of the first bin, µs.
    pub start_us: i64,
    /// Width of a bin, µs.
    pub bin_us: f64,
    /// Real ON events.
    pub real_on: RateBand,
    /// Real OFF events.
    pub real_off: RateBand,
    /// Simulated ON events.
    pub simulated_on: RateBand,
    /// Simulated OFF events.
    pub simulated_off: RateBand,
}

/// A rate in each bin, for the whole region, with its 90 % band.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RateBand {
    /// Events per second.
    pub hz: Vec<f64>,
    /// Lower end of the band.
    pub low_hz: Vec<f64>,
    /// Upper end of the band.
    pub high_hz: Vec<f64>,
    /// Index of dispersion, at least 1; 1 for independent events.
    pub dispersion: f64,
}

pub(super) fn curve(pair: &ProfilePair<'_>) -> RateCurve {
    let [start, end] = pair.layout.window;
    let bin_us = (end - start) as f64 / (N_HALF_BINS / 2) as f64;
    RateCurve {
        start_us: start,
        bin_us,
        real_on: band(&pair.real.on_over_time, bin_us),
        real_off: band(&pair.real.off_over_time, bin_us),
        simulated_on: band(&pair.simulated.on_over_time, bin_us),
        simulated_off: band(&pair.simulated.off_over_time, bin_us),
    }
}

fn band(half_bins: &[u64], bin_us: f64) -> RateBand {
    let pairs = || half_bins.chunks_exact(2).map(|pair| (pair[0] as f64, pair[1] as f64));
    let squares: f64 = pairs().map(|(a, b)| (a - b).powi(2)).sum();
    let n: f64 = pairs().map(|(a, b)| a + b).sum();
    let dispersion = if n > 0.0 { (squares / n).max(1.0) } else { 1.0 };
    let to_hz = 1e6 / bin_us;
    let (mut hz, mut low_hz, mut high_hz) = (Vec::new(), Vec::new(), Vec::new());
    for (a, b) in pairs() {
        let [low, high] = poisson_limits((a + b) / dispersion);
        hz.push((a + b) * to_hz);
        low_hz.push(low * dispersion * to_hz);
        high_hz.push(high * dispersion * to_hz);
    }
    RateBand { hz, low_hz, high_hz, dispersion }
}

/// Quantile of the gamma distribution of unit scale, by bisection in the logarithm.
fn gamma_quantile(shape: f64, p: f64) -> f64 {
    // For small x, P(x) <= x^shape / Gamma(shape + 1), nearly equal.
    let mut low = (p.ln() + ln_gamma(shape + 1.0)) / shape;
    if low < -30.0 {
        return low.exp();
    }
    let mut high = (shape + 10.0 * shape.sqrt() + 20.0).ln();
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if gamma_lr(shape, middle.exp()) < p { low = middle } else { high = middle }
    }
    (0.5 * (low + high)).exp()
}

/// 90 % limits of the mean of a Poisson count.
fn poisson_limits(n: f64) -> [f64; 2] {
    let quantile = |shape: f64, p: f64| {
        if shape > 100.0 {
            // Wilson and Hilferty: the cube root of a gamma variable is nearly normal; to 1e-4
            // here.
            let spread = 1.0 / (9.0 * shape);
            let z = 1.644_853_626_951_472_7 * (2.0 * f64::from(u8::from(p > 0.5)) - 1.0);
            return shape * (1.0 - spread + z * spread.sqrt()).powi(3);
        }
        gamma_quantile(shape, p)
    };
    [if n > 0.0 { quantile(n, 0.05) } else { 0.0 }, quantile(n + 1.0, 0.95)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poisson_limits_are_those_of_r() {
        // R: qgamma(0.05, n); qgamma(0.95, n + 1) for n = 0, 5, 50, 1000.
        for (n, low, high) in [(0.0, 0.0, 2.995_732), (5.0, 1.970_150, 10.513_04)] {
            let limits = poisson_limits(n);
            assert!(
                (limits[0] - low).abs() < 1e-4 && (limits[1] - high).abs() < 1e-4,
                "{limits:?}"
            );
        }
    }

    #[test]
    fn limits_of_counts_far_below_one_are_known() {
        // scipy.stats.gamma.ppf(0.05, 0.1) and (0.05, 0.2); 0.001 underflows.
        for (n, low) in [(0.001, 0.0), (0.1, 5.930_7e-14), (0.199_999, 2.039_06e-7)] {
            let limits = poisson_limits(n);
            assert!((limits[0] - low).abs() <= 1e-3 * low, "{n}: {limits:?}");
            assert!(limits[1] > 2.9 && limits[1] < 4.0);
        }
    }

    #[test]
    fn bursts_widen_the_band_and_independent_events_do_not() {
        let even = band(&[10, 12, 9, 11, 10, 10], 1e6);
        assert!((even.dispersion - 1.0).abs() < 1e-12);
        let bursts = band(&[0, 20, 21, 0, 19, 1], 1e6);
        assert!(bursts.dispersion > 15.0);
        assert!(bursts.high_hz[0] - bursts.low_hz[0] > 2.0 * (even.high_hz[0] - even.low_hz[0]));
        assert!((bursts.hz[0] - 20.0).abs() < 1e-12);
    }
}
