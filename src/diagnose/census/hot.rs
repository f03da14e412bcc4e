//! Pixels that fire far more than those about them.

use super::{Departure, Evidence};
use crate::effect_id::EffectId;
use crate::geometry::Size;
use crate::stats::upper_median;
use std::collections::BTreeSet;

/// Events a second that a hot pixel fires at least beyond its neighbours.
const LEAST_HZ: f64 = 8.0;

/// And so many times as often as they.
const TIMES: f64 = 4.0;

/// Fewest hot pixels that are said to be a share of all.
const LEAST: usize = 4;

/// Share of all events that they have to fire.
const LEAST_SHARE: f64 = 0.003;

/// Hot pixels of the sensor, if there are enough to matter, and where they are.
pub(super) fn pixels(evidence: &Evidence) -> Option<(Departure, BTreeSet<(u16, u16)>)> {
    let seconds = evidence.blocks.length_us() as f64 * 1e-6;
    let recording = evidence.around.recording();
    let Size { width, height } = recording.size();
    let (mut hot, mut events, mut all) = (BTreeSet::new(), 0.0, 0.0);
    for y in 0..height {
        for x in 0..width {
            let own = recording.of(x, y).len() as f64;
            all += own;
            if own < LEAST_HZ * seconds {
                continue;
            }
            let about = evidence.around.eight(x, y);
            let mut others: Vec<f64> = about.map(|spikes| spikes.len() as f64).collect();
            let common = upper_median(&mut others)?;
            if own > TIMES * (common + 2.0) && own - common > LEAST_HZ * seconds {
                hot.insert((x, y));
                events += own - common;
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
    (n_hot >= LEAST && events > LEAST_SHARE * all).then_some((departure, hot))
}
