//! What a method returns: maps between steps, each with its error.

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
    /// The paper's idea over one-second windows.
    PaperWindow,
    /// Two-sided clock readings.
    ClockPair,
    /// Smallest latency between steps.
    Envelope,
    /// Line below all points with the least sum of distances.
    Hull,
    /// Smallest latency within a drift bound, both ways in time.
    Olson2,
    /// Motion seen by two cameras.
    Motion,
}

/// What is known of the smallest latency between SensorTimestamp and RealTime.
///
/// A one-sided method measures offset plus smallest latency; this says how the two were parted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "source")]
pub enum MinimumLatency {
    /// Nothing but that it is not negative; nothing is subtracted.
    #[default]
    Unknown,
    /// A frame is not handed over before its last row is read: a floor, which is
    /// subtracted, and no ceiling.
    ReadoutFloor {
        /// Rows times row time.
        floor: Span,
    },
    /// Believed, not measured; the middle is subtracted.
    Assumed {
        /// Smallest believable value.
        low: Span,
        /// Largest believable value.
        high: Span,
    },
    /// Measured on this rig; the middle is subtracted.
    Calibrated {
        /// Lower end of its 95 % interval.
        low: Span,
        /// Upper end of its 95 % interval.
        high: Span,
    },
    /// Not needed: two-sided readings bound the offset from both sides.
    ClockPairs,
    /// Not needed: the offset comes from what the cameras saw.
    Motion,
}

impl MinimumLatency {
    /// What is subtracted from the smallest difference.
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

    /// Smallest and largest value it can have; no largest where none is known.
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
    /// The map jumps: a clock was set.
    Step {
        /// How much later the target clock shows the same instant from here on.
        by: Span,
    },
    /// The map goes on without a jump at another rate.
    Bend,
}

/// The error of a segment's map, relative to the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SegmentError {
    /// Truth minus map in microseconds, the smallest latency set aside; the value is 0.
    pub offset_us: Estimate,
    /// Interval that covers truth minus map in 95 % of repetitions, the smallest latency set aside.
    pub statistical95: [Span; 2],
    /// The same with what is not known of the smallest latency; an end is absent when nothing bounds it.
    pub absolute95: [Option<Span>; 2],
}

/// A stretch of time with one linear map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Segment<A: Clock = Unix, B: Clock = PiSensor> {
    /// First instant of the segment.
    pub first: Stamp<B>,
    /// Last instant of the segment.
    pub last: Stamp<B>,
    /// Why it begins.
    pub start: SegmentStart,
    /// The map, with the smallest latency subtracted.
    pub map: ClockMap<A, B>,
    /// Rate of the target clock against the source; absent where it is one by construction.
    pub skew_ppm: Option<Estimate>,
    /// The map's error; absent where the method claims none.
    pub error: Option<SegmentError>,
    /// Pairs or readings behind the map.
    pub n_used: u64,
}

/// Which frame the paper's method took, and whether it was its own choice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PaperChoice {
    /// Index of the frame, or of the window's first frame.
    pub frame: u64,
    /// Sensor interval over RealTime interval there; absent when it is 0/0.
    pub ratio: Option<f64>,
    /// Candidates that were exactly as good; the first of them was taken.
    pub n_ties: u64,
    /// Intervals of the form 0/0, of which the first wins over every number.
    pub n_undefined: u64,
}

/// What to look at when an estimate is doubted.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Diagnostics {
    /// RealTime minus map over the pairs: smallest, 5 %, 50 %, 95 %, largest, µs.
    pub latency_us: Option<[f64; 5]>,
    /// Pairs later than the median by more than three frame intervals.
    pub n_stalled: u64,
    /// Exponent of the latencies' lower tail (2 for a gamma law of shape 2).
    pub tail_index: Option<f64>,
    /// Widths of the two-sided readings used: smallest, 5 %, 50 %, 95 %, largest, ns.
    pub reading_width_ns: Option<[f64; 5]>,
    /// Readings that contradicted those before and after them, left out.
    pub n_readings_rejected: u64,
    /// The paper's choice.
    pub paper: Option<PaperChoice>,
}

/// The way from clock `B` to clock `A` over a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct ClockEstimate<A: Clock = Unix, B: Clock = PiSensor> {
    /// How it was found.
    pub method: Method,
    /// Maps in order of time; never empty.
    pub segments: Vec<Segment<A, B>>,
    /// How offset and smallest latency were parted.
    pub minimum_latency: MinimumLatency,
    /// Stretches about the steps in which a stamp may belong to either side.
    pub doubtful: Vec<[Stamp<B>; 2]>,
    /// What was left out before the estimate.
    pub tally: PairTally,
    /// What to look at.
    pub diagnostics: Diagnostics,
}

impl<A: Clock, B: Clock> ClockEstimate<A, B> {
    /// The segment that holds for `at`: before the first the first, after the last the last.
    #[must_use]
    pub fn segment_at(&self, at: Stamp<B>) -> Option<&Segment<A, B>> {
        let begun = self.segments.partition_point(|segment| segment.first <= at);
        self.segments.get(begun.saturating_sub(1))
    }

    /// The instant `at` as clock `A` shows it; nothing for an estimate without segments.
    #[must_use]
    pub fn map(&self, at: Stamp<B>) -> Option<Stamp<A>> {
        self.segment_at(at).map(|segment| segment.map.map(at))
    }

    /// The instant that clock `A` shows as `at`, on clock `B`; nothing for an estimate without
    /// segments. Where clock `A` was set back an instant has two, of which the later is given.
    #[must_use]
    pub fn inverse_map(&self, at: Stamp<A>) -> Option<Stamp<B>> {
        let begun = |segment: &&Segment<A, B>| segment.map.map(segment.first) <= at;
        let segment = self.segments.iter().rev().find(begun).or_else(|| self.segments.first())?;
        Some(segment.map.inverse().map(at))
    }

    /// Interval of truth minus map at `at` that covers in 95 % of repetitions, the smallest latency set aside.
    #[must_use]
    pub fn statistical95(&self, at: Stamp<B>) -> Option<[Span; 2]> {
        self.segment_at(at)?.error.map(|error| error.statistical95)
    }

    /// The same with what is not known of the smallest latency; an end is absent when nothing bounds it.
    #[must_use]
    pub fn absolute95(&self, at: Stamp<B>) -> [Option<Span>; 2] {
        let error = self.segment_at(at).and_then(|segment| segment.error);
        error.map_or([None, None], |error| error.absolute95)
    }

    /// Whether `at` lies so close to a step that it may belong to the other side.
    #[must_use]
    pub fn is_doubtful(&self, at: Stamp<B>) -> bool {
        self.doubtful.iter().any(|[from, to]| *from <= at && at <= *to)
    }

    /// Number of steps of the clocks that were found.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        let is_step = |segment: &&Segment<A, B>| matches!(segment.start, SegmentStart::Step { .. });
        self.segments.iter().filter(is_step).count()
    }
}

impl SegmentError {
    /// Error of an extreme: the truth lies up to `below` under and `above` over the map (µs),
    /// `below90` with 90 %; the smallest latency adds what is not known of it.
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

/// Widens a statistical interval by what is not known of the smallest latency.
pub(super) fn absolute(statistical95: [Span; 2], latency: MinimumLatency) -> [Option<Span>; 2] {
    let subtracted = latency.subtracted();
    let (low, high) = latency.range();
    let lower_end = high.map(|high| statistical95[0] - (high - subtracted));
    [lower_end, Some(statistical95[1] + (subtracted - low))]
}
