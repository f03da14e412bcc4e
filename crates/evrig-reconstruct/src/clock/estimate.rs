//! Result of a method: maps between steps, each with its error.

use super::input::PairTally;
use evrig_core::stats::{Estimate, Z90};
use evrig_core::time::{Clock, ClockMap, PiSensor, Span, Stamp, Unix};
use serde::{Deserialize, Serialize};

/// The method behind an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's interval convergence.
    PaperInterval,
    /// The paper's criterion over one-second windows.
    PaperWindow,
    /// Two-sided clock readings.
    ClockPair,
    /// Minimum latency between steps.
    Envelope,
    /// Line below all points with the least sum of distances.
    Hull,
    /// Minimum latency within a drift bound, in both directions of time.
    Olson2,
    /// Motion seen by two cameras.
    Motion,
}

/// Knowledge of the minimum latency between SensorTimestamp and RealTime.
///
/// A one-sided method measures offset plus minimum latency; this states how the two are separated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "source")]
pub enum MinimumLatency {
    /// Only that it is not negative; nothing is subtracted.
    #[default]
    Unknown,
    /// A frame is delivered after its last row is read: a lower bound, which is subtracted, without
    /// an upper bound.
    ReadoutFloor {
        /// Rows times row time.
        floor: Span,
    },
    /// Assumed, not measured; the middle is subtracted.
    Assumed {
        /// Smallest assumed value.
        low: Span,
        /// Largest assumed value.
        high: Span,
    },
    /// Measured on this rig; the middle is subtracted.
    Calibrated {
        /// Lower end of its 95 % interval.
        low: Span,
        /// Upper end of its 95 % interval.
        high: Span,
    },
    /// Not needed: two-sided readings bound the offset.
    ClockPairs,
    /// Not needed: the offset comes from the images.
    Motion,
}

impl MinimumLatency {
    /// Latency subtracted from the smallest difference.
    #[must_use]
    pub fn subtracted(self) -> Span {
        match self {
            Self::Unknown | Self::ClockPairs | Self::Motion => Span::ZERO,
            Self::ReadoutFloor { floor } => floor,
            Self::Assumed { low, high } | Self::Calibrated { low, high } => {
                Span::from_nanos(low.as_nanos().midpoint(high.as_nanos()))
            }
        }
    }

    /// Smallest and largest possible value; no largest where unknown.
    #[must_use]
    pub fn range(self) -> (Span, Option<Span>) {
        match self {
            Self::Unknown => (Span::ZERO, None),
            Self::ReadoutFloor { floor } => (floor, None),
            Self::Assumed { low, high } | Self::Calibrated { low, high } => (low, Some(high)),
            Self::ClockPairs | Self::Motion => (Span::ZERO, Some(Span::ZERO)),
        }
    }
}

/// Why a segment begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "reason")]
pub enum SegmentStart {
    /// The recording begins.
    Beginning,
    /// The target clock was set.
    Step {
        /// Change of the target clock.
        by: Span,
    },
    /// The rate changes without a step.
    Bend,
}

/// The error of a segment's map, relative to the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SegmentError {
    /// Truth minus map in microseconds without the minimum latency; the value is 0.
    pub offset_us: Estimate,
    /// Interval of truth minus map with 95 % coverage, without the minimum latency.
    pub statistical95: [Span; 2],
    /// The same including the uncertainty of the minimum latency; an unbounded end is absent.
    pub absolute95: [Option<Span>; 2],
}

/// A time interval with one linear map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct ClockSegment<A: Clock = Unix, B: Clock = PiSensor> {
    /// First instant of the segment.
    pub first: Stamp<B>,
    /// Last instant of the segment.
    pub last: Stamp<B>,
    /// Why it starts.
    pub start: SegmentStart,
    /// The map, with the minimum latency subtracted.
    pub map: ClockMap<A, B>,
    /// Rate of the target clock against the source; absent where equal by construction.
    pub skew_ppm: Option<Estimate>,
    /// The map's error; absent where the method gives none.
    pub error: Option<SegmentError>,
    /// Pairs or readings used.
    pub n_used: u64,
}

/// The frame chosen by the paper's method, and how unique the choice was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PaperChoice {
    /// Index of the frame, or of the window's first frame.
    pub frame: u64,
    /// Sensor interval over RealTime interval there; absent when it is 0/0.
    pub ratio: Option<f64>,
    /// Candidates that were equally good; the first is taken.
    pub n_ties: u64,
    /// Intervals of the form 0/0, of which the first precedes every number.
    pub n_undefined: u64,
}

