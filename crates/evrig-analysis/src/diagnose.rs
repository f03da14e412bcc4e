//! Which physics does the model leave out?
//!
//! A baseline law of the pixels is fitted to the events that were seen, together with the nuisances
//! every recording has (thresholds, leak, noise, background, the clocks' offset), each held within
//! its ordinary range. Then every effect of the library is added in turn and refitted, not
//! linearised, together with them, on training blocks of pixels and time; what it buys on held-out
//! blocks, in nats per event, ranks it. Effects are taken one by one while they buy more than the
//! same search finds in events drawn from the model itself, and more than a hundredth of the excess.
//! What no effect explains is said to be unexplained.

mod checks;
mod evidence;
mod fit;
mod model;
mod options;
mod report;
mod search;
mod sensor_wide;

pub use evidence::session_facts::{ClockTie, SessionFacts};
pub use evidence::stamp_grid::StampGrid;
pub use evidence::{DiagnoseError, Evidence, PixelEvidence};
pub use fit::effect_scan::EffectGain;
pub use model::hypothesis::Hypothesis;
pub use model::image_pose::ImagePose;
pub use model::library::{
    CandidateEffect, DerivedParameters, EffectParameter, FreedNuisance, LIBRARY, SignalStage,
};
pub use model::nuisance::Nuisance;
pub use model::pixel_mixture::{PixelMixture, PixelStratum};
pub use model::predicted_pixel::PredictedPixel;
pub use model::registration::{FittedRegistration, RegisteredDrive};
pub use options::DiagnosisOptions;
pub use report::departure::Departure;
pub use report::diagnosis_report::{
    BaselineMismatch, CompetingHypothesis, ConfidenceInterval, Diagnosis, DiagnosisVerdict,
    FitReport, FittedEffect, HeldOutScores, MisfitStratum, NullReport, ProposedTerm,
    RejectedEffect, ResidualMismatch, ResidualStructure, ResidualStructureReport, SplitHalfFit,
    UntestableEffect,
};
pub use report::fitted_camera::{FittedCamera, surroundings};
pub use report::forward_simulation::{
    ForwardSimulation, ModelComparison, events_on_patch, simulate_forward,
};
pub use report::heat_map::{HeatMap, HeatValue};
pub use search::{DiagnosisResult, diagnose};

#[cfg(test)]
mod tests;
