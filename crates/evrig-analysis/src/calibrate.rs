//! Calibration of the voltmeter generator's constants k from frames and real events, with errors.
//!
//! Three estimators, each starting from the one before:
//! 1. [`Regressions`]: the paper's procedure, samples binned by brightness and its change,
//!    first-passage distributions fitted to each bin, three weighted regressions. Biased, as listed
//!    there.
//! 2. [`PassageFit`]: estimating equations over whole passages, unbiased under the model.
//! 3. [`search`](fn@search): a CMA-ES search over k by an [`Objective`], evaluated on held-out
//!    tiles.
//!
//! Pixels are split into training and held-out tiles in a checkerboard; constants are fitted to the
//! training tiles only.

mod bins;
mod brightness;
mod calibration;
mod emd;
mod estimate;
mod least_squares;
mod passage;
mod passage_fit;
mod path_integrals;
mod regression;
mod score;
mod search;
#[cfg(test)]
mod tests;

pub use bins::{BinFit, PassageLaw};
pub use brightness::{BrightnessSeries, BrightnessSeriesBuilder, TILE, TileSubset};
pub use calibration::{
    Calibration, CalibrationSettings, CandidateConstants, PixelSplit, calibrate,
};
pub use emd::EmdObjective;
pub use estimate::Constant;
pub use passage_fit::PassageFit;
pub use regression::{Histogram, RegressionLine, Regressions};
pub use score::ScoreObjective;
pub use search::{HeldObjective, Objective, SearchResult, search};

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Why constants cannot be estimated.
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
    /// Fewer than two frames.
    #[error("{n} frames; calibration takes at least two, and a second of motion to be of use")]
    TooFewFrames {
        /// Frames given.
        n: usize,
    },
    /// Every pixel is dark or saturated in some frame.
    #[error(
        "none of {n_pixels} pixels stays between 1 DN and the cut-off in all frames; \
         record with another exposure"
    )]
    NoUsablePixel {
        /// Pixels examined.
        n_pixels: usize,
    },
    /// Too few bins for the regressions.
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
    /// The passages do not determine a constant.
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

/// The paper's regressions on one part of the pixels. `seed` draws the resamplings behind the
/// errors.
///
/// # Errors
/// When there are too few events over too few light levels.
pub fn regress(
    brightness: &BrightnessSeries,
    events: EventSlice<'_>,
    part: TileSubset,
    seed: u64,
) -> Result<Regressions, CalibrateError> {
    regression::regress(brightness, &passage::passages(brightness, events, part), seed)
}

/// k from whole passages on one part of the pixels; `start` need not be close.
///
/// # Errors
/// When the passages do not determine a constant.
pub fn fit(
    brightness: &BrightnessSeries,
    events: EventSlice<'_>,
    part: TileSubset,
    start: [f64; 6],
) -> Result<PassageFit, CalibrateError> {
    passage_fit::fit(brightness, &passage::passages(brightness, events, part), start)
}
