//! What the effects' tests share: a made light, and the events of a few pixels in it.

use super::{EffectSet, RecordingContext};
use crate::forward::{ForwardParameters, ForwardSimulator};
use crate::voltmeter::Coefficients;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;

pub(super) const SIZE: Size = Size { width: 60, height: 40 };

/// Log intensity over white by place (pixels) and time (seconds).
pub(super) struct SyntheticDrive<F>(F);

pub(super) fn synthetic<F: Fn([f64; 2], f64) -> f64 + Send + Sync>(f: F) -> SyntheticDrive<F> {
    SyntheticDrive(f)
}

impl<F: Fn([f64; 2], f64) -> f64 + Send + Sync> Drive for SyntheticDrive<F> {
    fn size(&self) -> Size {
        SIZE
    }

    fn span_us(&self) -> [i64; 2] {
        [i64::MIN / 2, i64::MAX / 2]
    }

    fn white_dn(&self) -> f64 {
        200.0
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        for (i, out) in out.iter_mut().enumerate() {
            *out = self.0(place, grid.at(i) as f64 * 1e-6) as f32;
        }
        true
    }

    fn error(&self, _place: [f64; 2]) -> f32 {
        f32::NAN
    }
}

/// A light that does not change.
pub(super) fn still(level: f64) -> SyntheticDrive<impl Fn([f64; 2], f64) -> f64 + Send + Sync> {
    synthetic(move |_, _| level)
}

/// Stripes that pass at `hz`, of amplitude 0.5 in log intensity about a level.
pub(super) fn passing(
    hz: f64,
    level: f64,
) -> SyntheticDrive<impl Fn([f64; 2], f64) -> f64 + Send + Sync> {
    synthetic(move |[x, _], t| level + 0.5 * (std::f64::consts::TAU * (hz * t + x / 16.0)).sin())
}

/// The events of the whole sensor in `seconds`, with five thresholds a unit of log intensity and
/// no leak or noise but that of the effects.
pub(super) fn events(light: &dyn Drive, seconds: f64, words: &[&str]) -> Vec<Event> {
    events_in(light, seconds, words, RecordingContext::default())
}

pub(super) fn events_in(
    light: &dyn Drive,
    seconds: f64,
    words: &[&str],
    context: RecordingContext,
) -> Vec<Event> {
    let k = Coefficients::new([5.0, 1e-9, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let effects = EffectSet::from_words(words).unwrap();
    let parameters = ForwardParameters { k, effects, step_us: 500 };
    let forward = ForwardSimulator::new(parameters, context).unwrap();
    let pixels: Vec<(u16, u16)> =
        (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (x, y))).collect();
    let window = [0, (seconds * 1e6) as i64];
    let found = forward.run(light, &pixels, window, 11).unwrap();
    assert_eq!(found.events.as_slice().first_disorder(), None);
    to_vec(&found.events)
}

pub(super) fn to_vec(events: &Events) -> Vec<Event> {
    events.as_slice().iter().collect()
}

/// Times between events of one pixel, µs.
pub(super) fn intervals(events: &[Event]) -> Vec<i64> {
    let mut last = std::collections::HashMap::new();
    let mut found = Vec::new();
    for event in events {
        if let Some(before) = last.insert((event.x, event.y), event.t) {
            found.push(event.t - before);
        }
    }
    found
}

/// Share of events that are ON.
pub(super) fn share_on(events: &[Event]) -> f64 {
    events.iter().filter(|event| event.on).count() as f64 / events.len() as f64
}

/// Share of a pixel's events whose side is not that of the event before.
pub(super) fn alternation(events: &[Event]) -> f64 {
    let mut last = std::collections::HashMap::new();
    let (mut n, mut turned) = (0.0, 0.0);
    for event in events {
        if let Some(before) = last.insert((event.x, event.y), event.on) {
            n += 1.0;
            turned += f64::from(before != event.on);
        }
    }
    turned / n
}

/// Counts of each pixel, row-major.
pub(super) fn counts(events: &[Event]) -> Vec<f64> {
    let mut counts = vec![0.0; SIZE.n_pixels()];
    events.iter().for_each(|event| counts[SIZE.index(event.x, event.y)] += 1.0);
    counts
}

/// Mean and standard deviation.
pub(super) fn mean_and_sd(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let values: Vec<f64> = values.into_iter().collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// Mean time by which the events of `late` come behind those of `early`, matched one by one in
/// each pixel, µs.
pub(super) fn mean_lag(early: &[Event], late: &[Event]) -> f64 {
    let by_pixel = |events: &[Event]| {
        let mut all = std::collections::BTreeMap::<_, Vec<i64>>::new();
        events.iter().for_each(|e| all.entry((e.y, e.x, e.on)).or_default().push(e.t));
        all
    };
    let (early, late) = (by_pixel(early), by_pixel(late));
    let lags = early.iter().flat_map(|(pixel, early)| {
        let late = late.get(pixel).map_or(&[][..], Vec::as_slice);
        early.iter().zip(late).map(|(a, b)| (b - a) as f64).collect::<Vec<_>>()
    });
    mean_and_sd(lags).0
}

/// By how much the events of `late` come behind those of `early` in light of frequency `hz`, from
/// the phase of each pixel's ON events, µs.
pub(super) fn phase_lag(early: &[Event], late: &[Event], hz: f64) -> f64 {
    let phases = |events: &[Event]| {
        let mut all = vec![[0.0; 2]; SIZE.n_pixels()];
        for event in events.iter().filter(|event| event.on) {
            let (sin, cos) = (std::f64::consts::TAU * hz * event.t as f64 * 1e-6).sin_cos();
            let sum = &mut all[SIZE.index(event.x, event.y)];
            *sum = [sum[0] + cos, sum[1] + sin];
        }
        all
    };
    let turned = phases(early)
        .into_iter()
        .zip(phases(late))
        .map(|([a, b], [c, d])| [a * c + b * d, a * d - b * c]);
    let [re, im] = turned.fold([0.0; 2], |[re, im], [x, y]| [re + x, im + y]);
    im.atan2(re) / (std::f64::consts::TAU * hz) * 1e6
}

/// The light of a pixel behind effects.
pub(super) fn signal_behind(
    light: &dyn Drive,
    words: &[&str],
    context: RecordingContext,
) -> Vec<f32> {
    let k = Coefficients::DVS346;
    let parameters =
        ForwardParameters { k, effects: EffectSet::from_words(words).unwrap(), step_us: 500 };
    let forward = ForwardSimulator::new(parameters, context).unwrap();
    let grid = TimeGrid { start_us: 0, step_us: 500, n: 2_000 };
    forward.comparator_signal(light, 20, 10, grid).unwrap()
}
