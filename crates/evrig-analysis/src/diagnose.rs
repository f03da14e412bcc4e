//! Which physics does the model leave out?
//!
//! A baseline law of the pixels is fitted to the events that were seen, together with the nuisances
//! every recording has (thresholds, leak, noise, background, the clocks' offset), each held within
//! its ordinary range. Then every effect of the library is added in turn and refitted, not
//! linearised, together with them, on training blocks of pixels and time; what it buys on held-out
//! blocks, in nats per event, ranks it. Effects are taken one by one while they buy more than the
//! same search finds in events drawn from the model itself, and more than a hundredth of the excess.
//! What no effect explains is said to be unexplained.

mod around;
mod boost;
mod camera;
mod candidate;
mod ceiling;
mod census;
mod check;
mod choose;
mod coarse;
mod conclude;
mod constancy;
mod curve;
mod dead_times;
mod ends;
mod errors;
mod evidence;
mod facts;
mod fit;
mod free_run;
mod halves;
mod heat;
mod hypothesis;
mod judge;
mod kinds;
mod mixture;
mod naming;
mod nuisance;
mod null;
mod options;
mod places;
mod placing;
mod polish;
mod propose;
mod prune;
mod region;
mod scan;
mod score;
mod select;
mod spectrum;
mod star;
mod starts;
mod stated;
mod strata;
mod summit;
mod tuned;
mod verdict;

pub use camera::{FittedCamera, surroundings};
pub use candidate::{Candidate, Derived, Freed, LIBRARY, Parameter, Stage};
pub use coarse::StampGrid;
pub use evidence::{DiagnoseError, Evidence, PixelEvidence};
pub use facts::{Facts, TiedClocks};
pub use free_run::{BeforeAfter, FreeRun, beside_free_run, free_run};
pub use heat::{HeatMap, HeatValue};
pub use hypothesis::{Hypothesis, View};
pub use mixture::{Kind, Mixture};
pub use nuisance::Nuisance;
pub use options::Options;
pub use placing::Placing;
pub use scan::Gain;
pub use select::{Diagnosed, diagnose};
pub use stated::Departure;
pub use tuned::{Seen, Tuned};
pub use verdict::{
    CannotJudge, Diagnosis, FitReport, FittedEffect, Half, HeldOut, Interval, Leftover, Mismatch,
    NullReport, ProposedTerm, Rival, StructureLeft, StructureReport, Suspect, Verdict, Where,
};

#[cfg(test)]
mod tests;
