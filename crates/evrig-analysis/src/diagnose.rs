//! Which physical effects does the model of a recording lack?
//!
//! A baseline law of the pixels is fitted to the recorded events together with the nuisances of
//! every recording (thresholds, leak, noise, background, clock offset), each within its prior
//! range. Then every effect of the library is added in turn and fitted jointly with them, on
//! training cells (tiles of pixels during time blocks). Its gain in held-out log-likelihood, nats
//! per event, ranks it. Forward selection goes on while the gain is significant, above that of the
//! same search in recordings simulated from the model, and above 1 % of the excess. Accepted
//! effects must have the same strength in all strata and leave no residual structure that a
//! classifier two-sample test finds; otherwise they are rejected and the mismatch is reported as
//! unexplained.
//!
//! # Constants without a derivation
//!
//! Most constants are significance levels, resolutions or work budgets. The following bounds were
//! set on recordings, simulated and real, and have no other reason:
//!
//! | constant | module | bounds |
//! | --- | --- | --- |
//! | `MIN_GAIN_NATS_PER_EVENT` | `fit::cell_scores` | gain of a named effect |
//! | `SUGGESTIVE_GAIN_NATS_PER_EVENT` | `fit::cell_scores` | gain of a reported, rejected effect |
//! | `MIN_EXCESS_NATS_PER_EVENT` | `report::conclusion` | excess of a mismatch |
//! | `MIN_STRUCTURE_NATS_PER_EVENT`, `MAX_LEFT_SHARE_*`, `MIN_LEFT_SHARE_UNEXPLAINED` | `checks::acceptance` | residual structure |
//! | `MAX_STRENGTH_CHANGE` | `checks::acceptance` | change of strength between strata |
//! | `MIN_INFORMATION_SHARE` | `checks::strength_constancy` | information of a stratum |
//! | `MAX_UNIDENTIFIED_GAIN` | `checks::pruning` | gain of an unidentified effect |
//! | `MODEL_ERROR_SHARE` | `report::model_error` | error of the law |
//! | prior ranges | `model::nuisance` | nuisances of a working camera |
//! | `MIN_COMPETITOR_GAIN_SHARE`, `LOW_GAIN_NATS_PER_EVENT` | `search` | effects fitted to convergence |
//! | `MIN_TRAINING_GAIN`, `MIN_REGION_GAIN`, `NOISE_REDUCTIONS_LOG` | `fit::effect_scan` | effects fitted further |
//! | `START_THRESHOLDS`, `START_NOISE` | `fit::multistart` | starts with interpolated light |
//! | `MIN_EDGE_LOSS_NATS`, `MIN_SHARE_OUTSIDE` | `fit::spatial_region` | edges of a region |
//! | `MIN_PROMINENCE` | `evidence::refractory_peaks` | peak of the period criterion |
//! | `MIN_DROP_NATS`, `MAX_DROP_NATS`, eigenvalue bounds | `fit::curvature_probes`, `fit::laplace` | curvature against numerical noise |
//! | `MIN_BUSY_SHARE`, `MIN_EVENT_SHARE`, `MIN_EXCESS_HZ`, `MIN_RATE_RATIO`, `MIN_NOISE_ALTERNATION`, `MIN_SIMILAR_PEAK_SHARE`, `MIN_TIE_SHARE`, `MIN_BACK_TO_BACK_SHARE` | `sensor_wide` | sensor-wide findings |
//! | `MIN_SAME_ROW_SHARE`, `MAX_SERIAL_TIE_SHARE`, `MIN_SERIAL_STEP_SHARE` | `evidence::stamp_grid` | grid against readout |

pub(crate) mod checks;
pub(crate) mod evidence;
pub(crate) mod fit;
mod model;
mod options;
pub(crate) mod report;
mod search;
pub(crate) mod sensor_wide;

pub use evidence::session_facts::{ClockTie, SessionFacts};
pub use evidence::stamp_grid::StampGrid;
pub use evidence::{DiagnoseError, Evidence, PixelEvidence};
pub use fit::effect_scan::EffectGain;
pub use model::hypothesis::Hypothesis;
pub use model::image_pose::ImagePose;
pub use model::library::{
    CandidateEffect, CandidateParameter, CandidateStage, DerivedParameters, FreedNuisance, LIBRARY,
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
