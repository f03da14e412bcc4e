//! Events that follow the camera's own frames: bursts at a delay after each frame's start that is
//! constant or linear in the row, as the readout of the frames sweeps over the rows.
//!
//! A burst is reported if it is too large for chance over everything that was searched (level
//! [`LEVEL`]), both by the number of its events and by its excess frame by frame, and if it is
//! there in either half of the time and either half of the pixels.

use super::burst_profile::{ProfileBin, profile};
use super::burst_shape::{BurstShape, shape};
use super::burst_wake::{BurstWake, wake};
use super::chance::{HALF_LEVEL_Z, LEVEL, binomial_tail, excess_z, normal_tail, student_tail};
use super::frame_fold::{FrameFold, FrameReference, FrameStarts};
use super::shear_search::{GUARD_BINS, PhaseTable, SIDE_BINS};
use super::{PolarityName, SectionResult};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::{Estimate, Moments};
use serde::Serialize;

/// Fewest frames whose scatter gives an error.
const MIN_FRAMES: usize = 5;

/// Fewest events of a polarity: below, no excess of a few percent is significant over a search of
/// millions of windows.
const MIN_EVENTS: usize = 200;

/// Candidates that are tested per polarity: a work budget.
const MAX_CANDIDATES: usize = 12;

/// Phase bins when cycles are compared: a sixteenth of the work of the search.
const N_COARSE_BINS: f64 = 512.0;

/// Without frames a burst differs from a lamp, which lights all rows at once, by its sweep: over
/// all rows it takes longer than this many of its widths.
const MIN_SWEEP_WIDTHS: f64 = 3.0;

/// What the events show of the camera's frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameCoupling {
    /// What delays count from.
    pub reference: FrameReference,
    /// Median time between frames, µs.
    pub frame_period_us: f64,
    /// Frames during the events.
    pub n_frames: usize,
    /// Events within a frame's cycle: ON, OFF.
    pub n_events: [u64; 2],
    /// Windows that were compared, per polarity.
    pub n_trials: f64,
    /// Accepted bursts, largest excess first, ON before OFF.
    pub bursts: Vec<CouplingBurst>,
    /// Candidates that chance does not explain but a check rejects.
    pub rejected: Vec<RejectedBurst>,
}

/// Events at a fixed delay after each frame's start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CouplingBurst {
    /// Polarity of its events.
    pub polarity: PolarityName,
    /// Delay at row 0 after the frame's start, µs, within a frame period.
    pub delay_us: Estimate,
    /// Delay per row, µs; negative where the last row comes first.
    pub row_us: Estimate,
    /// Time that holds 90 % of its events at a row, µs.
    pub width_us: Estimate,
    /// Share of the polarity's events.
    pub share: Estimate,
    /// Share of the other polarity's events at the same place.
    pub other_polarity_share: Estimate,
    /// Excess over the background, in standard errors of the background's count.
    pub z: f64,
    /// Mean excess per frame, in standard errors from frame to frame.
    pub frames_z: f64,
    /// Probability of such a burst anywhere in the search by chance.
    pub false_alarm_probability: f64,
    /// Share of the polarity's events in the first and second half of the time, and in the two
    /// colours of a checkerboard of pixels.
    pub halves: [Estimate; 4],
    /// Excess in these halves, standard errors.
    pub halves_z: [f64; 4],
    /// The rate of the same polarity after the burst, where it differs.
    pub wake: Option<BurstWake>,
    /// Times about the line that hold the burst, µs.
    pub window_us: [f64; 2],
    /// Events about the line, for plots.
    pub profile: Vec<ProfileBin>,
}

/// A candidate and the check that rejects it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RejectedBurst {
    /// Polarity of its events.
    pub polarity: PolarityName,
    /// Delay at row 0, µs.
    pub delay_us: f64,
    /// Delay per row, µs.
    pub row_us: f64,
    /// Which check, in a few words.
    pub reason: String,
}

