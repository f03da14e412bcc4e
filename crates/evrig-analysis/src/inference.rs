//! A second engine of the diagnosis: a smooth likelihood, camera constants with priors, thresholds
//! by empirical Bayes, one optimizer and standard tests.
//!
//! It runs beside [`diagnose`](crate::diagnose::diagnose) until it has been measured against it on
//! fresh trials.

mod band;
mod bursts;
mod camera;
mod candidate;
mod constants;
mod draw;
mod effects;
mod findings;
mod fit;
mod goodness;
mod hazard;
mod intervals;
mod law;
mod levels;
mod model;
mod pass;
mod profile;
mod report;
mod score_scan;
mod select;
mod signal;
mod spread;
mod terms;
#[cfg(test)]
mod tests;
mod view;

pub use report::{SmoothDiagnosis, diagnose_smooth};
