//! Checked observations: ordered frame pairs, units, and counts of what was left out.

use super::error::ClockError;
use super::order::longest_increasing;
use evrig_core::stats::upper_median;
use evrig_core::time::{Clock, PiSensor, Span, Stamp, Unix};
use serde::{Deserialize, Serialize};

/// Two stamps of one frame, as recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FramePair<A: Clock = Unix, B: Clock = PiSensor> {
    /// SensorTimestamp.
    pub sensor: Stamp<B>,
    /// RealTime, read some latency after `sensor`.
    pub real: Stamp<A>,
    /// Time from this frame to the next as the camera states it.
    pub frame_duration: Option<Span>,
    /// Exposure as the camera states it.
    pub exposure: Option<Span>,
}

/// A reading of one clock between two readings of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TwoSidedReading<A: Clock = Unix, B: Clock = PiSensor> {
    /// Readings of one burst share a number; only the narrowest of a group is used.
    pub group: u64,
    /// The source clock before.
    pub before: Stamp<B>,
    /// The target clock.
    pub real: Stamp<A>,
    /// The source clock after.
    pub after: Stamp<B>,
}

/// Frames seen = kept + left out, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PairTally {
    /// Pairs or readings given.
    pub n_seen: u64,
    /// Used.
    pub n_kept: u64,
    /// Same SensorTimestamp as another frame.
    pub n_duplicate: u64,
    /// SensorTimestamp before that of an earlier frame, or far ahead of all later ones.
    pub n_out_of_order: u64,
    /// RealTime earlier than the frames on both sides allow.
    pub n_too_early: u64,
    /// Not finite, or beyond the range of the clock.
    pub n_not_finite: u64,
}

/// Pairs in strictly increasing sensor order, with the count of those left out.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePairs<A: Clock = Unix, B: Clock = PiSensor> {
    pairs: Vec<FramePair<A, B>>,
    tally: PairTally,
}

/// Fewest frames of any method.
pub(super) const MIN_FRAMES: usize = 8;
/// Greatest share of frames out of order; above it the clock was restarted.
const MAX_DISORDER: f64 = 0.1;
/// Neighbours on each side with which a RealTime is compared.
const NEIGHBOURS: usize = 30;
/// Longest run of misread RealTimes; longer ones are steps.
const MAX_MISREAD_RUN: usize = 3;
/// Least lead of a misread RealTime over all neighbours, µs.
const MISREAD_US: f64 = 3_000.0;

/// Greatest ratio of the clocks' median intervals for one unit.
const MAX_INTERVAL_RATIO: f64 = 5.0;
/// Units of a timestamp column, in nanoseconds.
const UNITS_NS: [(&str, f64); 4] =
    [("nanoseconds", 1.0), ("microseconds", 1e3), ("milliseconds", 1e6), ("seconds", 1e9)];

impl<A: Clock, B: Clock> FramePairs<A, B> {
    /// Checks pairs in the order of recording.
    ///
    /// Duplicates, frames out of order and misread RealTimes are left out and counted.
    ///
    /// # Errors
    /// Too few frames, a restarted sensor clock, a wrong unit, a constant RealTime.
    pub fn check(pairs: &[FramePair<A, B>]) -> Result<Self, ClockError> {
        let mut tally = PairTally { n_seen: pairs.len() as u64, ..PairTally::default() };
        let mut kept = in_order(pairs, &mut tally)?;
        require_frames(kept.len())?;
        require_one_unit(&kept)?;
        let early = misread(&kept);
        tally.n_too_early = early.iter().filter(|&&is_early| is_early).count() as u64;
        let mut is_early = early.into_iter();
        kept.retain(|_| !is_early.next().unwrap_or(false));
        require_frames(kept.len())?;
        tally.n_kept = kept.len() as u64;
        Ok(Self { pairs: kept, tally })
    }

    /// The pairs kept, sensor stamps strictly increasing.
    #[must_use]
    pub fn pairs(&self) -> &[FramePair<A, B>] {
        &self.pairs
    }

    /// What was kept and left out.
    #[must_use]
    pub fn tally(&self) -> PairTally {
        self.tally
    }
}

impl<A: Clock, B: Clock> FramePair<A, B> {
    /// A pair with stamps alone.
    #[must_use]
    pub fn new(sensor: Stamp<B>, real: Stamp<A>) -> Self {
        Self { sensor, real, frame_duration: None, exposure: None }
    }
}

