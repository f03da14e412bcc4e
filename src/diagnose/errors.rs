//! Errors of a fitted hypothesis that hold although the model is not the truth.
//!
//! The curvature of the log-likelihood says how far a value moves when the slope does; how much
//! the slope scatters is seen from the data, between tiles of pixels and between blocks of time
//! (Huber, 1967; White, Econometrica 50, 1982; two ways of clustering after Cameron, Gelbach and
//! Miller, J. Bus. Econ. Stat. 29, 2011). The slopes' own product in place of the curvature
//! would claim to know the more, the less the model fits.

use super::Evidence;
use super::fit::Fitted;
use super::summit::{Summit, climbed};
use std::sync::Arc;

/// Standard errors, and the summit that they are taken on.
#[derive(Debug)]
pub(super) struct Errors {
    pub(super) summit: Summit,
    /// By the numbers of the values.
    of: Vec<(usize, f64)>,
}

impl Errors {
    /// That of a value; NaN when it was not free.
    pub(super) fn of(&self, index: usize) -> f64 {
        self.of.iter().find(|(number, _)| *number == index).map_or(f64::NAN, |(_, error)| *error)
    }
}

/// The fit at its summit, with the standard errors of all values inside their ranges.
pub(super) fn with_errors(evidence: &Evidence, fitted: Fitted) -> Fitted {
    let (fitted, summit) = climbed(evidence, fitted);
    let Some(summit) = summit else { return fitted };
    let of = summit.errors(&fitted, evidence.blocks.n());
    Fitted { errors: Some(Arc::new(Errors { summit, of })), ..fitted }
}
