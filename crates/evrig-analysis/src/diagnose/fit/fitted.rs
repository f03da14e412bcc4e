//! A fitted hypothesis with its scores and standard errors.

use super::cell_scores::{CellScores, CellSet};
use super::laplace::LaplaceApproximation;
use crate::diagnose::Hypothesis;
use std::sync::Arc;

/// Standard errors, and the summit that they are taken on.
#[derive(Debug)]
pub(crate) struct StandardErrors {
    pub(crate) laplace: LaplaceApproximation,
    /// By the numbers of the values.
    pub(crate) of: Vec<(usize, f64)>,
}

impl StandardErrors {
    /// That of a value; NaN when it was not free.
    pub(crate) fn of(&self, index: usize) -> f64 {
        self.of.iter().find(|(number, _)| *number == index).map_or(f64::NAN, |(_, error)| *error)
    }
}

/// A fitted hypothesis.
#[derive(Debug, Clone)]
pub(crate) struct FittedModel {
    pub(crate) hypothesis: Hypothesis,
    pub(crate) cells: CellScores,
    /// Standard errors of the values; none before `with_errors`.
    pub(crate) errors: Option<Arc<StandardErrors>>,
}

impl FittedModel {
    /// Score on the training cells, nats an event.
    pub(crate) fn training(&self) -> f64 {
        self.cells.nats(CellSet::Training)
    }

    /// Score on the held-out cells, nats an event.
    pub(crate) fn held_out(&self) -> f64 {
        self.cells.nats(CellSet::HeldOut)
    }

    /// The same, of which all that is made is scored finely, or not.
    pub(crate) fn with_fine_grid(mut self, uses_fine_grid: bool) -> Self {
        self.hypothesis.uses_fine_grid = uses_fine_grid;
        self
    }

    /// This, or another that scores better.
    pub(crate) fn better_of(self, other: Self) -> Self {
        if other.training() > self.training() { other } else { self }
    }

    /// Standard error of a value; NaN when it was not free or is not known.
    pub(crate) fn error_of(&self, index: usize) -> f64 {
        self.errors.as_ref().map_or(f64::NAN, |errors| errors.of(index))
    }
}
