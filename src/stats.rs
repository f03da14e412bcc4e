//! Statistics without a question: estimates, moments, quantiles.

mod estimate;
mod moments;
mod split_mix;
mod wilson;

pub use estimate::Estimate;
pub use moments::{Moments, quantile_sorted};
pub use split_mix::SplitMix;
pub use wilson::wilson95;
