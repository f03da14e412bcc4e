//! **interval_tv** = 1/2 sum |h_sim - h_real|, h the shares of the per-pixel intervals in
//! logarithmic bins, 10 a decade from 1 µs to 1000 s.
//!
//! An interval is the time between successive events of a pixel, of any polarity, both in the
//! window. 0: equal histograms, 1: disjoint ones. Source: the measures the authors
//! of Raw2Event report; healthy is at most 0.25; the bins are evrig's choice.
//!
//! Error: tiles, with the signs of the differences held fixed, which avoids the bias of resampling
//! a distance. The bias of the data themselves is in `chance_level`: the same measure with the
//! streams of each tile swapped with probability 1/2.
//!
//! Independent of the distance between bins (see interval_emd) and of the order of intervals.
//! Intervals longer than the window are missing from both streams.

use super::ProfilePair;
use super::interval_bins::{FINE_PER_COARSE, N_COARSE};
use super::measure::{
    Cluster, Measure, MeasureDefinition, MeasureId, RAW2EVENT_MEASURES, chance_level,
};
use super::profile::StreamProfile;
use evrig_core::stats::dot;

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::IntervalTv,
    name: "Interval histogram distance",
    formula: "1/2 sum over bins |h_sim - h_real|; 10 bins a decade, 1 us to 1000 s",
    source: RAW2EVENT_MEASURES,
    unit: "1",
    clusters: Cluster::Tile,
    healthy: Some([0.0, 0.25]),
};

/// Random swaps of streams for the chance level.
const N_SWAPS: u64 = 25;

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    if let Some(because) = missing_intervals(pair) {
        return DEFINITION.unknown(because);
    }
    let real = coarse_by_tile(pair.real);
    let simulated = coarse_by_tile(pair.simulated);
    let signs: Vec<f64> = shares(total(&simulated))
        .iter()
        .zip(shares(total(&real)))
        .map(|(simulated, real)| (simulated - real).signum())
        .collect();
    let signed =
        |tiles: &[Vec<f64>]| -> Vec<f64> { tiles.iter().map(|h| dot(h, &signs)).collect() };
    let (signed_real, signed_simulated) = (signed(&real), signed(&simulated));
    let (n_real, n_simulated) = (pair.real.intervals_by_tile(), pair.simulated.intervals_by_tile());
    let n = n_real.iter().chain(&n_simulated).sum::<f64>() as u64;
    let estimate = pair.bootstrap.estimate(real.len(), n, |w| {
        let difference = dot(w, &signed_simulated) / dot(w, &n_simulated)
            - dot(w, &signed_real) / dot(w, &n_real);
        0.5 * difference
    });
    let chance = (0..N_SWAPS).map(|number| swapped(pair, &real, &simulated, number));
    Measure { chance_level: chance_level(chance), ..DEFINITION.with(estimate) }
}

/// Why an interval measure is unknown, if so.
pub(super) fn missing_intervals(pair: &ProfilePair<'_>) -> Option<&'static str> {
    let none = |profile: &StreamProfile| profile.intervals_by_tile().iter().sum::<f64>() == 0.0;
    if none(pair.real) {
        Some("no pixel has two real events")
    } else if none(pair.simulated) {
        Some("no pixel has two simulated events")
    } else {
        None
    }
}

fn coarse_by_tile(profile: &StreamProfile) -> Vec<Vec<f64>> {
    let coarse = |tile: usize| -> Vec<f64> {
        let bins = profile.histogram(tile).chunks_exact(FINE_PER_COARSE);
        bins.map(|bins| bins.iter().map(|&n| f64::from(n)).sum()).collect()
    };
    (0..profile.interval_sums.len()).map(coarse).collect()
}

fn total(tiles: &[Vec<f64>]) -> Vec<f64> {
    let mut sums = vec![0.0; N_COARSE];
    for tile in tiles {
        sums.iter_mut().zip(tile).for_each(|(sum, n)| *sum += n);
    }
    sums
}

fn shares(mut counts: Vec<f64>) -> Vec<f64> {
    let n: f64 = counts.iter().sum();
    counts.iter_mut().for_each(|count| *count /= n);
    counts
}

/// The distance with the streams of some tiles swapped.
fn swapped(pair: &ProfilePair<'_>, real: &[Vec<f64>], simulated: &[Vec<f64>], number: u64) -> f64 {
    let flips = pair.bootstrap.flips(real.len(), number);
    // As shares, so that a swap exchanges shapes and not numbers of intervals.
    let (n_real, n_simulated): (f64, f64) =
        (total(real).iter().sum(), total(simulated).iter().sum());
    let (mut one, mut other) = (vec![0.0; N_COARSE], vec![0.0; N_COARSE]);
    for ((real, simulated), flip) in real.iter().zip(simulated).zip(flips) {
        let (a, b) = if flip { (&mut other, &mut one) } else { (&mut one, &mut other) };
        a.iter_mut().zip(real).for_each(|(sum, n)| *sum += n / n_real);
        b.iter_mut().zip(simulated).for_each(|(sum, n)| *sum += n / n_simulated);
    }
    let (one, other) = (shares(one), shares(other));
    0.5 * one.iter().zip(other).map(|(one, other)| (one - other).abs()).sum::<f64>()
}
