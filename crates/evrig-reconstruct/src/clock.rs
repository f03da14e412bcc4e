//! Clock maps from SensorTimestamp to Unix time, with their errors.
//!
//! There are two kinds of observation. A *frame pair* is one-sided: RealTime was read after an
//! unknown latency, so that the difference is offset plus latency. Only its smallest values bound
//! the offset, and the minimum latency remains in every one-sided estimate unless it is known
//! otherwise ([`MinimumLatency`]). A *clock reading* is two-sided: RealTime was read between two
//! readings of the sensor's clock, which bounds the offset for any delay.
//!
//! | function | method |
//! | --- | --- |
//! | [`paper_interval()`] | the published method, exactly; the baseline |
//! | [`paper_window()`] | the same criterion over a window of one second, median |
//! | [`clock_pair()`] | two-sided readings; the default where there are any |
//! | [`envelope()`] | minimum latency between steps; the default for frame pairs |
//! | [`hull()`], [`olson2()`] | other one-sided methods, for cross-checks |
//! | [`motion()`] | offset and rate from a motion seen by two cameras |
//! | [`synchronise()`] | all methods on the observations of a session; the best one is used |

mod agreement;
mod clock_pair;
mod endpoint;
mod envelope;
mod error;
mod estimate;
mod hull;
mod input;
mod motion;
mod olson2;
mod order;
mod paper_interval;
mod paper_window;
mod row_timing;
mod steps;
mod stream_delay;
mod synchronise;
mod trace;

#[cfg(test)]
mod tests;

pub use agreement::{Disagreement, cross_check};
pub use clock_pair::{PairOptions, clock_pair};
pub use envelope::{EnvelopeOptions, RateModel, envelope};
pub use error::ClockError;
pub use estimate::{
    ClockEstimate, ClockSegment, Diagnostics, Method, MinimumLatency, PaperChoice, SegmentError,
    SegmentStart,
};
pub use hull::hull;
pub use input::{FramePair, FramePairs, PairTally, TwoSidedReading};
pub use motion::{MotionEstimate, MotionOptions, TrackSample, motion};
pub use olson2::olson2;
pub use paper_interval::{PaperUnit, paper_interval};
pub use paper_window::paper_window;
pub use row_timing::{ExposureSign, RowTiming};
pub use stream_delay::{StreamDelay, estimate_stream_delay};
pub use synchronise::{
    ClockObservations, EventsClock, MethodResult, MotionResult, SessionClocks, TimeReference,
    host_reading, synchronise,
};