/// Counts in a burst's window and in its surroundings before and after.
#[derive(Debug, Clone, Copy, Default)]
struct WindowCounts {
    inside: f64,
    before: f64,
    after: f64,
}

/// Counts of one polarity by frame and by half.
struct BurstCounts {
    frames: Vec<WindowCounts>,
    halves: [WindowCounts; 4],
    half_events: [u64; 4],
    n_events: u64,
    total: WindowCounts,
}

/// Searches both polarities for bursts. `step_us` is the step of the stamps, `n_cycles` the number
/// of frame cycles among which `frames` was chosen by the events.
pub(super) fn coupling(
    events: EventSlice<'_>,
    size: Size,
    frames: &FrameStarts,
    step_us: f64,
    n_cycles: f64,
) -> SectionResult<FrameCoupling> {
    let frames = frames.during(events.t);
    let fold = match FrameFold::new(&frames, MIN_FRAMES) {
        SectionResult::Known(fold) => fold,
        SectionResult::NotMeasured { not_measured } => {
            return SectionResult::NotMeasured { not_measured };
        }
    };
    let mut n_events = [0; 2];
    fold.visit(events.t, |i, _, _| n_events[usize::from(!events.on[i])] += 1);
    if n_events.iter().all(|n| *n < MIN_EVENTS as u64) {
        return SectionResult::not_measured(format!(
            "too few events for coupling to the frames: {} within the frames' cycles, at least \
             {MIN_EVENTS} of a polarity are needed",
            n_events[0] + n_events[1]
        ));
    }
    let mut found = FrameCoupling {
        reference: frames.reference,
        frame_period_us: fold.period_us,
        n_frames: fold.starts.len(),
        n_events,
        n_trials: 0.0,
        bursts: Vec::new(),
        rejected: Vec::new(),
    };
    let searched = |on: bool| {
        let is_enough = n_events[usize::from(!on)] >= MIN_EVENTS as u64;
        is_enough.then(|| search(events, size, &fold, on, [step_us, n_cycles])).flatten()
    };
    let (on, off) = rayon::join(|| searched(true), || searched(false));
    for of_polarity in [on, off].into_iter().flatten() {
        found.n_trials = of_polarity.n_trials;
        found.bursts.extend(of_polarity.bursts);
        found.rejected.extend(of_polarity.rejected);
    }
    SectionResult::Known(found)
}

/// The largest excess over one cycle, at a coarse resolution: to choose among cycles. A multiple of
/// the true cycle divides a burst, a part of it adds the background of the whole.
pub(super) fn strength(events: EventSlice<'_>, size: Size, cycle: &FrameStarts) -> f64 {
    let SectionResult::Known(fold) = FrameFold::new(cycle, MIN_FRAMES) else { return 0.0 };
    let step_us = fold.period_us / N_COARSE_BINS;
    let excess = |on| {
        let table = PhaseTable::new(events, size, &fold, on, step_us);
        let best = if table.is_searchable() { table.best() } else { None };
        best.map_or(0.0, |best| best.z)
    };
    let (on, off) = rayon::join(|| excess(true), || excess(false));
    on.max(off)
}

/// What one polarity shows.
struct PolaritySearch {
    n_trials: f64,
    bursts: Vec<CouplingBurst>,
    rejected: Vec<RejectedBurst>,
}

