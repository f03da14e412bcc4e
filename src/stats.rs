//! Statistics without a question: estimates, moments, quantiles.

mod direction;
mod dot;
mod estimate;
mod moments;
mod random;
mod wilson;

pub use direction::MeanDirection;
pub use dot::dot;
pub use estimate::{Estimate, Z90, number_or_nan, numbers_or_nan};
pub use moments::{Moments, median, quantile_sorted, upper_median};
pub use random::SplitMix;
pub use wilson::wilson95;
