//! Which physical effects does the model of a recording lack?
//!
//! The camera has constants with priors and ordinary ranges, and thresholds per pixel by empirical
//! Bayes; the likelihood is that of [`crate::predict`]. Effects of the library and constants beyond
//! their ordinary range are accepted by held-out log-likelihood while a test of goodness of fit
//! doubts the model. What needs no light (coupling to frames, hot and dead pixels, readout) is found
//! first, by statistics of all events.

pub(crate) mod effect;
pub(crate) mod evidence;
pub(crate) mod fit;
pub(crate) mod levels;
pub(crate) mod model;
mod options;
pub(crate) mod report;
pub(crate) mod statistics;
pub(crate) mod test;

pub use effect::{LIBRARY, LibraryEffect};
pub use evidence::session_facts::{ClockTie, SessionFacts};
pub use evidence::stamp_grid::StampGrid;
pub use evidence::{DiagnoseError, Evidence, PixelEvidence};
pub use model::image_pose::ImagePose;
pub use model::registration::{FittedRegistration, RegisteredDrive};
pub use options::DiagnosisOptions;
pub use report::conclude::{DiagnosisResult, diagnose};
pub use report::departure::Departure;
pub use report::diagnosis_report::{
    BaselineMismatch, CompetingHypothesis, ConfidenceInterval, Diagnosis, DiagnosisVerdict,
    FitReport, FittedEffect, HeldOutScores, MisfitStratum, ProposedTerm, RejectedEffect,
    ResidualMismatch, ResidualStructure, ResidualStructureReport, UntestableEffect,
};
pub use report::fitted_camera::{FittedCamera, surroundings};
pub use report::forward_simulation::{
    ForwardSimulation, ModelComparison, events_on_patch, simulate_forward,
};
pub use report::heat_map::{HeatMap, HeatValue};

#[cfg(test)]
mod tests;
