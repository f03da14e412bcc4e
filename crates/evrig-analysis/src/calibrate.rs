//! The generator's constants k from frames and real events, each with its error.
//!
//! Three ways, each from the one before:
//! 1. [`Regressions`]: the paper's procedure, samples binned by brightness and its change,
//!    first-passage laws fitted to each bin, three weighted regressions. Its biases are listed there.
//! 2. [`PassageFit`]: estimating equations over whole passages, unbiased under the model.
//! 3. [`search`](fn@search): a black-box search over k by an [`Objective`], judged on held-out tiles.
//!
//! Pure: frames and events come in, constants go out. Pixels are split into training and
//! held-out tiles like the fields of a chessboard; constants see the training tiles only.

mod along;
mod bins;
mod calibration;
mod emd;
mod estimate;
mod least_squares;
mod light;
mod passage;
mod passage_fit;
mod regression;
mod score;
mod search;
#[cfg(test)]
mod tests;

pub use bins::{BinFit, PassageLaw};
pub use calibration::{Calibration, Candidate, Settings, Split, calibrate};
pub use emd::EmdObjective;
pub use estimate::Constant;
pub use light::{Light, LightBuilder, Part, TILE};
pub use passage_fit::PassageFit;
pub use regression::{Histogram, Line, Regressions};
pub use score::ScoreObjective;
pub use search::{Found, Objective, search};

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Why constants cannot be told.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// All frames have the size of the event camera's grid.
    #[error("frame {index} is {found}; expected {expected}, the grid of the events")]
    FrameSize {
        /// Number of the frame, from 0.
        index: usize,
        /// The grid.
        expected: Size,
        /// The frame's size.
        found: Size,
    },
    /// Time must ascend.
    #[error("frame {index} at {t_us} us is not later than the frame before it ({before_us} us)")]
    FrameOrder {
        /// Number of the frame, from 0.
        index: usize,
        /// Its time.
        t_us: i64,
        /// Time of the frame before.
        before_us: i64,
    },
    /// A single frame shows no change.
    #[error("{n} frames; calibration takes at least two, and a second of motion to be of use")]
    TooFewFrames {
        /// Frames given.
        n: usize,
    },
    /// No pixel has light that can be used.
    #[error(
        "none of {n_pixels} pixels stays between 1 DN and the cut-off in all frames; \
         record with another exposure"
    )]
    NoUsablePixel {
        /// Pixels looked at.
        n_pixels: usize,
    },
    /// The bins do not carry the regressions.
    #[error(
        "{n_passages} intervals fill {n_bins} bins of brightness and change with 50 or more, and \
         {n_lines} levels of brightness; the regressions need two levels of three bins: record \
         longer, or a scene with more light levels and faster motion"
    )]
    TooFewBins {
        /// Intervals between events.
        n_passages: usize,
        /// Bins kept.
        n_bins: usize,
        /// Levels of brightness with a line.
        n_lines: usize,
    },
    /// The passages leave a constant free.
    #[error(
        "{n_passages} passages between events do not determine {which}: the light changes too \
         little, or is of one level; record motion over a scene with several light levels"
    )]
    Undetermined {
        /// The constants.
        which: &'static str,
        /// Passages used.
        n_passages: usize,
    },
}

/// The paper's regressions on one part of the pixels. `seed` draws the resamplings behind the errors.
///
/// # Errors
/// When there are too few events over too few light levels.
pub fn regress(
    light: &Light,
    events: EventSlice<'_>,
    part: Part,
    seed: u64,
) -> Result<Regressions, CalibrateError> {
    regression::regress(light, &passage::passages(light, events, part), seed)
}

/// k from whole passages on one part of the pixels; `start` need not be close.
///
/// # Errors
/// When the passages leave a constant free.
pub fn fit(
    light: &Light,
    events: EventSlice<'_>,
    part: Part,
    start: [f64; 6],
) -> Result<PassageFit, CalibrateError> {
    passage_fit::fit(light, &passage::passages(light, events, part), start)
}