/// Diagnostics of an estimate.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Diagnostics {
    /// RealTime minus map over the pairs: minimum, 5 %, 50 %, 95 %, maximum, µs.
    pub latency_us: Option<[f64; 5]>,
    /// Pairs later than the median by more than three frame intervals.
    pub n_stalled: u64,
    /// Exponent of the latencies' lower tail (2 for a gamma distribution of shape 2).
    pub tail_index: Option<f64>,
    /// Widths of the two-sided readings used: minimum, 5 %, 50 %, 95 %, maximum, ns.
    pub reading_width_ns: Option<[f64; 5]>,
    /// Readings left out because they contradict those before and after them.
    pub n_readings_rejected: u64,
    /// The paper's choice.
    pub paper: Option<PaperChoice>,
}

/// Map from clock `B` to clock `A` over a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct ClockEstimate<A: Clock = Unix, B: Clock = PiSensor> {
    /// How it was found.
    pub method: Method,
    /// Maps in order of time; never empty.
    pub segments: Vec<ClockSegment<A, B>>,
    /// How offset and minimum latency are separated.
    pub minimum_latency: MinimumLatency,
    /// Intervals around the steps in which a stamp may belong to either side.
    pub doubtful: Vec<[Stamp<B>; 2]>,
    /// What was left out before the estimate.
    pub tally: PairTally,
    /// Diagnostics.
    pub diagnostics: Diagnostics,
}

impl<A: Clock, B: Clock> ClockEstimate<A, B> {
    /// The segment at `at`; the first before all, the last after all.
    #[must_use]
    pub fn segment_at(&self, at: Stamp<B>) -> Option<&ClockSegment<A, B>> {
        let begun = self.segments.partition_point(|segment| segment.first <= at);
        self.segments.get(begun.saturating_sub(1))
    }

    /// Instant `at` on clock `A`; None for an estimate without segments.
    #[must_use]
    pub fn map(&self, at: Stamp<B>) -> Option<Stamp<A>> {
        self.segment_at(at).map(|segment| segment.map.map(at))
    }

    /// The instant on clock `B` at which clock `A` shows `at`; None without segments. Where clock
    /// `A` was set back an instant has two, of which the later is returned.
    #[must_use]
    pub fn inverse_map(&self, at: Stamp<A>) -> Option<Stamp<B>> {
        let begun = |segment: &&ClockSegment<A, B>| segment.map.map(segment.first) <= at;
        let segment = self.segments.iter().rev().find(begun).or_else(|| self.segments.first())?;
        Some(segment.map.inverse().map(at))
    }

    /// Interval of truth minus map at `at` with 95 % coverage, without the minimum latency.
    #[must_use]
    pub fn statistical95(&self, at: Stamp<B>) -> Option<[Span; 2]> {
        self.segment_at(at)?.error.map(|error| error.statistical95)
    }

    /// The same including the uncertainty of the minimum latency; an unbounded end is absent.
    #[must_use]
    pub fn absolute95(&self, at: Stamp<B>) -> [Option<Span>; 2] {
        let error = self.segment_at(at).and_then(|segment| segment.error);
        error.map_or([None, None], |error| error.absolute95)
    }

    /// Whether `at` is so close to a step that it may belong to the other side.
    #[must_use]
    pub fn is_doubtful(&self, at: Stamp<B>) -> bool {
        self.doubtful.iter().any(|[from, to]| *from <= at && at <= *to)
    }

    /// Number of steps.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        let is_step =
            |segment: &&ClockSegment<A, B>| matches!(segment.start, SegmentStart::Step { .. });
        self.segments.iter().filter(is_step).count()
    }
}

impl SegmentError {
    /// Error of an extreme value: the truth is up to `below` under and `above` over the map (µs),
    /// `below90` with 90 %; the uncertainty of the minimum latency is added.
    pub(super) fn one_sided(
        below90: f64,
        below95: f64,
        above: f64,
        latency: MinimumLatency,
        n: u64,
    ) -> Self {
        Self::two_sided([below90, above], [below95, above], latency, n)
    }

    /// Error with margins below and above the map (µs), for 90 % and for 95 %.
    pub(super) fn two_sided(
        margin90: [f64; 2],
        margin95: [f64; 2],
        latency: MinimumLatency,
        n: u64,
    ) -> Self {
        let [below, above] = margin90;
        let standard_error = (below + above) / (2.0 * Z90);
        let offset_us = Estimate::with_interval(0.0, standard_error, [-below, above], n);
        let span = |us: f64| Span::from_secs_f64(us * 1e-6);
        let statistical95 = [span(-margin95[0]), span(margin95[1])];
        Self { offset_us, statistical95, absolute95: absolute(statistical95, latency) }
    }
}

/// Widens a statistical interval by the uncertainty of the minimum latency.
pub(super) fn absolute(statistical95: [Span; 2], latency: MinimumLatency) -> [Option<Span>; 2] {
    let subtracted = latency.subtracted();
    let (low, high) = latency.range();
    let lower_end = high.map(|high| statistical95[0] - (high - subtracted));
    [lower_end, Some(statistical95[1] + (subtracted - low))]
}
