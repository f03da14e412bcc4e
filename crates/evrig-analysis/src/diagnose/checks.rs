//! Tests that an effect has to pass before it is reported.

pub(crate) mod acceptance;
pub(crate) mod accepted_effect;
pub(crate) mod boosted_trees;
pub(crate) mod effect_review;
pub(crate) mod event_strata;
pub(crate) mod null_distribution;
pub(crate) mod pruning;
pub(crate) mod split_half;
pub(crate) mod strength_constancy;
pub(crate) mod two_sample_test;
pub(crate) mod upper_bound;
