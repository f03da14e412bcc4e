//! Estimation and selection.

pub(crate) mod candidate;
mod coarse_pixels;
pub(crate) mod intervals;
pub(crate) mod optimizer;
pub(crate) mod paired_gain;
pub(crate) mod profile;
pub(crate) mod score_scan;
mod search;
pub(crate) mod selection;
pub(crate) mod spread;
