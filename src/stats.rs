//! Statistics without a question: estimates, moments, quantiles.

mod estimate;
mod moments;

pub use estimate::Estimate;
pub use moments::{Moments, quantile_sorted};
