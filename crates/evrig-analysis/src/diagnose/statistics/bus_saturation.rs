//! A saturated bus that reads one event after another.

use super::Departure;
use evrig_core::effect_id::EffectId;

/// Range of service times, microseconds. Stamps resolve none below.
const MAX_SERVICE_US: usize = 2_000;

const MIN_SERVICE_US: usize = 3;

/// Share of gaps equal to the service time on a saturated bus.
const MIN_BUSY_SHARE: f64 = 0.3;

/// Share that may be shorter, from rounding.
const MAX_SHORTER_SHARE: f64 = 0.01;

/// A saturated bus: no gap is shorter than the service time, and many are equal to it. `times`
/// ascend.
pub(super) fn saturation(times: &[i64]) -> Option<Departure> {
    let [rate, error] = served(times)?;
    Some(Departure {
        id: EffectId::ReadoutSaturation,
        parameters: vec![("max_events_per_s", [rate, error])],
        description: format!("the bus is saturated at {rate:.0} events per second"),
        z: rate / error,
        without: None,
    })
}

/// Events per second of a saturated bus, with the standard error.
fn served(times: &[i64]) -> Option<[f64; 2]> {
    let gap = shortest_gap(times).filter(ServiceGap::is_busy)?;
    let rate = 1e6 / gap.us;
    Some([rate, rate * (gap.error_us / gap.us).max(1e-3)])
}

/// The service time of the readout.
pub(super) struct ServiceGap {
    /// Service time, microseconds.
    pub(super) us: f64,
    pub(super) error_us: f64,
    /// Share of gaps equal to it.
    pub(super) share: f64,
}

impl ServiceGap {
    /// Whether the readout determines event times.
    pub(super) fn is_busy(&self) -> bool {
        self.share >= MIN_BUSY_SHARE
    }
}

/// The most common gap, if hardly any is shorter. `times` ascend.
pub(super) fn shortest_gap(times: &[i64]) -> Option<ServiceGap> {
    let mut counts = vec![0_u64; MAX_SERVICE_US + 2];
    for pair in times.windows(2) {
        counts[((pair[1] - pair[0]) as usize).min(MAX_SERVICE_US + 1)] += 1;
    }
    let all = times.len().checked_sub(1).filter(|n| *n > 1_000)? as f64;
    let common = (0..=MAX_SERVICE_US).max_by_key(|gap| counts[*gap])?;
    // A service time between two whole microseconds shows as both.
    let [low, high] = [common.saturating_sub(1), common + 1];
    let shorter: u64 = counts[..low].iter().sum();
    let own: u64 = counts[low..=high].iter().sum();
    if common < MIN_SERVICE_US || shorter as f64 > MAX_SHORTER_SHARE * all {
        return None;
    }
    let sum: f64 = (low..=high).map(|gap| gap as f64 * counts[gap] as f64).sum();
    // Some of the gaps come from an idle bus.
    let free = counts[high + 1].max(1) as f64 / own as f64;
    Some(ServiceGap { us: sum / own as f64, error_us: free, share: own as f64 / all })
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    #[test]
    fn a_saturated_bus_is_found_with_its_rate() {
        let mut random = SplitMix::new(2, 3);
        let (mut t, mut asked) = (0.0_f64, Vec::new());
        for _ in 0..40_000 {
            t -= 9.0 * random.between(1e-9, 1.0).ln();
            asked.push(t);
        }
        let free: Vec<i64> = asked.iter().map(|t| *t as i64).collect();
        assert!(served(&free).is_none());
        let mut at = 0.0_f64;
        let busy: Vec<i64> = asked
            .iter()
            .map(|t| {
                at = t.max(at + 10.4);
                at.round() as i64
            })
            .collect();
        let [rate, _] = served(&busy).unwrap();
        assert!((rate / (1e6 / 10.4) - 1.0).abs() < 0.01, "{rate}");
    }
}
