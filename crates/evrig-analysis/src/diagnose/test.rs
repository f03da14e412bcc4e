//! Goodness of fit.

pub(crate) mod boosted_trees;
pub(crate) mod event_strata;
pub(crate) mod goodness;
pub(crate) mod two_sample_test;
pub(crate) mod upper_bound;
