//! Pixels that fire far more than those about them.

use super::{Departure, Evidence};
use crate::effect_id::EffectId;
use crate::geometry::Size;
use crate::predict::Spike;
use std::collections::BTreeSet;

/// Events a second that a hot pixel fires at least beyond its neighbours.
const LEAST_HZ: f64 = 8.0;

/// And so many times as often as they.
const TIMES: f64 = 4.0;

/// Of the neighbours so many may be hot as well.
const HOT_ABOUT: usize = 2;

/// Fewest hot pixels that are said to be a share of all.
const LEAST: usize = 4;

/// Share of all events that they have to fire.
const LEAST_SHARE: f64 = 0.003;

/// Share of a pixel's events that turn the polarity of the one before, from which on its own noise sets
/// them off: where its threshold is low it fires often, and each time the noise comes back.
const TURNED: f64 = 0.7;

/// Hot pixels of the sensor, if there are enough to matter, and where they are.
pub(super) fn pixels(evidence: &Evidence) -> Option<(Departure, BTreeSet<(u16, u16)>)> {
    let seconds = evidence.blocks.length_us() as f64 * 1e-6;
    let recording = evidence.around.recording();
    let Size { width, height } = recording.size();
    let all = recording.len() as f64;
    let (mut hot, mut events, mut turned) = (BTreeSet::new(), 0.0, 0.0);
    for y in 0..height {
        for x in 0..width {
            let spikes = recording.of(x, y);
            let own = spikes.len() as f64;
            if own < LEAST_HZ * seconds {
                continue;
            }
            let about = evidence.around.eight(x, y);
            let mut others: Vec<f64> = about.map(|spikes| spikes.len() as f64).collect();
            others.sort_by(|a, b| b.total_cmp(a));
            // Beside dead pixels the middle one of the neighbours says little of the light there.
            let common = *others.get(HOT_ABOUT).or(others.last())?;
            if own > TIMES * (common + 2.0) && own - common > LEAST_HZ * seconds {
                hot.insert((x, y));
                events += own - common;
                turned += turns(spikes);
            }
        }
    }
    let n_hot = hot.len();
    let fraction = n_hot as f64 / recording.size().n_pixels() as f64;
    let departure = Departure {
        id: EffectId::HotPixels,
        parameters: vec![("fraction", [fraction, fraction / (n_hot as f64).sqrt()])],
        says: format!(
            "{n_hot} pixels fire over four times as often as those about them, {:.1} % of all events",
            100.0 * events / all
        ),
        z: (n_hot as f64).sqrt() * TIMES,
        without: None,
    };
    let is_noise = turned > TURNED * n_hot as f64;
    (n_hot >= LEAST && events > LEAST_SHARE * all && !is_noise).then_some((departure, hot))
}

/// Share of the events that turn the polarity of the one before.
fn turns(spikes: &[Spike]) -> f64 {
    let turned = spikes.windows(2).filter(|pair| pair[0].on != pair[1].on).count();
    turned as f64 / (spikes.len() - 1).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polarity_turns_with_noise_and_not_with_a_leak() {
        let spikes = |on: fn(i64) -> bool| (0..101).map(move |t_us| Spike { t_us, on: on(t_us) });
        let share = |on| turns(&spikes(on).collect::<Vec<_>>());
        assert!((share(|t| t % 2 == 0) - 1.0).abs() < 1e-12);
        assert!(share(|_| true).abs() < 1e-12);
        assert!((share(|t| t / 2 % 2 == 0) - 0.5).abs() < 0.01);
    }
}
