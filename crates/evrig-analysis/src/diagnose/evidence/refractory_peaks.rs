//! Dead times that would make the changes of light before events alike.
//!
//! Behind a dead time a pixel takes the light anew, and fires when that has changed by the threshold.
//! Counted from the end of the right time changes are all as large; from any other instant they are only
//! where the light hardly moves. A search that begins some percent off stands where every event on a steep
//! edge contradicts it: so it begins here. Pixels without the dead time do not blur the time of the others.

use crate::diagnose::{Evidence, PixelEvidence};
use crate::predict::Spike;

/// Times that are looked at: the first, the next over the one before, and how many; microseconds.
const FIRST_US: f64 = 100.0;
const RATIO: f64 = 1.01;
const N_TIMES: usize = 695;

/// Times within so many of these steps are compared with each other.
const NEAR: usize = 20;

/// A time is looked at once more this closely.
const CLOSER: f64 = 1.001;
const N_CLOSER: i32 = 10;

/// Changes are alike within a bin and its neighbour; this many natural logarithms wide, from the least one on.
const BIN: f64 = 0.025;
const LEAST_LOG: f64 = -4.0;
const N_BINS: usize = 220;

/// Intervals looked at, at the most and at the least.
const MOST_PAIRS: usize = 2_000;
const LEAST_PAIRS: usize = 50;

/// A time counts where so many more of the changes are alike than beside it, as a share of all.
const STANDS_OUT: f64 = 0.03;

/// Times that are given.
const N_GIVEN: usize = 3;

/// Two events of one pixel, one behind the other.
struct Pair<'a> {
    pixel: &'a PixelEvidence,
    from_us: f64,
    to: Spike,
}

/// Dead times, microseconds, at which changes are more alike than at those beside them, clearest first.
pub(crate) fn dead_times_us(evidence: &Evidence) -> Vec<f64> {
    let pairs = pairs(evidence);
    if pairs.len() < LEAST_PAIRS {
        return Vec::new();
    }
    let times: Vec<f64> = (0..N_TIMES).map(|i| FIRST_US * RATIO.powi(i as i32)).collect();
    let alike: Vec<f64> = times.iter().map(|us| share_alike(evidence, &pairs, *us)).collect();
    let mut peaks: Vec<(f64, f64)> = (NEAR..N_TIMES - NEAR)
        .filter_map(|i| {
            let [before, behind] = [&alike[i - NEAR..i], &alike[i + 1..=i + NEAR]];
            let is_peak = before.iter().all(|other| *other < alike[i])
                && behind.iter().all(|other| *other <= alike[i]);
            // What changes are alike at any time near is no sign of this one.
            let least = |side: &[f64]| side.iter().copied().fold(f64::INFINITY, f64::min);
            let stands_out = alike[i] - least(before).max(least(behind));
            (is_peak && stands_out > STANDS_OUT).then_some((stands_out, times[i]))
        })
        .collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(N_GIVEN);
    peaks.into_iter().map(|(_, us)| closer(evidence, &pairs, us)).collect()
}

/// The best of the times that lie close about one.
fn closer(evidence: &Evidence, pairs: &[Pair<'_>], us: f64) -> f64 {
    let about = (-N_CLOSER..=N_CLOSER).map(|i| us * CLOSER.powi(i));
    let scored = about.map(|us| (share_alike(evidence, pairs, us), us));
    scored.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(us, |best| best.1)
}

/// Intervals, spread over all pixels.
fn pairs(evidence: &Evidence) -> Vec<Pair<'_>> {
    let every = evidence.n_events().div_ceil(MOST_PAIRS).max(1);
    let all = evidence.pixels.iter().flat_map(|pixel| {
        let pairs = pixel.spikes.windows(2);
        pairs.map(move |pair| Pair { pixel, from_us: pair[0].t_us as f64, to: pair[1] })
    });
    all.step_by(every).collect()
}

/// Share of the intervals with the commonest change of light between a time behind the first event and the second.
fn share_alike(evidence: &Evidence, pairs: &[Pair<'_>], dead_us: f64) -> f64 {
    let mut bins = [0_u32; N_BINS];
    for pair in pairs {
        let to_us = pair.to.t_us as f64;
        let begin_us = pair.from_us + dead_us;
        if begin_us >= to_us {
            continue;
        }
        let [begin, end] = [begin_us, to_us].map(|us| level(evidence, pair.pixel, us));
        let change = if pair.to.on { end - begin } else { begin - end };
        let bin = (change.ln() - LEAST_LOG) / BIN;
        // A change the wrong way, or of unknown light, has no logarithm.
        if bin >= 0.0 && bin < N_BINS as f64 {
            bins[bin as usize] += 1;
        }
    }
    let most = bins.windows(2).map(|pair| pair[0] + pair[1]).max().unwrap_or(0);
    f64::from(most) / pairs.len() as f64
}

/// Log intensity at a time; `NaN` where it is not known.
fn level(evidence: &Evidence, pixel: &PixelEvidence, us: f64) -> f64 {
    let at = (us - evidence.start_us) / evidence.step_us;
    let i = at.max(0.0) as usize;
    let [here, next] = [i, i + 1].map(|i| pixel.light.get(i).map_or(f64::NAN, |v| f64::from(*v)));
    here + (next - here) * (at - i as f64)
}
