//! From which interval on a pixel fires again: the hazard of the interval between two events of a
//! pixel, for each pair of polarities, against a level baseline.
//!
//! Without a refractory period the hazard does not rise with the interval: it is constant for
//! noise, and falls where activity comes in bursts. A lag below which events are missing against
//! the lags just above is an onset. Its form is fitted as `h Phi(ln(t/T)/s)`: at the period `T` the
//! hazard is half of its highest value.

use super::chance::{HALF_LEVEL_Z, LEVEL, excess_z, normal_tail};
use super::interval_counts::{
    AFTER_BURST, AFTER_OFF, AFTER_ON, EventHalf, IntervalCounts, LagCounts, N_LAGS,
};
use super::onset_fit::{OnsetFit, fit, period_with_width};
use super::{PolarityName, SectionResult};
use evrig_core::stats::Estimate;
use serde::Serialize;

/// Trial lags per octave. Each is one of the tests for which the level is corrected.
const TRIALS_PER_OCTAVE: f64 = 6.0;

/// Fewest intervals of a pair: with fewer, none missing below any lag is significant at the
/// corrected level (a share of 1/2 each, 1e-2 over some 500 tests: 2^-16).
const MIN_INTERVALS: u64 = 20;

/// An onset is hard when its hazard rises from 10 to 90 % within this share of the period, or
/// within the stamps' resolution. A definition: circuits that count a fixed time give a few percent.
const MAX_HARD_WIDTH: f64 = 0.1;

/// Steps of the stamps within which a rise is not resolved.
const RESOLUTION_STEPS: f64 = 3.0;

/// Shortest intervals that are listed. The last of them bounds a period that the data do not show:
/// duplicated events are fewer.
const N_SHORTEST: usize = 5;

/// What precedes an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum IntervalOrigin {
    /// An ON event.
    On,
    /// An OFF event.
    Off,
    /// An event of a burst that follows the camera's frames.
    FrameBurst,
}

/// Form of an onset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnsetShape {
    /// No lag below which events are missing.
    Absent,
    /// No events below the period, and all from it on.
    Hard,
    /// The hazard rises slowly.
    Soft,
}

/// How the hazard of an interval begins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RefractoryOnset {
    /// What begins the interval.
    pub after: IntervalOrigin,
    /// Polarity of the event that ends it.
    pub to: PolarityName,
    /// Intervals, up to the longest lag.
    pub n_intervals: u64,
    /// The shortest ones, µs.
    pub shortest_us: Vec<f64>,
    /// Form of the onset.
    pub shape: OnsetShape,
    /// Interval at which the hazard is half of its highest value, µs.
    pub period_us: Estimate,
    /// Time in which it rises from 10 to 90 %, µs.
    pub width_us: Estimate,
    /// Intervals at which the hazard is 10 and 90 % of its highest value, µs.
    pub rise_us: [f64; 2],
    /// Whether the period agrees, within three standard errors, between the halves of the time and
    /// of the pixels. A circuit's period does; one that the scene sets need not.
    pub is_stable: bool,
    /// Largest period that the data allow where they show none, µs.
    pub upper_bound_us: Option<f64>,
    /// Deficit below the onset, standard errors.
    pub z: f64,
    /// Probability of such a deficit by chance, over all lags and pairs.
    pub false_alarm_probability: f64,
    /// The period in the first and second half of the time, and the colours of a checkerboard.
    pub halves_us: [Estimate; 4],
    /// Hazard by interval, for plots.
    pub hazard: Vec<HazardBin>,
}

/// Events per second of waiting, for intervals of some length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HazardBin {
    /// Interval from and to, µs.
    pub from_us: f64,
    /// End of the range, µs.
    pub to_us: f64,
    /// Events.
    pub n: u64,
    /// Events per second of waiting.
    pub hz: f64,
}

/// The onset of each pair; pairs with a burst only where `with_bursts`.
pub(super) fn onsets(
    intervals: &IntervalCounts,
    with_bursts: bool,
) -> Vec<SectionResult<RefractoryOnset>> {
    let origins: &[(usize, IntervalOrigin)] = &[
        (AFTER_ON, IntervalOrigin::On),
        (AFTER_OFF, IntervalOrigin::Off),
        (AFTER_BURST, IntervalOrigin::FrameBurst),
    ];
    let origins = if with_bursts { origins } else { &origins[..2] };
    let pairs = origins.iter().flat_map(|origin| [(origin, true), (origin, false)]);
    pairs.map(|((class, after), on)| onset(intervals, *class, *after, on)).collect()
}