/// `None` where no window with its surroundings fits into the cycle.
fn search(
    events: EventSlice<'_>,
    size: Size,
    fold: &FrameFold<'_>,
    on: bool,
    [step_us, n_cycles]: [f64; 2],
) -> Option<PolaritySearch> {
    let mut table = PhaseTable::new(events, size, fold, on, step_us);
    if !table.is_searchable() {
        return None;
    }
    let n_trials = n_cycles * table.n_trials();
    let (mut bursts, mut rejected) = (Vec::<CouplingBurst>::new(), Vec::new());
    for _ in 0..MAX_CANDIDATES {
        let Some(best) = table.best() else { break };
        if n_trials * normal_tail(best.z) > LEVEL {
            break;
        }
        let Some(shape) = shape(events, size, fold, on, &best, table.bin_us) else {
            table.remove(best.delay_us, best.row_us, best.width_us);
            continue;
        };
        let [delay, row] = [shape.delay_us.value, shape.row_us.value];
        let half_us = shape.window_us[0].abs().max(shape.window_us[1].abs());
        table.remove(best.delay_us, best.row_us, 0.5 * best.width_us);
        table.remove(delay, row, half_us);
        let polarity = PolarityName::of(on);
        match measure(events, fold, on, &shape, table.bin_us, n_trials) {
            Ok(burst) if fold.reference == FrameReference::FoundPeriod && is_lamp(&burst, size) => {
                let reason = "all rows at once, as a lamp flickers";
                rejected.push(RejectedBurst::new(polarity, &shape, reason));
            }
            Ok(burst) => bursts.push(burst),
            Err(reason) => rejected.push(RejectedBurst::new(polarity, &shape, reason)),
        }
    }
    bursts.sort_by(|a, b| b.share.value.total_cmp(&a.share.value));
    Some(PolaritySearch { n_trials, bursts, rejected })
}

fn is_lamp(burst: &CouplingBurst, size: Size) -> bool {
    let sweep_us = burst.row_us.value.abs() * f64::from(size.height);
    sweep_us < MIN_SWEEP_WIDTHS * burst.width_us.value
}

impl RejectedBurst {
    fn new(polarity: PolarityName, shape: &BurstShape, reason: &str) -> Self {
        let [delay_us, row_us] = [shape.delay_us.value, shape.row_us.value];
        Self { polarity, delay_us, row_us, reason: reason.to_owned() }
    }
}

/// Size and significance of a burst, or which check rejects it.
fn measure(
    events: EventSlice<'_>,
    fold: &FrameFold<'_>,
    on: bool,
    shape: &BurstShape,
    bin_us: f64,
    n_trials: f64,
) -> Result<CouplingBurst, &'static str> {
    let side_us = SIDE_BINS as f64 * bin_us;
    let length_us = shape.window_us[1] - shape.window_us[0];
    let ratio = length_us / side_us;
    let own = BurstCounts::count(events, fold, on, shape, bin_us);
    // What follows a burst may be depleted, what precedes it by an edge of the light enhanced.
    let is_before = own.total.before >= own.total.after;
    let outside = |counts: &WindowCounts| if is_before { counts.before } else { counts.after };
    let excess = |counts: &WindowCounts| counts.inside - ratio * outside(counts);
    let mut by_frame = Moments::default();
    own.frames.iter().for_each(|counts| by_frame.push(excess(counts)));
    let frames_z = by_frame.mean() / by_frame.standard_error();
    let [inside, about] = [own.total.inside, outside(&own.total)];
    let chance = binomial_tail(inside as u64, (inside + about) as u64, ratio / (1.0 + ratio));
    let frames_chance = student_tail(frames_z, own.frames.len() as f64 - 1.0);
    let false_alarm_probability = (n_trials * chance.max(frames_chance)).min(1.0);
    if false_alarm_probability > LEVEL {
        return Err("its excess varies too much from frame to frame");
    }
    let halves_z: [f64; 4] = std::array::from_fn(|half| {
        let counts = &own.halves[half];
        excess_z(counts.inside, outside(counts), ratio)
    });
    if halves_z.iter().any(|z| *z < HALF_LEVEL_Z) {
        return Err("it is missing in one half of the time or of the pixels");
    }
    let n = own.n_events as f64;
    let error = by_frame.standard_error() * own.frames.len() as f64 / n;
    let share_of = |counts: &WindowCounts, n_events: u64| {
        share(counts.inside, ratio * outside(counts), ratio, n_events)
    };
    let other = BurstCounts::count(events, fold, !on, shape, bin_us);
    let background = (ratio * about).max(1.0);
    Ok(CouplingBurst {
        polarity: PolarityName::of(on),
        delay_us: Estimate::normal(
            shape.delay_us.value.rem_euclid(fold.period_us),
            shape.delay_us.standard_error,
            shape.delay_us.n,
        ),
        row_us: shape.row_us,
        width_us: shape.width_us,
        share: Estimate::normal(excess(&own.total) / n, error, own.n_events),
        other_polarity_share: share_of(&other.total, other.n_events),
        z: excess(&own.total) / (background * (1.0 + ratio)).sqrt(),
        frames_z,
        false_alarm_probability,
        halves: std::array::from_fn(|i| share_of(&own.halves[i], own.half_events[i])),
        halves_z,
        wake: wake(events, fold, on, shape),
        window_us: shape.window_us,
        profile: profile(events, fold, shape),
    })
}

