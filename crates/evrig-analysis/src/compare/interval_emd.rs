//! **interval_emd**: Sinkhorn divergence between the samples of per-pixel intervals, in
//! decades: S = OT_e(sim, real) - OT_e(sim, sim)/2 - OT_e(real, real)/2 with the cost
//! |log10 a - log10 b| and the blur e = 0.05 decades.
//!
//! The mean factor between corresponding intervals: 0.3 is a factor of two. Without blur it is the
//! earth mover's distance, the area between the two distribution functions of log10 interval, which
//! is in `curves.intervals.distance_decades`. The blur
//! lowers it by about e ln(spread / e): 0.47 instead of 0.60 for two normal distributions of widths
//! 0.6 and 0.4 decades. Equal samples have 0 and point masses their distance for any blur.
//! Intervals are binned to 0.01 decades. Source: Feydy et al., AISTATS 2019.
//!
//! Error: tiles, with the optimal potentials held fixed (the divergence's derivative);
//! `chance_level` as for interval_tv. The last change of the iteration is the numerical error.
//!
//! Independent of order and location of the intervals. Intervals of 0 µs count as 1 µs; those
//! longer than the window are missing from both streams.

use super::ProfilePair;
use super::interval_bins::{N_FINE, log_middle};
use super::interval_tv::missing_intervals;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, chance_level};
use super::profile::StreamProfile;
use super::sinkhorn::{self, Divergence};
use evrig_core::stats::dot;
use rayon::prelude::*;

/// Blur of the divergence, decades.
pub(super) const BLUR_DECADES: f64 = 0.05;

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::IntervalEmd,
    name: "Interval transport distance",
    formula: "Sinkhorn divergence of log10 interval, cost |x - y|, blur 0.05 decades",
    source: "Feydy et al., Interpolating between optimal transport and MMD, AISTATS 2019",
    unit: "decades",
    clusters: Cluster::Tile,
    healthy: None,
};

/// Random swaps of streams for the chance level.
const N_SWAPS: u64 = 3;

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    if let Some(because) = missing_intervals(pair) {
        return DEFINITION.unknown(because);
    }
    let of_tiles = |flips: Option<&[bool]>| {
        let (one, other) = histograms(pair, flips);
        divergence(&one, &other)
    };
    let (result, chance) = rayon::join(
        || of_tiles(None),
        || {
            let n_tiles = pair.layout.n_tiles();
            let numbers = (0..N_SWAPS).into_par_iter();
            let swapped =
                numbers.map(|number| of_tiles(Some(&pair.bootstrap.flips(n_tiles, number))).value);
            swapped.collect::<Vec<f64>>()
        },
    );
    let score = |profile: &StreamProfile, potential: &[f64]| -> Vec<f64> {
        let tiles = 0..profile.interval_sums.len();
        tiles.map(|tile| dot_counts(profile.histogram(tile), potential)).collect()
    };
    let score_real = score(pair.real, &result.potentials[0]);
    let score_simulated = score(pair.simulated, &result.potentials[1]);
    let n_real = pair.real.intervals_by_tile();
    let n_simulated = pair.simulated.intervals_by_tile();
    let n = n_real.iter().chain(&n_simulated).sum::<f64>() as u64;
    let estimate = pair.bootstrap.estimate(n_real.len(), n, |w| {
        dot(w, &score_real) / dot(w, &n_real) + dot(w, &score_simulated) / dot(w, &n_simulated)
    });
    let chance_level = chance_level(chance.into_iter());
    let numerical_error = Some(result.last_change);
    Measure { chance_level, numerical_error, ..DEFINITION.with(estimate) }
}

fn divergence(one: &[f64], other: &[f64]) -> Divergence {
    let step = log_middle(1) - log_middle(0);
    sinkhorn::divergence(one, other, step, BLUR_DECADES)
}

/// Histograms of the real and the simulated intervals, with those of some tiles swapped.
pub(super) fn histograms(pair: &ProfilePair<'_>, flips: Option<&[bool]>) -> (Vec<f64>, Vec<f64>) {
    let Some(flips) = flips else {
        return (pair.real.total_histogram(), pair.simulated.total_histogram());
    };
    // As shares, so that a swap exchanges shapes and not numbers of intervals.
    let n = |profile: &StreamProfile| profile.intervals_by_tile().iter().sum::<f64>();
    let (n_real, n_simulated) = (n(pair.real), n(pair.simulated));
    let (mut one, mut other) = (vec![0.0; N_FINE], vec![0.0; N_FINE]);
    for (tile, &flip) in flips.iter().enumerate() {
        let (a, b) = if flip { (&mut other, &mut one) } else { (&mut one, &mut other) };
        let add = |sums: &mut Vec<f64>, counts: &[u32], all: f64| {
            sums.iter_mut().zip(counts).for_each(|(sum, &n)| *sum += f64::from(n) / all);
        };
        add(a, pair.real.histogram(tile), n_real);
        add(b, pair.simulated.histogram(tile), n_simulated);
    }
    (one, other)
}

fn dot_counts(counts: &[u32], potential: &[f64]) -> f64 {
    counts.iter().zip(potential).map(|(&n, p)| f64::from(n) * p).sum()
}