fn onset(
    intervals: &IntervalCounts,
    class: usize,
    after: IntervalOrigin,
    to_on: bool,
) -> SectionResult<RefractoryOnset> {
    let lags = intervals.pair(class, to_on, EventHalf::All);
    let to = PolarityName::of(to_on);
    let n_intervals = lags.n_events();
    if n_intervals < MIN_INTERVALS {
        return SectionResult::not_measured(format!(
            "too few intervals from {} to {to} for a refractory period: {n_intervals}, at least \
             {MIN_INTERVALS} are needed",
            after.words()
        ));
    }
    let step = intervals.step_us;
    let shortest_us: Vec<f64> =
        lags.shortest(N_SHORTEST).into_iter().map(|lag| lag as f64 * step).collect();
    let first_lag = usize::from(step > 1.0);
    let (deficit, false_alarm_probability) = largest_deficit(&lags, first_lag);
    let mut found = RefractoryOnset {
        after,
        to,
        n_intervals,
        shape: OnsetShape::Absent,
        period_us: Estimate::unknown(),
        width_us: Estimate::unknown(),
        rise_us: [f64::NAN; 2],
        is_stable: true,
        upper_bound_us: shortest_us.last().map(|us| us.max(step)),
        shortest_us,
        z: deficit.z.min(0.0),
        false_alarm_probability,
        halves_us: std::array::from_fn(|_| Estimate::unknown()),
        hazard: hazard(&lags, first_lag, step),
    };
    if false_alarm_probability > LEVEL {
        return SectionResult::Known(found);
    }
    if let Some(fit) = fit(&lags, deficit.lag, first_lag) {
        found.upper_bound_us = None;
        found.shape = shape(&fit);
        found.period_us = scaled(&fit.period, step);
        found.width_us = scaled(&fit.width, step);
        found.rise_us = fit.rise().map(|lag| lag * step);
        found.halves_us = EventHalf::HALVES.map(|half| {
            let lags = intervals.pair(class, to_on, half);
            scaled(&period_with_width(&lags, &fit, first_lag), step)
        });
        found.is_stable = found.halves_us.chunks(2).all(|pair| agree(&pair[0], &pair[1]));
    }
    SectionResult::Known(found)
}

/// Whether two estimates agree; an estimate without an error agrees with any.
fn agree(a: &Estimate, b: &Estimate) -> bool {
    let error = a.standard_error.hypot(b.standard_error);
    !error.is_finite() || (a.value - b.value).abs() <= HALF_LEVEL_Z * error
}

fn scaled(lags: &Estimate, step_us: f64) -> Estimate {
    let ci90 = lags.ci90.map(|lag| lag * step_us);
    Estimate::with_interval(lags.value * step_us, lags.standard_error * step_us, ci90, lags.n)
}

fn shape(fit: &OnsetFit) -> OnsetShape {
    let resolved = RESOLUTION_STEPS.max(MAX_HARD_WIDTH * fit.period.value);
    if fit.width.value <= resolved { OnsetShape::Hard } else { OnsetShape::Soft }
}

/// The lag below which events are missing most.
#[derive(Debug, Clone, Copy)]
struct LagDeficit {
    lag: usize,
    z: f64,
}

/// The largest deficit below a lag against the octave above it, and its probability by chance.
fn largest_deficit(lags: &LagCounts, first_lag: usize) -> (LagDeficit, f64) {
    let mut worst = LagDeficit { lag: 1, z: 0.0 };
    let mut n_trials = 0.0;
    for lag in trial_lags(first_lag) {
        let (below, time_below) = lags.between(first_lag, lag);
        let (above, time_above) = lags.between(lag, 2 * lag);
        if time_above <= 0.0 || time_below <= 0.0 {
            continue;
        }
        n_trials += 1.0;
        let z = excess_z(below, above, time_below / time_above);
        if z < worst.z {
            worst = LagDeficit { lag, z };
        }
    }
    // Four pairs of polarities are tested.
    (worst, (4.0 * n_trials * normal_tail(-worst.z)).min(1.0))
}

fn trial_lags(first_lag: usize) -> impl Iterator<Item = usize> {
    let n = ((N_LAGS as f64 / 2.0).log2() * TRIALS_PER_OCTAVE) as i32;
    let lags = (0..n).map(|i| 2_f64.powf(f64::from(i) / TRIALS_PER_OCTAVE).round() as usize);
    let mut last = first_lag;
    lags.filter(move |lag| {
        let is_new = *lag > last;
        last = last.max(*lag);
        is_new
    })
}

/// Hazard in bins of a sixth of an octave.
fn hazard(lags: &LagCounts, first_lag: usize, step: f64) -> Vec<HazardBin> {
    let edges: Vec<usize> = std::iter::once(first_lag).chain(trial_lags(first_lag)).collect();
    let bins = edges.windows(2).map(|edge| {
        let (n, time) = lags.between(edge[0], edge[1]);
        HazardBin {
            from_us: (edge[0] as f64 - 0.5).max(0.0) * step,
            to_us: (edge[1] as f64 - 0.5) * step,
            n: n as u64,
            hz: if time > 0.0 { n / (time * step * 1e-6) } else { 0.0 },
        }
    });
    bins.collect()
}

impl IntervalOrigin {
    /// What precedes an interval, in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::On => "ON",
            Self::Off => "OFF",
            Self::FrameBurst => "an event of a frame burst",
        }
    }
}