/// Share of an excess over an expected background, whose window is `ratio` times as long as the
/// surroundings that gave it.
fn share(inside: f64, expected: f64, ratio: f64, n_events: u64) -> Estimate {
    let n = n_events.max(1) as f64;
    let error = (inside + ratio * expected).sqrt() / n;
    Estimate::normal((inside - expected) / n, error, n_events)
}

impl BurstCounts {
    fn count(
        events: EventSlice<'_>,
        fold: &FrameFold<'_>,
        on: bool,
        shape: &BurstShape,
        bin_us: f64,
    ) -> Self {
        let [low, high] = shape.window_us;
        let [guard_us, side_us] = [GUARD_BINS, SIDE_BINS].map(|n| n as f64 * bin_us);
        let [delay, row] = [shape.delay_us.value, shape.row_us.value];
        let mut counts = Self {
            frames: vec![WindowCounts::default(); fold.starts.len()],
            halves: [WindowCounts::default(); 4],
            half_events: [0; 4],
            n_events: 0,
            total: WindowCounts::default(),
        };
        let n_frames = fold.starts.len();
        fold.visit(events.t, |i, frame, since| {
            if events.on[i] != on {
                return;
            }
            let residual = fold.wrap(since - delay - row * f64::from(events.y[i]));
            let halves = [
                usize::from(2 * frame >= n_frames),
                2 + usize::from((events.x[i] ^ events.y[i]) & 1),
            ];
            counts.n_events += 1;
            halves.iter().for_each(|half| counts.half_events[*half] += 1);
            let mut add = |of: &dyn Fn(&mut WindowCounts)| {
                of(&mut counts.total);
                of(&mut counts.frames[frame]);
                halves.iter().for_each(|half| of(&mut counts.halves[*half]));
            };
            if (low..high).contains(&residual) {
                add(&|counts| counts.inside += 1.0);
            } else if (low - guard_us - side_us..low - guard_us).contains(&residual) {
                add(&|counts| counts.before += 1.0);
            } else if (high + guard_us..high + guard_us + side_us).contains(&residual) {
                add(&|counts| counts.after += 1.0);
            }
        });
        counts
    }
}

impl FrameCoupling {
    /// Whether each event is in one of the bursts, or within its length before or after.
    #[must_use]
    pub fn burst_events(&self, events: EventSlice<'_>, frames: &FrameStarts) -> Vec<bool> {
        let mut flags = vec![false; events.len()];
        let frames = frames.during(events.t);
        let SectionResult::Known(fold) = FrameFold::new(&frames, MIN_FRAMES) else { return flags };
        if self.bursts.is_empty() {
            return flags;
        }
        fold.visit(events.t, |i, _, since| {
            let polarity = PolarityName::of(events.on[i]);
            flags[i] = self.bursts.iter().filter(|burst| burst.polarity == polarity).any(|burst| {
                let [low, high] = burst.window_us;
                let line = burst.delay_us.value + burst.row_us.value * f64::from(events.y[i]);
                let residual = fold.wrap(since - line);
                (2.0 * low - high..2.0 * high - low).contains(&residual)
            });
        });
        flags
    }
}
