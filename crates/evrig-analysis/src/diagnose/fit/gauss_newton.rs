//! Maximum-likelihood fit on the training cells.
//!
//! Gauss-Newton steps with the outer product of the cells' gradients as Hessian (Berndt, Hall,
//! Hall and Hausman, 1974), Levenberg-Marquardt damping, within the box of the parameters' ranges.
//! Gradients are centred on their mean per event: far from the optimum all cells have the same
//! sign, and the plain product would make steps too short.

use super::cell_scores::{CellSet, score_cells, score_cells_of_each};
use super::fitted::FittedModel;
use crate::diagnose::{Evidence, Hypothesis};
use nalgebra::{DMatrix, DVector};

/// Below this gain, nats per event, of a joint step single parameters are stepped, by these
/// multiples of their Newton steps.
const MIN_JOINT_STEP_GAIN: f64 = 5e-3;
const SINGLE_STEP_MULTIPLES: [f64; 3] = [4.0, 1.0, 0.25];

/// Gain, nats per event, of single steps for which a fit goes on.
const MIN_SINGLE_STEP_GAIN: f64 = 1e-3;

/// Scores a hypothesis.
pub(crate) fn score_model(evidence: &Evidence, hypothesis: Hypothesis) -> FittedModel {
    let cells = score_cells(evidence, &hypothesis);
    FittedModel { hypothesis, cells, errors: None }
}

/// Scores several hypotheses; those with the same signal share it.
pub(crate) fn score_models(evidence: &Evidence, hypotheses: Vec<Hypothesis>) -> Vec<FittedModel> {
    let cells = score_cells_of_each(evidence, &hypotheses.iter().collect::<Vec<_>>());
    let scored = hypotheses.into_iter().zip(cells);
    scored.map(|(hypothesis, cells)| FittedModel { hypothesis, cells, errors: None }).collect()
}

/// Fits by at most `n_steps` steps, until a step gains less than `enough` nats per event.
pub(crate) fn fit(
    evidence: &Evidence,
    start: Hypothesis,
    n_steps: usize,
    enough: f64,
) -> FittedModel {
    improve(evidence, score_model(evidence, start), n_steps, enough)
}

/// The same from a scored hypothesis.
pub(crate) fn improve(
    evidence: &Evidence,
    mut best: FittedModel,
    n_steps: usize,
    enough: f64,
) -> FittedModel {
    let mut damping = 1e-2;
    for _ in 0..n_steps {
        let here = best.with_shared_grid(evidence);
        let (free, gradients) = gradients(evidence, &here);
        if free.is_empty() {
            break;
        }
        let before = best.training();
        if let Some(better) = step(evidence, [&best, &here], &free, &gradients, &mut damping) {
            best = better;
        }
        let objection_to_all = best.training() - before;
        if objection_to_all < MIN_JOINT_STEP_GAIN {
            best = step_each_parameter(evidence, best, &here, &free, &gradients);
        }
        if objection_to_all < enough
            && best.training() - before - objection_to_all < MIN_SINGLE_STEP_GAIN
        {
            break;
        }
    }
    best
}

/// The best of a fit and of Newton steps of single parameters of the last effect; `at` is where
/// the gradients were taken.
///
/// For a nearly noise-free camera the gradients of the thresholds are unreliable, and with them a
/// joint step.
fn step_each_parameter(
    evidence: &Evidence,
    best: FittedModel,
    at: &FittedModel,
    free: &[usize],
    gradients: &DMatrix<f64>,
) -> FittedModel {
    let Some(last) = best.hypothesis.effects.len().checked_sub(1) else { return best };
    let (outer, places) = (scatter(at, gradients), best.hypothesis.value_indices(last));
    let moved = |(i, f): (usize, usize), share: f64| {
        let mut moved = best.hypothesis.clone();
        let [low, high] = moved.ranges[f];
        let change = gradients.column(i).sum() / outer[(i, i)].max(1e-9);
        moved.values[f] = (moved.values[f] + share * change).clamp(low, high);
        moved
    };
    let own = free.iter().copied().enumerate().filter(|(_, f)| places.contains(f));
    let asked = own.flat_map(|own| SINGLE_STEP_MULTIPLES.map(|share| moved(own, share))).collect();
    score_models(evidence, asked).into_iter().fold(best, FittedModel::better_of)
}

