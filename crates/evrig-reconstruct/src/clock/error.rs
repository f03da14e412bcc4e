use evrig_core::time::Span;
use thiserror::Error;

/// Why there is no estimate of a clock.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ClockError {
    /// Too few frames.
    #[error(
        "{found} usable frames, {needed} needed: record longer, or check why frames were left out"
    )]
    TooFewFrames {
        /// Frames left after the checks.
        found: usize,
        /// Frames the method needs.
        needed: usize,
    },
    /// The sensor's clock runs backwards too often for a few lost frames.
    #[error(
        "SensorTimestamp goes back at frame {frame} (from {before_ns} to {after_ns} ns), and \
         {n_bad} of {n} frames are out of order: split the recording where the camera or the Pi \
         was restarted"
    )]
    SensorOrder {
        /// Index of the first frame whose stamp is not after the one before it.
        frame: usize,
        /// The stamp before it, ns.
        before_ns: i64,
        /// Its stamp, ns.
        after_ns: i64,
        /// Frames outside the longest increasing sequence.
        n_bad: usize,
        /// All frames.
        n: usize,
    },
    /// The intervals of the two clocks are of different size: a unit is wrong.
    #[error(
        "frames are {sensor} apart by SensorTimestamp but {real} by RealTime: a unit is wrong \
         (SensorTimestamp is in nanoseconds here; is this column in {looks_like}?)"
    )]
    IntervalMismatch {
        /// Median interval by SensorTimestamp.
        sensor: Span,
        /// Median interval by RealTime.
        real: Span,
        /// The unit that would explain it.
        looks_like: &'static str,
    },
    /// RealTime does not advance.
    #[error("RealTime shows the same instant on all {n} frames: it was not read per frame")]
    RealTimeStuck {
        /// Frames seen.
        n: usize,
    },
    /// No two-sided reading is usable.
    #[error(
        "no usable clock reading ({n_seen} seen, {n_reversed} with the second stamp before the \
         first)"
    )]
    NoReadings {
        /// Readings seen.
        n_seen: usize,
        /// Readings whose end lies before their start.
        n_reversed: usize,
    },
    /// A track is too short.
    #[error("{found} usable samples of the {track} track, {needed} needed")]
    TooFewSamples {
        /// Which of the two tracks.
        track: &'static str,
        /// Samples that are finite, in order, and within the other track's time.
        found: usize,
        /// Samples needed.
        needed: usize,
    },
    /// The motion does not separate time from rotation.
    #[error(
        "this motion does not fix the offset: its error is {ratio:.0} times what the speed alone \
         would allow (at most {limit:.0} accepted). A circle run in one direction looks the same \
         delayed as turned; run it both ways, stop and start, or state the roll between the cameras"
    )]
    DegenerateMotion {
        /// Standard error over that with known geometry; infinite when singular.
        ratio: f64,
        /// Largest ratio accepted.
        limit: f64,
    },
    /// The tracks move too little, or differently.
    #[error(
        "the tracks fix the offset only to ±{error}, no better than the search of ±{search}: the \
         tag moves too little, or the tracks do not show one motion"
    )]
    WeakMotion {
        /// Half width of the offset's 95 % interval.
        error: Span,
        /// Half width of the search.
        search: Span,
    },
    /// Two offsets fit the tracks about equally well.
    #[error(
        "the tracks fit offsets of {first} and {second} about equally well: the motion repeats \
         itself; narrow the search or record a motion that does not"
    )]
    AmbiguousOffset {
        /// The best offset.
        first: Span,
        /// The other offset.
        second: Span,
    },
    /// The fit left the search range.
    #[error(
        "the offset left the search range of ±{search}: widen it, or check that both tracks show \
         one motion"
    )]
    OutOfRange {
        /// Half width of the search.
        search: Span,
    },
    /// The fit did not converge.
    #[error(
        "the offset did not settle in {steps} steps: check that both tracks show the same motion"
    )]
    NotConverged {
        /// Steps made.
        steps: usize,
    },
}
