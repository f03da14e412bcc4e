//! The last steps of a fit, which slopes do not show.
//!
//! An event that comes just before or just behind the crest of its pixel's light changes its
//! log-likelihood by several nats, so the whole is a ridge full of small steps: Gauss and Newton's
//! method stops on its flank, a tenth of a nat an event below the crest and several standard errors
//! beside it. An evolution strategy (CMA-ES, Hansen and Ostermeier, 2001) needs no slopes. It begins
//! with the scatter that the gradients claim.

use super::fit::{Fitted, as_it_is, gradients, scatter};
use super::score::Part;
use super::{Evidence, Hypothesis};
use cmaes::{CMAESOptions, DVector};
use nalgebra::DMatrix;

/// First steps, in what the gradients claim for standard errors: one search after another.
const STEPS: [f64; 6] = [3.0, 10.0, 3.0, 3.0, 1.0, 3.0];

/// Evaluations for each value that may move.
const PER_VALUE: usize = 50;

/// What one of two searches has to gain, nats an event, for another to follow.
const WORTH_ANOTHER: f64 = 1e-3;

/// Stands for no value: the search takes finite numbers only.
const NO_VALUE: f64 = 1e12;

/// A fit gone on with where slopes have left it; never worse than it was.
pub(super) fn polished(evidence: &Evidence, mut fitted: Fitted) -> Fitted {
    let mut n_in_vain = 0;
    for (round, step) in STEPS.into_iter().enumerate() {
        let before = fitted.cells.nats(Part::Training);
        fitted = searched(evidence, fitted, step, round as u64 + 1);
        let is_in_vain = fitted.cells.nats(Part::Training) - before < WORTH_ANOTHER;
        n_in_vain = if is_in_vain { n_in_vain + 1 } else { 0 };
        if n_in_vain == 2 {
            break;
        }
    }
    fitted
}

fn searched(evidence: &Evidence, fitted: Fitted, step: f64, seed: u64) -> Fitted {
    let (free, gradients) = gradients(evidence, &fitted);
    let Some(spread) = spread(&fitted, &free, &gradients) else { return fitted };
    let start = fitted.hypothesis.clone();
    let at = |point: &[f64]| -> Hypothesis {
        let mut moved = start.clone();
        let by = &spread * nalgebra::DVector::from_column_slice(point);
        for (i, &f) in free.iter().enumerate() {
            let [low, high] = moved.ranges[f];
            moved.values[f] = (moved.values[f] + by[i]).clamp(low, high);
        }
        moved
    };
    let mut best = fitted;
    let evaluate = |point: &DVector<f64>| {
        let there = as_it_is(evidence, at(point.as_slice()));
        let nats = there.cells.nats(Part::Training);
        if nats > best.cells.nats(Part::Training) {
            best = there;
        }
        if nats.is_finite() { -nats } else { NO_VALUE }
    };
    let options = CMAESOptions::new(vec![0.0; free.len()], step)
        .max_function_evals(PER_VALUE * free.len())
        .seed(seed);
    // Options are wrong only for no coordinates at all; then the start is the answer.
    if let Ok(mut state) = options.build(evaluate) {
        state.run();
    }
    best
}

/// A root of the covariance that the gradients claim.
fn spread(fitted: &Fitted, free: &[usize], gradients: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut outer = scatter(fitted, gradients);
    for (i, &f) in free.iter().enumerate() {
        // What the events do not tell stays within its range.
        let [low, high] = fitted.hypothesis.ranges[f];
        outer[(i, i)] += (0.2 * (high - low)).powi(-2);
    }
    Some(outer.cholesky()?.inverse().cholesky()?.l())
}
