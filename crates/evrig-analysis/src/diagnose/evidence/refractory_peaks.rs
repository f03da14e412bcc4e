//! Candidate refractory periods from the distribution of signal changes.
//!
//! After a refractory period the pixel stores the signal anew and fires when it has changed by the
//! threshold. Measured from the end of the true period, all changes are equal; measured from
//! another time they scatter where the signal changes fast. The likelihood is narrow in the
//! period, so that fits start at the peaks of this criterion. Pixels without the effect do not
//! blur the peak.

use crate::diagnose::{Evidence, PixelEvidence};
use crate::predict::Spike;

/// Shortest trial period, ratio of the next to the last one, and their number.
const SHORTEST_US: f64 = 100.0;
const STEP_RATIO: f64 = 1.01;
const N_PERIODS: usize = 695;

/// Steps to either side against which a peak is measured.
const NEIGHBOUR_STEPS: usize = 20;

/// Step ratio and number of steps to either side of the refinement.
const FINE_STEP_RATIO: f64 = 1.001;
const N_FINE_STEPS: i32 = 10;

/// Bins of the logarithm of the change: width, lower end, number.
const BIN_LOG_WIDTH: f64 = 0.025;
const FIRST_BIN_LOG: f64 = -4.0;
const N_BINS: usize = 220;

/// Intervals that are used, at most and at least.
const MAX_PAIRS: usize = 2_000;
const MIN_PAIRS: usize = 50;

/// Height of a peak over its surroundings, as a share of all intervals.
const MIN_PROMINENCE: f64 = 0.03;

const MAX_PEAKS: usize = 3;

/// Two successive events of one pixel.
struct EventPair<'a> {
    pixel: &'a PixelEvidence,
    from_us: f64,
    to: Spike,
}

/// Periods, microseconds, at which changes agree better than at neighbouring periods, most
/// prominent first.
pub(crate) fn refractory_peaks_us(evidence: &Evidence) -> Vec<f64> {
    let pairs = pairs(evidence);
    if pairs.len() < MIN_PAIRS {
        return Vec::new();
    }
    let times: Vec<f64> = (0..N_PERIODS).map(|i| SHORTEST_US * STEP_RATIO.powi(i as i32)).collect();
    let alike: Vec<f64> = times.iter().map(|us| share_alike(evidence, &pairs, *us)).collect();
    let mut peaks: Vec<(f64, f64)> = (NEIGHBOUR_STEPS..N_PERIODS - NEIGHBOUR_STEPS)
        .filter_map(|i| {
            let [before, behind] =
                [&alike[i - NEIGHBOUR_STEPS..i], &alike[i + 1..=i + NEIGHBOUR_STEPS]];
            let is_peak = before.iter().all(|other| *other < alike[i])
                && behind.iter().all(|other| *other <= alike[i]);
            // A plateau of agreeing changes is no peak.
            let least = |side: &[f64]| side.iter().copied().fold(f64::INFINITY, f64::min);
            let stands_out = alike[i] - least(before).max(least(behind));
            (is_peak && stands_out > MIN_PROMINENCE).then_some((stands_out, times[i]))
        })
        .collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(MAX_PEAKS);
    peaks.into_iter().map(|(_, us)| closer(evidence, &pairs, us)).collect()
}

/// The best period near one.
fn closer(evidence: &Evidence, pairs: &[EventPair<'_>], us: f64) -> f64 {
    let about = (-N_FINE_STEPS..=N_FINE_STEPS).map(|i| us * FINE_STEP_RATIO.powi(i));
    let scored = about.map(|us| (share_alike(evidence, pairs, us), us));
    scored.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(us, |best| best.1)
}

/// Intervals, spread over all pixels.
fn pairs(evidence: &Evidence) -> Vec<EventPair<'_>> {
    let every = evidence.n_events().div_ceil(MAX_PAIRS).max(1);
    let all = evidence.pixels.iter().flat_map(|pixel| {
        let pairs = pixel.spikes.windows(2);
        pairs.map(move |pair| EventPair { pixel, from_us: pair[0].t_us as f64, to: pair[1] })
    });
    all.step_by(every).collect()
}

/// Share of the intervals in the most common bin of the signal change after a period.
fn share_alike(evidence: &Evidence, pairs: &[EventPair<'_>], dead_us: f64) -> f64 {
    let mut bins = [0_u32; N_BINS];
    for pair in pairs {
        let to_us = pair.to.t_us as f64;
        let begin_us = pair.from_us + dead_us;
        if begin_us >= to_us {
            continue;
        }
        let [begin, end] = [begin_us, to_us].map(|us| level(evidence, pair.pixel, us));
        let change = if pair.to.on { end - begin } else { begin - end };
        let bin = (change.ln() - FIRST_BIN_LOG) / BIN_LOG_WIDTH;
        // Changes of the wrong sign or of an unknown signal have no logarithm.
        if bin >= 0.0 && bin < N_BINS as f64 {
            bins[bin as usize] += 1;
        }
    }
    let most = bins.windows(2).map(|pair| pair[0] + pair[1]).max().unwrap_or(0);
    f64::from(most) / pairs.len() as f64
}

/// Log intensity at a time; NaN where unknown.
fn level(evidence: &Evidence, pixel: &PixelEvidence, us: f64) -> f64 {
    let at = (us - evidence.start_us) / evidence.step_us;
    let i = at.max(0.0) as usize;
    let [here, next] = [i, i + 1].map(|i| pixel.light.get(i).map_or(f64::NAN, |v| f64::from(*v)));
    here + (next - here) * (at - i as f64)
}
