//! **temporal_emd**: earth mover's distance between the two distributions of event times over the
//! window, in milliseconds: W1 = integral of |F_sim(t) - F_real(t)| dt, F the share of a stream's
//! events up to time t, all pixels and polarities together. A stream delayed by d has distance d.
//!
//! The counterpart in time of spatial_emd: papers on event simulators report a distance in space
//! and one in time, with definitions of their own. Source: Rubner, Tomasi and Guibas, IJCV 40, 2000;
//! in one dimension it is the area between the distribution functions (Vallender, Theory of
//! Probability and Its Applications 18, 1974). Exact, in one pass over the sorted times.
//!
//! Error: time blocks, with the optimal potential held fixed (the distance's derivative).
//! `chance_level`: the streams of each time block swapped with probability 1/2.
//!
//! Independent of location, polarity and number of events. It is dominated by slow changes of the
//! rate; delays of single pixels that cancel over the grid are not seen.

use super::ProfilePair;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, chance_level};
use super::profile::N_BLOCKS;
use evrig_core::event::EventSlice;
use evrig_core::stats::dot;

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::TemporalEmd,
    name: "Temporal transport distance",
    formula: "integral of |F_sim(t) - F_real(t)| dt, F = share of the events up to t",
    source: "Rubner, Tomasi and Guibas, The Earth Mover's Distance, IJCV 40, 2000",
    unit: "ms",
    clusters: Cluster::TimeBlock,
    healthy: None,
};

/// Random swaps of streams for the chance level.
const N_SWAPS: u64 = 3;
const MS_PER_US: f64 = 1e-3;

pub(super) fn measure(
    pair: &ProfilePair<'_>,
    real: EventSlice<'_>,
    simulated: EventSlice<'_>,
) -> Measure {
    if let Some(because) = pair.missing_events() {
        return DEFINITION.unknown(because);
    }
    let times = |events: EventSlice<'_>| -> Vec<i64> {
        pair.layout.in_region(events).map(|(_, i)| events.t[i]).collect()
    };
    let times = [times(simulated), times(real)];
    let block_of = |t: i64| pair.layout.block(t);
    let counts = [pair.simulated.by_block().0, pair.real.by_block().0];
    let mut scores = [vec![0.0; N_BLOCKS], vec![0.0; N_BLOCKS]];
    let never = [false; N_BLOCKS];
    transport(
        pair.layout.window[1],
        &times,
        &counts,
        &never,
        block_of,
        |stream, block, potential| {
            scores[stream][block] += potential * MS_PER_US;
        },
    );
    let n = pair.real.n + pair.simulated.n;
    let estimate = pair.bootstrap.estimate(N_BLOCKS, n, |w| {
        dot(w, &scores[0]) / dot(w, &counts[0]) - dot(w, &scores[1]) / dot(w, &counts[1])
    });
    let chance = (0..N_SWAPS).map(|number| {
        let flips = pair.bootstrap.flips(N_BLOCKS, number);
        let end = pair.layout.window[1];
        MS_PER_US * transport(end, &times, &counts, &flips, block_of, |_, _, _| {})
    });
    Measure { chance_level: chance_level(chance), ..DEFINITION.with(estimate) }
}

/// Walks from the end of the window back over the events of both streams. `visit` takes stream,
/// block and potential of each event: the potential's slope is the sign of F_sim - F_real, so that
/// the difference of its means is the distance. Gives the distance, µs, with the streams of some
/// blocks swapped.
fn transport(
    end: i64,
    times: &[Vec<i64>; 2],
    counts: &[Vec<f64>; 2],
    flips: &[bool],
    block_of: impl Fn(i64) -> usize,
    mut visit: impl FnMut(usize, usize, f64),
) -> f64 {
    let all = [0, 1].map(|stream: usize| counts[stream].iter().sum::<f64>());
    let side = |stream: usize, block: usize| stream ^ usize::from(flips[block]);
    // As shares, so that a swap exchanges times and not numbers of events.
    let mut mass = [0.0; 2];
    for (stream, counts) in counts.iter().enumerate() {
        for (block, n) in counts.iter().enumerate() {
            mass[side(stream, block)] += n / all[stream];
        }
    }
    let mut left = times.each_ref().map(|times| times.as_slice());
    let (mut before, mut ahead, mut potential, mut distance) = (end, 0.0_f64, 0.0, 0.0);
    while let Some(&t) = left.iter().filter_map(|times| times.last()).max() {
        // F_sim - F_real from t on is what is missing of both after it.
        let step = (before - t) as f64;
        distance += ahead.abs() * step;
        if ahead != 0.0 {
            potential += ahead.signum() * step;
        }
        before = t;
        let block = block_of(t);
        for (stream, times) in left.iter_mut().enumerate() {
            while let Some((_, rest)) = times.split_last().filter(|(last, _)| **last == t) {
                *times = rest;
                visit(stream, block, potential);
                let to = side(stream, block);
                let share = 1.0 / (all[stream] * mass[to]);
                ahead += if to == 0 { -share } else { share };
            }
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_is_that_of_scipy() {
        // scipy.stats.wasserstein_distance([1, 4, 4, 9], [2, 3, 7]) = 1.5
        let times = [vec![1, 4, 4, 9], vec![2, 3, 7]];
        let counts = [vec![4.0], vec![3.0]];
        let mut means = [0.0; 2];
        let visit = |stream: usize, _, potential: f64| {
            means[stream] += potential / counts[stream][0];
        };
        let found = transport(10, &times, &counts, &[false], |_| 0, visit);
        assert!((found - 1.5).abs() < 1e-12, "{found}");
        assert!((means[0] - means[1] - found).abs() < 1e-12, "{means:?}");
    }
}
