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

pub use evidence::session_facts::{Facts, TiedClocks};
pub use evidence::stamp_grid::StampGrid;
pub use evidence::{DiagnoseError, Evidence, PixelEvidence};
pub use fit::effect_scan::Gain;
pub use model::hypothesis::{Hypothesis, View};
pub use model::image_pose::Placing;
pub use model::library::{Candidate, Derived, Freed, LIBRARY, Parameter, Stage};
pub use model::nuisance::Nuisance;
pub use model::pixel_mixture::{Kind, Mixture};
pub use model::registration::{Seen, Tuned};
pub use options::Options;
pub use report::departure::Departure;
pub use report::diagnosis_report::{
    CannotJudge, Diagnosis, FitReport, FittedEffect, Half, HeldOut, Interval, Leftover, Mismatch,
    NullReport, ProposedTerm, Rival, StructureLeft, StructureReport, Suspect, Verdict, Where,
};
pub use report::fitted_camera::{FittedCamera, surroundings};
pub use report::forward_simulation::{BeforeAfter, FreeRun, beside_free_run, free_run};
pub use report::heat_map::{HeatMap, HeatValue};
pub use search::{Diagnosed, diagnose};

#[cfg(test)]
mod tests;
