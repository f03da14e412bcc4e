//! **interval_ks** = max over intervals of |F_sim - F_real|, F the distribution function of the
//! per-pixel intervals: the Kolmogorov-Smirnov distance.
//!
//! An interval is the time between successive events of a pixel, of any polarity, both in the
//! window. The functions are compared at the ends of bins of 0.01 decades from 1 µs to 1000 s, which
//! lowers the distance by at most the share of the intervals in one bin: 0.088 instead of 0.094 for
//! ESIM on a DAVIS346 street recording. 0: equal distributions, 1: disjoint ones. Source: Smirnov,
//! Annals of Mathematical Statistics 19, 1948.
//!
//! Error: tiles, with the interval of the maximum and the sign held fixed, which avoids the bias of
//! resampling a distance. The p-value of the test named alike is not given: it takes independent
//! intervals, and those of a pixel and of its neighbours are not. `chance_level` as for interval_tv.
//!
//! Independent of how far intervals are apart beyond the maximum (see interval_emd) and of their
//! order and location.

use super::ProfilePair;
use super::interval_emd::histograms;
use super::interval_tv::missing_intervals;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, chance_level};
use super::profile::StreamProfile;
use evrig_core::stats::dot;

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::IntervalKs,
    name: "Interval Kolmogorov-Smirnov distance",
    formula: "max |F_sim - F_real|, F = distribution function of the per-pixel intervals",
    source: "Smirnov, Table for Estimating the Goodness of Fit, Ann. Math. Statist. 19, 1948",
    unit: "1",
    clusters: Cluster::Tile,
    healthy: None,
};

/// Random swaps of streams for the chance level.
const N_SWAPS: u64 = 25;

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    if let Some(because) = missing_intervals(pair) {
        return DEFINITION.unknown(because);
    }
    let (real, simulated) = histograms(pair, None);
    let (bin, signed) = largest_difference(&simulated, &real);
    let up_to = |profile: &StreamProfile| -> Vec<f64> {
        let count = |tile| profile.histogram(tile)[..=bin].iter().map(|&n| f64::from(n)).sum();
        (0..pair.layout.n_tiles()).map(count).collect()
    };
    let (below_real, below_simulated) = (up_to(pair.real), up_to(pair.simulated));
    let (n_real, n_simulated) = (pair.real.intervals_by_tile(), pair.simulated.intervals_by_tile());
    let n = n_real.iter().chain(&n_simulated).sum::<f64>() as u64;
    let estimate = pair.bootstrap.estimate(pair.layout.n_tiles(), n, |w| {
        let difference =
            dot(w, &below_simulated) / dot(w, &n_simulated) - dot(w, &below_real) / dot(w, &n_real);
        signed.signum() * difference
    });
    let chance = (0..N_SWAPS).map(|number| {
        let flips = pair.bootstrap.flips(pair.layout.n_tiles(), number);
        let (one, other) = histograms(pair, Some(&flips));
        largest_difference(&one, &other).1.abs()
    });
    Measure { chance_level: chance_level(chance), ..DEFINITION.with(estimate) }
}

/// The bin at whose end two distribution functions differ most, and the difference there.
fn largest_difference(one: &[f64], other: &[f64]) -> (usize, f64) {
    let (n_one, n_other) = (one.iter().sum::<f64>(), other.iter().sum::<f64>());
    let (mut sums, mut largest) = ([0.0; 2], (0, 0.0_f64));
    for (bin, (one, other)) in one.iter().zip(other).enumerate() {
        sums[0] += one;
        sums[1] += other;
        let difference = sums[0] / n_one - sums[1] / n_other;
        if difference.abs() > largest.1.abs() {
            largest = (bin, difference);
        }
    }
    largest
}
