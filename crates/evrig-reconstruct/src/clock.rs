//! SensorTimestamp to Unix time: the map, its error, and what the error leaves out.
//!
//! Two kinds of evidence exist. A *frame pair* is one-sided: RealTime was read some
//! unknown latency after the SensorTimestamp, so the difference is offset plus
//! latency, and only its smallest values say anything; the smallest latency itself
//! stays in every one-sided estimate unless something else tells it
//! ([`MinimumLatency`]). A *clock reading* is two-sided: RealTime was read between two
//! readings of the sensor's clock, so the offset is bounded whatever the delays were.
//!
//! | function | what it is |
//! | --- | --- |
//! | [`paper_interval()`] | the published method, exactly; the baseline |
//! | [`paper_window()`] | the same idea over a window of one second, median |
//! | [`clock_pair()`] | two-sided readings; the default where there are any |
//! | [`envelope()`] | smallest latency between steps; the default for frame pairs |
//! | [`hull()`], [`olson2()`] | other one-sided methods, to cross-check |
//! | [`motion()`] | offset and rate from a motion that two cameras saw |
//! | [`synchronise()`] | all of them on a session's evidence; the best is taken, the rest check it |
//!
//! Everything here is a function from values to values.

mod agreement;
mod clock_pair;
mod endpoint;
mod envelope;
mod error;
mod estimate;
mod hull;
mod input;
mod late;
mod motion;
mod olson2;
mod order;
mod paper_interval;
mod paper_window;
mod rows;
mod steps;
mod synchronise;
mod trace;

#[cfg(test)]
mod tests;

pub use agreement::{Disagreement, cross_check};
pub use clock_pair::{PairOptions, clock_pair};
pub use envelope::{EnvelopeOptions, RateModel, envelope};
pub use error::ClockError;
pub use estimate::{
    ClockEstimate, Diagnostics, Method, MinimumLatency, PaperChoice, Segment, SegmentError,
    SegmentStart,
};
pub use hull::hull;
pub use input::{
    ClockReading, FramePair, FramePairs, PairTally, SensorStamps, SensorUnit, sensor_stamps,
};
pub use late::{LateStream, late};
pub use motion::{MotionEstimate, MotionOptions, TrackSample, motion};
pub use olson2::olson2;
pub use paper_interval::{PaperUnit, paper_interval};
pub use paper_window::paper_window;
pub use rows::{ExposureSign, RowTiming};
pub use synchronise::{
    Attempt, EventsClock, Evidence, MotionAttempt, Reference, SessionClocks, host_reading,
    synchronise,
};
