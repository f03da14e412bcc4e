//! Estimation and selection.

pub(crate) mod candidate;
pub(crate) mod intervals;
pub(crate) mod optimizer;
pub(crate) mod profile;
pub(crate) mod score_scan;
pub(crate) mod selection;
pub(crate) mod spread;
