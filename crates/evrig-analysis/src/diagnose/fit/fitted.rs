//! A fitted hypothesis with its scores and standard errors.

use super::cell_scores::{CellScores, CellSet};
use super::laplace::LaplaceApproximation;
use crate::diagnose::Hypothesis;
use std::sync::Arc;

/// Standard errors with their Laplace approximation.
#[derive(Debug)]
pub(crate) struct StandardErrors {
    pub(crate) laplace: LaplaceApproximation,
    /// By value index.
    pub(crate) of: Vec<(usize, f64)>,
}

impl StandardErrors {
    /// Standard error of a value; NaN when it was not free.
    pub(crate) fn of(&self, index: usize) -> f64 {
        self.of.iter().find(|(number, _)| *number == index).map_or(f64::NAN, |(_, error)| *error)
    }
}

/// A fitted hypothesis.
#[derive(Debug, Clone)]
pub(crate) struct FittedModel {
    pub(crate) hypothesis: Hypothesis,
    pub(crate) cells: CellScores,
    /// `None` before `with_standard_errors`.
    pub(crate) errors: Option<Arc<StandardErrors>>,
}

impl FittedModel {
    /// Training score, nats per event.
    pub(crate) fn training(&self) -> f64 {
        self.cells.nats(CellSet::Training)
    }

    /// Held-out score, nats per event.
    pub(crate) fn held_out(&self) -> f64 {
        self.cells.nats(CellSet::HeldOut)
    }

    pub(crate) fn with_fine_grid(mut self, uses_fine_grid: bool) -> Self {
        self.hypothesis.uses_fine_grid = uses_fine_grid;
        self
    }

    /// The one with the better training score.
    pub(crate) fn better_of(self, other: Self) -> Self {
        if other.training() > self.training() { other } else { self }
    }

    /// Standard error of a value; NaN when unknown.
    pub(crate) fn error_of(&self, index: usize) -> f64 {
        self.errors.as_ref().map_or(f64::NAN, |errors| errors.of(index))
    }
}