fn require_frames(found: usize) -> Result<(), ClockError> {
    let enough = found >= MIN_FRAMES;
    if enough { Ok(()) } else { Err(ClockError::TooFewFrames { found, needed: MIN_FRAMES }) }
}

fn in_order<A: Clock, B: Clock>(
    pairs: &[FramePair<A, B>],
    tally: &mut PairTally,
) -> Result<Vec<FramePair<A, B>>, ClockError> {
    let stamps: Vec<i64> = pairs.iter().map(|pair| pair.sensor.as_nanos()).collect();
    let is_kept = longest_increasing(&stamps);
    let mut kept: Vec<FramePair<A, B>> = Vec::with_capacity(pairs.len());
    let mut first_bad = None;
    for (index, pair) in pairs.iter().enumerate() {
        if is_kept[index] {
            kept.push(*pair);
        } else if index > 0 && stamps[index] == stamps[index - 1]
            || stamps.get(index + 1) == Some(&stamps[index])
        {
            tally.n_duplicate += 1;
        } else {
            tally.n_out_of_order += 1;
            first_bad = first_bad.or(Some(index));
        }
    }
    match first_bad {
        Some(_) if tally.n_out_of_order as f64 > MAX_DISORDER * pairs.len() as f64 => {
            let back = stamps.windows(2).position(|pair| pair[1] < pair[0]).unwrap_or(0);
            Err(ClockError::SensorOrder {
                frame: back + 1,
                before_ns: stamps[back],
                after_ns: stamps[back + 1],
                n_bad: tally.n_out_of_order as usize,
                n: pairs.len(),
            })
        }
        _ => Ok(kept),
    }
}

fn require_one_unit<A: Clock, B: Clock>(pairs: &[FramePair<A, B>]) -> Result<(), ClockError> {
    let real: Vec<Stamp<A>> = pairs.iter().map(|pair| pair.real).collect();
    if real.iter().all(|stamp| *stamp == real[0]) {
        return Err(ClockError::RealTimeStuck { n: real.len() });
    }
    let sensor: Vec<Stamp<B>> = pairs.iter().map(|pair| pair.sensor).collect();
    // A RealTime in coarse ticks has a median interval of 0 and does not determine the unit.
    let (Some(sensor), Some(real)) = (median_interval_ns(&sensor), median_interval_ns(&real))
    else {
        return Ok(());
    };
    let ratio = real / sensor;
    if real <= 0.0 || (1.0 / MAX_INTERVAL_RATIO..=MAX_INTERVAL_RATIO).contains(&ratio) {
        return Ok(());
    }
    let distance = |unit: &&(&str, f64)| (ratio / unit.1).ln().abs();
    let nearest = UNITS_NS.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    Err(ClockError::IntervalMismatch {
        sensor: Span::from_nanos(sensor as i64),
        real: Span::from_nanos(real as i64),
        looks_like: nearest
            .filter(|unit| distance(unit) <= MAX_INTERVAL_RATIO.ln())
            .map_or("no unit of time", |unit| unit.0),
    })
}

/// Marks RealTimes earlier than the frames before and after them allow.
///
/// One such frame would become the minimum latency of its segment. A step is not marked: it lasts
/// longer than the longest run tested.
fn misread<A: Clock, B: Clock>(pairs: &[FramePair<A, B>]) -> Vec<bool> {
    let excess = |pair: &FramePair<A, B>| {
        let sensor = pair.sensor - pairs[0].sensor;
        (pair.real - pairs[0].real - sensor).as_nanos() as f64 * 1e-3
    };
    let y: Vec<f64> = pairs.iter().map(excess).collect();
    let smallest = |of: &[f64]| of.iter().copied().fold(f64::INFINITY, f64::min);
    (0..y.len())
        .map(|at| {
            let before = &y[at.saturating_sub(NEIGHBOURS)..at.saturating_sub(MAX_MISREAD_RUN - 1)];
            let after = &y[(at + MAX_MISREAD_RUN).min(y.len())..(at + NEIGHBOURS).min(y.len())];
            y[at] < smallest(before).min(smallest(after)) - MISREAD_US
        })
        .collect()
}

fn median_interval_ns<C: Clock>(stamps: &[Stamp<C>]) -> Option<f64> {
    median(stamps.windows(2).map(|pair| (pair[1] - pair[0]).as_nanos() as f64))
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    upper_median(&mut values.collect::<Vec<f64>>())
}
