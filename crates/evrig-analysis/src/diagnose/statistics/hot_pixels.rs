//! Pixels with a much higher rate than their neighbours.

use super::{Departure, Evidence};
use crate::diagnose::evidence::event_context::EventContext;
use crate::predict::Spike;
use evrig_core::effect_id::EffectId;
use evrig_core::geometry::Size;
use std::collections::BTreeSet;

/// Rate of a hot pixel over its neighbours': at least, and as a multiple.
const MIN_EXCESS_HZ: f64 = 8.0;

const MIN_RATE_RATIO: f64 = 4.0;

/// Neighbours that may be hot as well.
const MAX_HOT_NEIGHBOURS: usize = 2;

/// Fewest hot pixels, and least share of all events from them.
const MIN_HOT_PIXELS: usize = 4;

const MIN_EVENT_SHARE: f64 = 0.003;

/// Share of polarity alternations above which the pixel's own noise, at a low threshold, makes the
/// events.
const MIN_NOISE_ALTERNATION: f64 = 0.7;

/// The hot pixels of the sensor, if significant.
pub(super) fn pixels(evidence: &Evidence) -> Option<(Departure, BTreeSet<(u16, u16)>)> {
    let seconds = evidence.blocks.length_us() as f64 * 1e-6;
    let recording = evidence.event_context.recording();
    let Size { width, height } = recording.size();
    let all = recording.len() as f64;
    let (mut hot, mut beyond, mut turned) = (BTreeSet::new(), Vec::new(), 0.0);
    let mut commons = Vec::with_capacity(recording.size().n_pixels());
    for y in 0..height {
        for x in 0..width {
            let spikes = recording.of(x, y);
            let own = spikes.len() as f64;
            let common = common(&evidence.event_context, x, y)?;
            commons.push(common);
            if is_hot(own - common, common, seconds) {
                hot.insert((x, y));
                beyond.push(own - common);
                turned += turns(spikes);
            }
        }
    }
    let n_hot = hot.len();
    let events: f64 = beyond.iter().sum();
    commons.sort_by(f64::total_cmp);
    let fraction = share(&beyond, &commons);
    let departure = Departure {
        id: EffectId::HotPixels,
        parameters: vec![("fraction", fraction)],
        description: format!(
            "{n_hot} pixels have more than four times the rate of their neighbours, {:.1} % of \
             all events",
            100.0 * events / all
        ),
        z: (n_hot as f64).sqrt() * MIN_RATE_RATIO,
        without: None,
    };
    let is_noise = turned > MIN_NOISE_ALTERNATION * n_hot as f64;
    (n_hot >= MIN_HOT_PIXELS && events > MIN_EVENT_SHARE * all && !is_noise)
        .then_some((departure, hot))
}

/// Typical event count of the neighbours; `None` without neighbours.
fn common(around: &EventContext, x: u16, y: u16) -> Option<f64> {
    let among = |reach: u16| {
        let about = around.within(x, y, reach);
        let mut others: Vec<usize> = about.map(<[Spike]>::len).collect();
        others.sort_by(|a, b| b.cmp(a));
        // Beside dead pixels the median is not representative.
        others.get(MAX_HOT_NEIGHBOURS).or(others.last()).copied()
    };
    // Where the direct neighbours are dead the next ring is used.
    let common = among(1).filter(|common| *common > 0).or_else(|| among(2));
    common.map(|common| common as f64)
}

fn is_hot(beyond: f64, common: f64, seconds: f64) -> bool {
    beyond + common > MIN_RATE_RATIO * (common + 2.0) && beyond > MIN_EXCESS_HZ * seconds
}

/// Share of hot pixels with its standard error. A hot pixel can be detected only among quieter
/// neighbours: each detection is weighted by the inverse of that probability (Horvitz and
/// Thompson, 1952). `commons` are the neighbours' counts of all pixels, ascending.
fn share(beyond: &[f64], commons: &[f64]) -> [f64; 2] {
    let n = commons.len() as f64;
    let weight = |beyond: &f64| {
        // The criterion of `is_hot`.
        let most = (beyond - MIN_RATE_RATIO * 2.0) / (MIN_RATE_RATIO - 1.0);
        n / (commons.partition_point(|common| *common < most) as f64).max(1.0)
    };
    let weights: Vec<f64> = beyond.iter().map(weight).collect();
    let square: f64 = weights.iter().map(|weight| weight * weight).sum();
    [weights.iter().sum::<f64>() / n, square.sqrt() / n]
}

/// Share of the events with the polarity opposite to the one before.
fn turns(spikes: &[Spike]) -> f64 {
    let turned = spikes.windows(2).filter(|pair| pair[0].on != pair[1].on).count();
    turned as f64 / (spikes.len() - 1).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::EventsByPixel;
    use evrig_core::event::{Event, Events};
    use evrig_core::stats::SplitMix;

    #[test]
    fn undetectable_hot_pixels_are_estimated_by_weighting() {
        let mut random = SplitMix::new(4, 7);
        let mut z = Vec::new();
        for _ in 0..40 {
            let commons: Vec<f64> = (0..20_000).map(|_| 200.0 * random.uniform()).collect();
            let mut beyond = Vec::new();
            for common in &commons {
                let events = 30.0 * (random.uniform() * 10.0_f64.ln()).exp();
                if random.uniform() < 0.005 && is_hot(events, *common, 1.0) {
                    beyond.push(events);
                }
            }
            let mut commons = commons;
            commons.sort_by(f64::total_cmp);
            let [found, error] = share(&beyond, &commons);
            assert!((beyond.len() as f64) < 0.7 * 0.005 * 20_000.0, "{}", beyond.len());
            z.push((found - 0.005) / error);
        }
        let mean = z.iter().sum::<f64>() / z.len() as f64;
        let spread = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        assert!(mean.abs() < 0.6 && (0.6..1.5).contains(&spread), "{mean} {spread}");
    }

    #[test]
    fn a_pixel_among_dead_ones_is_not_hot() {
        let size = Size::new(9, 9);
        // Every second pixel of every second row is alive, and one in a dead corner.
        let lives = |x: u16, y: u16| x < 6 && x.is_multiple_of(2) && y.is_multiple_of(2);
        let mut events = Events::new();
        for t in 0..40 {
            for (x, y) in (0..9).flat_map(|y| (0..9).map(move |x| (x, y))) {
                if lives(x, y) || (x, y) == (8, 8) {
                    events.push(Event { t: 1_000 * t, x, y, on: true });
                }
            }
        }
        let around =
            EventContext::new(EventsByPixel::new(events.as_slice(), size, [0, 40_000]), &[]);
        assert_eq!([common(&around, 2, 2), common(&around, 1, 2)], [Some(40.0), Some(40.0)]);
        assert_eq!(common(&around, 8, 8), Some(0.0));
    }

    #[test]
    fn polarity_alternates_with_noise_and_not_with_a_leak() {
        let spikes = |on: fn(i64) -> bool| (0..101).map(move |t_us| Spike { t_us, on: on(t_us) });
        let share = |on| turns(&spikes(on).collect::<Vec<_>>());
        assert!((share(|t| t % 2 == 0) - 1.0).abs() < 1e-12);
        assert!(share(|_| true).abs() < 1e-12);
        assert!((share(|t| t / 2 % 2 == 0) - 0.5).abs() < 0.01);
    }
}
