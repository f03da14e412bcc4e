//! Concealed trials: does the diagnosis find the effects that were concealed from it?
//!
//! [`draw()`] draws the concealed effects of each trial from a seed. A session is made with them;
//! the truth is written to a separate folder and only its checksum is stored with the session
//! ([`seal()`]). The diagnosis runs on the session alone. Then the seal is opened, the answer
//! judged ([`judge()`]) and all judgements counted ([`ProofScore`]).
//!
//! Every trial writes a record when it is judged, so an interrupted run can be resumed. The
//! diagnosis runs in its own processes with a deadline ([`DiagnosisProcess`]) and gets only the
//! session's path.
//!
//! Two families are made here. `world` sessions come from the simulated rig, whose physics shares
//! no code with generators and diagnosis. `plasmode` sessions are a real recording to which one
//! effect was applied ([`plasmode`](mod@plasmode)), so all properties of the real camera remain.
//! Sessions of the family `third_party` are made by a third-party simulator and are read from a
//! folder of sealed sessions ([`ProofRun::run_prepared`]).

mod answer;
mod diagnosis_process;
mod draw;
mod error;
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

pub use answer::{AnsweredEffect, DiagnosisAnswer};
pub use diagnosis_process::DiagnosisProcess;
pub use draw::{TrialMix, draw};
pub use error::ProveError;
pub use figure::figure;
pub use judge::{Judgement, ParameterCheck, judge};
pub use make::SessionMaker;
pub use quick::{quick, quick_failures};
pub use record::{DiagnosisOutcome, ProofFolderError, ProofPlan, TrialRecord, claim_folder};
pub use run::{PreparedTrials, Proof, ProofRun};
pub use score::{CountedShare, PerEffect, ProofScore};
pub use seal::{Seal, SealError, open, seal, sha256};
pub use strength::{StrengthScale, strengths};
pub use table::markdown;
pub use truth::{ConcealedEffect, ConcealedTrial, Family, SealedTruth};
