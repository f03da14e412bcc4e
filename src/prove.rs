//! Concealed trials: does the diagnosis find what was hidden from it?
//!
//! A plan draws what to hide ([`draw()`]); a session is made with it; the truth is written apart
//! and only its checksum stands beside the session before anyone looks ([`seal()`]); the diagnosis
//! runs on the session alone; then the seal is opened and the answer judged ([`judge()`]) and all
//! answers counted ([`Score`]).
//!
//! Every trial leaves a record as soon as it was judged, so that a run that was broken off goes on
//! where it was; the diagnosis is asked in processes of its own ([`Ask`]), which have a time by which
//! to answer and are given nothing but the session's folder.
//!
//! Two families are made here. `world` sessions come from the simulated rig, whose physics is
//! written apart from generators and diagnosis. `plasmode` sessions are a real recording to which
//! one effect was applied ([`plasmode`](mod@plasmode)): they keep whatever a real camera does. A
//! third, `foreign`, is made elsewhere, by other people's simulators, and comes as a folder of
//! sealed sessions ([`Bench::run_ready`]).

mod ask;
mod draw;
mod figure;
mod judge;
mod make;
pub mod plasmode;
mod quick;
mod record;
mod region;
mod run;
mod score;
mod seal;
mod strength;
mod table;
mod truth;

pub use ask::Ask;
pub use draw::{Mix, draw};
pub use figure::figure;
pub use judge::{Answer, Judgement, ParameterCheck, judge};
pub use make::Maker;
pub use quick::{complaints, quick};
pub use record::{Outcome, Plan, Record, RecordError, settle};
pub use run::{Bench, Proof, ProveError, Ready};
pub use score::{PerEffect, Score, Share};
pub use seal::{Seal, SealError, open, seal, sha256};
pub use strength::{Strength, strengths};
pub use table::markdown;
pub use truth::{Concealed, Family, Trial, Truth};
