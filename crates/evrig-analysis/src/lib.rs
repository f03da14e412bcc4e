//! What is asked of event streams: filters, the likelihood of recorded events given the
//! log-intensity signal, calibration of a generator's constants, comparison and diagnosis.

pub mod calibrate;
pub mod camera_report;
mod coherent_step;
pub mod compare;
pub mod diagnose;
pub mod filter;
pub mod predict;
