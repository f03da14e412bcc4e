//! Effects of pixels, readout and clocks, applied to events.

use super::recording::PlasmodeRecording;
use evrig_analysis::filter::{FilterError, hot_pixel, refractory};
use evrig_core::event::{Event, Events};
use evrig_core::stats::SplitMix;

/// A refractory period after each event of a pixel.
pub(super) fn refractory(
    recording: &mut PlasmodeRecording,
    period_us: f64,
) -> Result<(), FilterError> {
    let slice = recording.events.as_slice();
    recording.events = refractory::filter(slice, recording.size, period_us as i64)?.events;
    Ok(())
}

/// A share of the events is lost, each for itself.
pub(super) fn drop_share(recording: &mut PlasmodeRecording, fraction: f64, random: &mut SplitMix) {
    keep(recording, |_| random.uniform() >= fraction);
}

/// Some of the pixels never fire.
pub(super) fn kill_pixels(
    recording: &mut PlasmodeRecording,
    count: f64,
    random: &mut SplitMix,
) -> Result<(), FilterError> {
    let mut order: Vec<usize> = (0..recording.size.n_pixels()).collect();
    let n_dead = (count.max(0.0) as usize).min(order.len());
    for i in 0..n_dead {
        let j = i + random.below(order.len() - i);
        order.swap(i, j);
    }
    let slice = recording.events.as_slice();
    let kept = hot_pixel::drop_pixels(slice, recording.size, &order[..n_dead])?;
    recording.events = kept.events;
    Ok(())
}

/// `n` pixels fire at random besides, ON or OFF alike, each at a rate.
pub(super) fn heat_pixels(
    recording: &mut PlasmodeRecording,
    n: f64,
    rate_hz: f64,
    random: &mut SplitMix,
) {
    let slice = recording.events.as_slice();
    let (Some(&first), Some(&last)) = (slice.t.first(), slice.t.last()) else { return };
    let size = recording.size;
    let (width, n_pixels) = (usize::from(size.width), size.n_pixels());
    let n = (n.max(0.0) as usize).min(n_pixels);
    let is_everywhere = n == n_pixels;
    for i in 0..n {
        let pixel = if is_everywhere { i } else { random.below(n_pixels) };
        let mut t = first as f64;
        loop {
            // Waiting times of a Poisson process.
            t += 1e6 / rate_hz * random.exponential();
            if t > last as f64 {
                break;
            }
            let (x, y) = ((pixel % width) as u16, (pixel / width) as u16);
            recording.events.push(Event { t: t as i64, x, y, on: random.bits() >> 63 == 1 });
        }
    }
    recording.events.sort_by_time();
}

/// Every pixel fires in pairs of opposite polarity besides, as a comparator does that follows noise
/// there and back; `rate_hz` counts events, a pair's second one comes `lag_us` later in the mean.
pub(super) fn alternate(
    recording: &mut PlasmodeRecording,
    rate_hz: f64,
    lag_us: f64,
    random: &mut SplitMix,
) {
    let slice = recording.events.as_slice();
    let (Some(&first), Some(&last)) = (slice.t.first(), slice.t.last()) else { return };
    for y in 0..recording.size.height {
        for x in 0..recording.size.width {
            let mut t = first as f64;
            loop {
                t += 2e6 / rate_hz * random.exponential();
                let back = t + lag_us * random.exponential();
                if back > last as f64 {
                    break;
                }
                let on = random.bits() >> 63 == 1;
                recording.events.push(Event { t: t as i64, x, y, on });
                recording.events.push(Event { t: back as i64, x, y, on: !on });
            }
        }
    }
    recording.events.sort_by_time();
}

/// Everything is lost in windows that together are a share of the time.
pub(super) fn drop_bursts(
    recording: &mut PlasmodeRecording,
    share: f64,
    window_us: f64,
    random: &mut SplitMix,
) {
    let mut windows: std::collections::BTreeMap<i64, bool> = std::collections::BTreeMap::new();
    keep(recording, |e| {
        let window = (e.t as f64 / window_us).floor() as i64;
        !*windows.entry(window).or_insert_with(|| random.uniform() < share)
    });
}

/// Every stamp has a normal error of its own.
pub(super) fn jitter(recording: &mut PlasmodeRecording, sigma_us: f64, random: &mut SplitMix) {
    stamp(recording, |t| t + (sigma_us * random.normal()).round() as i64);
}

/// The stamps are late by an offset that grows with a skew from the first event on.
pub(super) fn retime(recording: &mut PlasmodeRecording, offset_us: f64, skew_ppm: f64) {
    let Some(&first) = recording.events.as_slice().t.first() else { return };
    let late = |t: i64| offset_us + (t - first) as f64 * skew_ppm * 1e-6;
    stamp(recording, |t| t + late(t).round() as i64);
}

fn keep(recording: &mut PlasmodeRecording, mut is_kept: impl FnMut(Event) -> bool) {
    let mut kept = Events::with_capacity(recording.events.len());
    recording.events.as_slice().iter().filter(|&e| is_kept(e)).for_each(|e| kept.push(e));
    recording.events = kept;
}

fn stamp(recording: &mut PlasmodeRecording, mut new: impl FnMut(i64) -> i64) {
    let mut changed = Events::with_capacity(recording.events.len());
    recording.events.as_slice().iter().for_each(|e| changed.push(Event { t: new(e.t), ..e }));
    changed.sort_by_time();
    recording.events = changed;
}
