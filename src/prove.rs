//! Concealed trials: does the diagnosis find what was hidden from it?
//!
//! A plan draws what to hide ([`draw()`]); a session is made with it; the truth is written apart
//! and only its checksum stands beside the session before anyone looks ([`seal()`]); the diagnosis
//! runs on the session alone; then the seal is opened and the answer judged ([`judge()`]) and all
//! answers counted ([`Score`]).
//!
//! Two families are made here. `world` sessions come from the simulated rig, whose physics is
//! written apart from generators and diagnosis. `plasmode` sessions are a real recording to which
//! one effect was applied ([`plasmode`](mod@plasmode)): they keep whatever a real camera does.

mod draw;
mod judge;
pub mod plasmode;
mod run;
mod score;
mod seal;
mod strength;
mod table;
mod truth;

pub use draw::{Mix, draw};
pub use judge::{Answer, Judgement, ParameterCheck, judge};
pub use run::{Bench, Proof, ProveError};
pub use score::{PerEffect, Score, Share};
pub use seal::{Seal, SealError, open, seal};
pub use strength::{Strength, strengths};
pub use table::markdown;
pub use truth::{Concealed, Family, Rectangle, Trial, Truth};
