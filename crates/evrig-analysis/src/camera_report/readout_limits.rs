//! Limits of the readout: the highest rate, a ceiling of the rate, and a fixed time per event.

use super::SectionResult;
use super::chance::{LEVEL, normal_tail};
use evrig_core::event::EventSlice;
use evrig_core::stats::Estimate;
use serde::Serialize;

/// Bins of time in which rates are compared, µs.
const BIN_US: i64 = 1_000;

/// Share of the bins that are busiest, in which a ceiling shows.
const BUSY_SHARE: f64 = 0.02;

/// Fewest pairs of neighbouring bins for the scatter at the highest rates, and fewest events of a
/// bin: below, counts scatter as Poisson's law whatever the readout.
const MIN_PAIRS: usize = 20;
const MIN_EVENTS_PER_BIN: f64 = 30.0;

/// Share of gaps between stamps equal to the service time on a saturated bus, and the share that
/// may be shorter, from rounding.
const MIN_BUSY_SHARE: f64 = 0.3;
const MAX_SHORTER_SHARE: f64 = 0.01;

/// Range of service times, µs. Stamps resolve none below.
const SERVICE_US: [usize; 2] = [3, 2_000];

/// Fewest events for the limits of the readout.
const MIN_EVENTS: usize = 1_000;

/// What the readout lets through.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReadoutLimits {
    /// Most events of a millisecond.
    pub max_per_ms: u64,
    /// Mean number per millisecond.
    pub mean_per_ms: f64,
    /// Variance over mean of neighbouring bins at the highest rates: 1 by Poisson's law, less where
    /// the readout holds events up.
    pub scatter_at_peak: Estimate,
    /// Rate of a ceiling, events per second, where counts at the highest rates scatter less than
    /// chance explains.
    pub ceiling_hz: Option<Estimate>,
    /// Time per event of a saturated bus, µs.
    pub service_us: Option<Estimate>,
}

pub(super) fn limits(events: EventSlice<'_>, step_us: f64) -> SectionResult<ReadoutLimits> {
    let n = events.len();
    let [first, last] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
    let bin_us = BIN_US.max(step_us.ceil() as i64);
    let n_bins = ((last - first) / bin_us) as usize;
    if n < MIN_EVENTS || n_bins < MIN_PAIRS {
        return SectionResult::not_measured(format!(
            "too few events for the limits of the readout: {n} in {:.3} s, at least {MIN_EVENTS} in \
             {:.3} s are needed",
            (last - first) as f64 * 1e-6,
            MIN_PAIRS as f64 * bin_us as f64 * 1e-6
        ));
    }
    let mut counts = vec![0_u32; n_bins + 1];
    events.t.iter().for_each(|t| counts[((t - first) / bin_us) as usize] += 1);
    // The last bin is cut short.
    counts.truncate(n_bins);
    let (scatter_at_peak, busy_mean) = scatter(&counts);
    let per_second = 1e6 / bin_us as f64;
    let z = (1.0 - scatter_at_peak.value) / scatter_at_peak.standard_error;
    // Of the two statistics of a limit each gets half of the level.
    let is_ceiling = z.is_finite() && normal_tail(z) < 0.5 * LEVEL;
    let ceiling_hz = is_ceiling.then(|| {
        let n = scatter_at_peak.n;
        let error = (busy_mean * scatter_at_peak.value.max(0.0) / n.max(1) as f64).sqrt();
        Estimate::normal(busy_mean * per_second, error * per_second, n)
    });
    SectionResult::Known(ReadoutLimits {
        max_per_ms: u64::from(counts.iter().copied().max().unwrap_or(0)),
        mean_per_ms: n as f64 / n_bins as f64,
        scatter_at_peak,
        ceiling_hz,
        service_us: service(events.t),
    })
}

/// Variance over mean of pairs of neighbouring bins, and their mean. The bins about a pair, not the
/// pair itself, decide whether it is busy, so that the choice does not narrow its scatter.
fn scatter(counts: &[u32]) -> (Estimate, f64) {
    let mut about: Vec<(u32, usize)> = (1..counts.len().saturating_sub(2))
        .map(|i| (counts[i - 1].min(counts[i + 2]), i))
        .collect();
    about.sort_unstable_by(|a, b| b.cmp(a));
    let n_busy = ((about.len() as f64 * BUSY_SHARE) as usize).max(MIN_PAIRS).min(about.len());
    let busy = about[..n_busy].iter().map(|(_, i)| [counts[*i], counts[i + 1]].map(f64::from));
    let (mut sum, mut total, mut n) = (0.0, 0.0, 0_u64);
    for [a, b] in busy.filter(|[a, b]| a + b >= 2.0 * MIN_EVENTS_PER_BIN) {
        sum += (a - b) * (a - b) / (a + b);
        total += a + b;
        n += 1;
    }
    if (n as usize) < MIN_PAIRS {
        return (Estimate::unknown(), f64::NAN);
    }
    // A sum of n squares of standard normal variables, of which those sharing a bin correlate by a
    // quarter: with at most two such neighbours its variance is below 3 n.
    let n_pairs = n as f64;
    (Estimate::normal(sum / n_pairs, (3.0 / n_pairs).sqrt(), n), total / (2.0 * n_pairs))
}

/// The most common gap between stamps, if hardly any is shorter: the time a saturated bus takes.
pub(super) fn service(t: &[i64]) -> Option<Estimate> {
    let [shortest, longest] = SERVICE_US;
    let mut counts = vec![0_u64; longest + 2];
    t.windows(2).for_each(|pair| counts[((pair[1] - pair[0]) as usize).min(longest + 1)] += 1);
    let all = t.len().saturating_sub(1) as f64;
    let common = (0..=longest).max_by_key(|gap| counts[*gap])?;
    if common < shortest {
        return None;
    }
    // A service time between two whole microseconds shows as both.
    let [low, high] = [common - 1, common + 1];
    let shorter: u64 = counts[..low].iter().sum();
    let own: u64 = counts[low..=high].iter().sum();
    let is_busy = own as f64 >= MIN_BUSY_SHARE * all && shorter as f64 <= MAX_SHORTER_SHARE * all;
    // On a grid of stamps, equal ones are at least half as frequent as neighbouring ones.
    if !is_busy {
        return None;
    }
    let sum: f64 = (low..=high).map(|gap| gap as f64 * counts[gap] as f64).sum();
    let free = counts[high + 1].max(1) as f64 / own as f64;
    Some(Estimate::normal(sum / own as f64, free.max(1e-3), own))
}