/// Gradients of the training cells' log-likelihoods in every free value. `at` uses a shared grid.
pub(crate) fn gradients(evidence: &Evidence, at: &FittedModel) -> (Vec<usize>, DMatrix<f64>) {
    let hypothesis = &at.hypothesis;
    let free: Vec<usize> = (0..hypothesis.values.len())
        .filter(|&i| {
            let [low, high] = hypothesis.ranges[i];
            hypothesis.steps[i] > 0.0 && high > low
        })
        .collect();
    let training: Vec<usize> = at.cells.of(CellSet::Training).collect();
    let mut gradients = DMatrix::zeros(training.len(), free.len());
    let moved: Vec<(Hypothesis, f64)> = free.iter().map(|&i| aside(hypothesis, i)).collect();
    let each: Vec<&Hypothesis> = moved.iter().map(|(moved, _)| moved).collect();
    let there = score_cells_of_each(evidence, &each);
    for (column, (there, (_, step))) in there.iter().zip(&moved).enumerate() {
        for (row, &cell) in training.iter().enumerate() {
            let change = there.log_likelihood[cell] - at.cells.log_likelihood[cell];
            gradients[(row, column)] = change / step;
        }
    }
    (free, gradients)
}

/// The hypothesis with one value moved by its finite-difference step, inwards at the upper bound.
fn aside(hypothesis: &Hypothesis, i: usize) -> (Hypothesis, f64) {
    let [low, high] = hypothesis.ranges[i];
    let mut step = hypothesis.steps[i].min(0.5 * (high - low));
    if hypothesis.values[i] + step > high {
        step = -step;
    }
    let mut moved = hypothesis.clone();
    moved.values[i] += step;
    (moved, step)
}

/// Outer product of the gradients, centred on their mean per event.
pub(crate) fn scatter(at: &FittedModel, gradients: &DMatrix<f64>) -> DMatrix<f64> {
    let n_events: Vec<f64> =
        at.cells.of(CellSet::Training).map(|cell| at.cells.n_events[cell]).collect();
    let all = n_events.iter().sum::<f64>().max(1.0);
    let mut centred = gradients.clone();
    for mut column in centred.column_iter_mut() {
        let mean = column.sum() / all;
        column.iter_mut().zip(&n_events).for_each(|(g, n)| *g -= n * mean);
    }
    centred.transpose() * centred
}

/// One damped step that improves the score, if any; `at` is `own` on a shared grid. After a long
/// step the grid may be too coarse: the step must improve the score without it too.
fn step(
    evidence: &Evidence,
    [own, at]: [&FittedModel; 2],
    free: &[usize],
    gradients: &DMatrix<f64>,
    damping: &mut f64,
) -> Option<FittedModel> {
    let outer = scatter(at, gradients);
    let total: DVector<f64> = gradients.row_sum().transpose();
    for _ in 0..7 {
        let mut damped = outer.clone();
        for i in 0..free.len() {
            damped[(i, i)] += *damping * outer[(i, i)].max(1e-9) + 1e-9;
        }
        // Values at a bound that would leave their range stay.
        let mut wanted = total.clone();
        for (i, &f) in free.iter().enumerate() {
            let [low, high] = at.hypothesis.ranges[f];
            let value = at.hypothesis.values[f];
            if (value <= low && total[i] < 0.0) || (value >= high && total[i] > 0.0) {
                wanted[i] = 0.0;
                for j in 0..free.len() {
                    damped[(i, j)] = 0.0;
                    damped[(j, i)] = 0.0;
                }
                damped[(i, i)] = 1.0;
            }
        }
        let Some(change) = damped.cholesky().map(|c| c.solve(&wanted)) else {
            *damping *= 10.0;
            continue;
        };
        let mut moved = at.hypothesis.clone().off_shared_grid();
        for (i, &f) in free.iter().enumerate() {
            let [low, high] = moved.ranges[f];
            moved.values[f] = (moved.values[f] + change[i]).clamp(low, high);
        }
        let there = score_model(evidence, moved);
        if there.training() > at.training() {
            let there = there.rescored(evidence);
            if there.training() > own.training() {
                *damping = (*damping * 0.2).max(1e-4);
                return Some(there);
            }
        }
        *damping *= 8.0;
    }
    None
}
