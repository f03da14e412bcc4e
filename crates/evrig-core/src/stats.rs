//! Statistics: estimates, moments, quantiles, random numbers.

mod direction;
mod dot;
mod estimate;
mod moments;
mod random;
mod read_back;
mod wilson;

pub use direction::MeanDirection;
pub use dot::dot;
pub use estimate::{Estimate, Z90};
pub use moments::{Moments, median, quantile_sorted, upper_median};
pub use random::SplitMix;
pub use read_back::{read_back, read_value};
pub use wilson::wilson95;
