//! Distances between two samples of events.

use crate::diagnose::evidence::event_context::EventContext;
use crate::diagnose::test::boosted_trees::{LabelledEvents, N_FOLDS, classify};
use crate::predict::{EventsByPixel, Spike};
use evrig_core::event::Events;
use evrig_core::geometry::Size;
use evrig_core::stats::SplitMix;

/// Events per sample (work budget).
const MAX_EVENTS: usize = 20_000;

/// Projections of the sliced distance.
const N_DIRECTIONS: usize = 24;

/// Time that counts as a distance of one pixel.
const MICROSECONDS_PER_PIXEL: f64 = 5_000.0;

/// Events per pixel in row-major order.
pub(super) fn counts(events: &Events, size: Size) -> Vec<u32> {
    let mut counts = vec![0; size.n_pixels()];
    events.as_slice().iter().for_each(|e| counts[size.index(e.x, e.y)] += 1);
    counts
}

/// Root mean square difference of counts per pixel, over the recorded mean.
pub(super) fn rmse(real: &[u32], simulated: &[u32]) -> Option<f64> {
    let n = real.len() as f64;
    let mean = real.iter().map(|c| f64::from(*c)).sum::<f64>() / n;
    let square: f64 =
        real.iter().zip(simulated).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (mean > 0.0).then(|| (square / n).sqrt() / mean)
}

/// Sliced Wasserstein distance of two event clouds in space and time, pixels (Bonneel et al., J.
/// Math. Imaging Vis. 51, 2015), averaged over polarities by recorded counts.
pub(super) fn transport_px(
    real: &Events,
    simulated: &Events,
    start_us: i64,
    seed: u64,
) -> Option<f64> {
    let cloud = |events: &Events, on: bool| -> Vec<[f64; 3]> {
        let own = events.as_slice().iter().filter(move |e| e.on == on);
        own.map(|e| {
            [f64::from(e.x), f64::from(e.y), (e.t - start_us) as f64 / MICROSECONDS_PER_PIXEL]
        })
        .collect()
    };
    let (mut sum, mut weight) = (0.0, 0.0);
    for on in [true, false] {
        let (a, b) = (cloud(real, on), cloud(simulated, on));
        if a.len() < 20 || b.len() < 20 {
            continue;
        }
        let mut random = SplitMix::new(seed, 0x736c_6963);
        let mut distance = 0.0;
        for _ in 0..N_DIRECTIONS {
            let d: [f64; 3] = std::array::from_fn(|_| random.normal());
            let length = d.iter().map(|v| v * v).sum::<f64>().sqrt();
            let along = |cloud: &[[f64; 3]]| {
                let project = |p: &[f64; 3]| (p[0] * d[0] + p[1] * d[1] + p[2] * d[2]) / length;
                let mut all: Vec<f64> = cloud.iter().map(project).collect();
                all.sort_by(f64::total_cmp);
                all
            };
            let (p, q) = (along(&a), along(&b));
            let quantile = |all: &[f64], i: usize| {
                evrig_core::stats::quantile_sorted(all, (i as f64 + 0.5) / 200.0)
            };
            distance +=
                (0..200).map(|i| (quantile(&p, i) - quantile(&q, i)).abs()).sum::<f64>() / 200.0;
        }
        sum += distance / N_DIRECTIONS as f64 * a.len() as f64;
        weight += a.len() as f64;
    }
    (weight > 0.0).then_some(sum / weight)
}

/// Accuracy of a classifier two-sample test; 0.5 for equal distributions (Lopez-Paz and Oquab,
/// ICLR 2017).
pub(super) fn c2st_accuracy(
    real: &Events,
    simulated: &Events,
    size: Size,
    window_us: [i64; 2],
) -> Option<f64> {
    const FEATURES: usize = 10;
    let mut examples = LabelledEvents { n_features: FEATURES, ..LabelledEvents::default() };
    for (events, is_real) in [(real, true), (simulated, false)] {
        let by_pixel = EventsByPixel::new(events.as_slice(), size, window_us);
        let around = EventContext::new(by_pixel.clone(), &[]);
        let every = events.len().div_ceil(MAX_EVENTS).max(1);
        let mut number = 0;
        for y in 0..size.height {
            for x in 0..size.width {
                let spikes = by_pixel.of(x, y);
                for (i, spike) in spikes.iter().enumerate() {
                    number += 1;
                    if number % every != 0 {
                        continue;
                    }
                    let before = i.checked_sub(1).map(|j| spikes[j]);
                    let second = i.checked_sub(2).map(|j| spikes[j]);
                    let since =
                        |s: Option<Spike>| s.map_or(f32::NAN, |s| (spike.t_us - s.t_us) as f32);
                    let turned = before.map_or(f32::NAN, |s| f32::from(u8::from(s.on != spike.on)));
                    let (near_us, n_near) = around.neighbours(x, y, spike.t_us, 5_000);
                    let block = (spike.t_us / 200_000) as u32;
                    let tile = u32::from(x / 16) + 64 * u32::from(y / 16);
                    examples.features.extend([
                        since(before),
                        since(second),
                        f32::from(u8::from(spike.on)),
                        turned,
                        near_us as f32,
                        n_near as f32,
                        around.row_us(x, y, spike.t_us) as f32,
                        f32::from(x),
                        f32::from(y),
                        spike.t_us as f32 * 1e-6,
                    ]);
                    examples.is_real.push(is_real);
                    examples.cell.push(tile);
                    examples.fold.push(((tile + block) % u32::from(N_FOLDS)) as u8);
                }
            }
        }
    }
    classify(&examples).map(|result| result.accuracy)
}

/// Share of the intervals in each bin.
pub(super) fn interval_shares(
    events: &Events,
    size: Size,
    window_us: [i64; 2],
    edges: &[f64],
) -> Vec<f64> {
    let by_pixel = EventsByPixel::new(events.as_slice(), size, window_us);
    let mut counts = vec![0.0; edges.len().saturating_sub(1)];
    let mut n = 0.0_f64;
    for y in 0..size.height {
        for x in 0..size.width {
            for pair in by_pixel.of(x, y).windows(2) {
                let decades = ((pair[1].t_us - pair[0].t_us).max(1) as f64).log10();
                let bin = edges.partition_point(|edge| *edge <= decades);
                if let Some(count) = bin.checked_sub(1).and_then(|bin| counts.get_mut(bin)) {
                    *count += 1.0;
                }
                n += 1.0;
            }
        }
    }
    counts.iter_mut().for_each(|count| *count /= n.max(1.0));
    counts
}
