//! Refinement of a fit without gradients.
//!
//! An event just before or after an extremum of its pixel's signal changes the log-likelihood by
//! several nats, so that the surface is rough: Gauss-Newton stops about 0.1 nats per event below
//! the maximum, several standard errors away. An evolution strategy (CMA-ES, Hansen and
//! Ostermeier, 2001) continues, starting with the covariance from the gradients.

use super::fitted::FittedModel;
use super::gauss_newton::{fit, gradients, improve, scatter, score_model};
use crate::diagnose::{Evidence, Hypothesis, PixelEvidence};
use cmaes::{CMAESOptions, DVector};
use nalgebra::DMatrix;
use std::cell::RefCell;

/// Work per evaluation of a coarse search, in instants of light, and fewest pixels of its subset.
const SUBSET_WORK: usize = 300_000;
const MIN_SUBSET_PIXELS: usize = 30;

const MAX_STEPS_ON_ALL_PIXELS: usize = 6;

/// Work of an event, in instants of light.
const WORK_PER_EVENT: usize = 30;

/// Initial step sizes of the searches on all pixels, in standard errors.
const SETTLING_STEP_SIZES: [f64; 2] = [2.0, 1.0];

/// Searches in a row without a gain that end the coarse refinement, and that on all pixels.
const MAX_FAILED_SEARCHES: usize = 2;
const MAX_FAILED_SETTLING_SEARCHES: usize = 1;

/// Work per evaluation up to which a search has full patience; with more it has less, at least a
/// fifth.
const FULL_PATIENCE_WORK: usize = 400_000;

/// Initial step sizes of successive searches, in standard errors.
const STEP_SIZES: [f64; 6] = [1.0, 3.0, 1.0, 3.0, 1.0, 3.0];

/// Evaluations per free parameter, at most, and in multiples of the patience.
const MAX_EVALUATIONS_PER_PARAMETER: usize = 50;
const MAX_PATIENCES: usize = 2;

/// A search has converged if this many evaluations per parameter gain no more than this.
const CONVERGENCE_WINDOW_PER_PARAMETER: usize = 20;
const CONVERGENCE_NATS: f64 = 0.5;

/// The same for a search with reduced patience.
const CONVERGENCE_NATS_PER_EVENT: f64 = 5e-3;

/// Gain, nats per event, below which a search counts as failed.
const MIN_SEARCH_GAIN: f64 = 1e-3;

/// Stands for a non-finite objective: CMA-ES takes finite numbers only.
const INVALID_OBJECTIVE: f64 = 1e12;

/// Steps of a final fit: clock skew and offset are correlated, which takes many short steps.
pub(crate) const MAX_FINAL_STEPS: usize = 40;

/// Fits and refines a hypothesis.
pub(crate) fn fit_and_refine(
    evidence: &Evidence,
    start: Hypothesis,
    n_steps: usize,
) -> FittedModel {
    refine_locally(evidence, fit_coarse_to_fine(evidence, start, n_steps, 1e-5))
}

/// Fits a hypothesis; for a continuous mixture first on a subset of the pixels, then on all.
pub(crate) fn fit_coarse_to_fine(
    evidence: &Evidence,
    start: Hypothesis,
    n_steps: usize,
    enough: f64,
) -> FittedModel {
    let Some(few) = pixel_subset(evidence, &start) else {
        return fit(evidence, start, n_steps, enough);
    };
    let begun = fit(&few, start.clone(), n_steps, enough);
    let [here, there] = [start, begun.hypothesis].map(|at| score_model(evidence, at));
    improve(evidence, here.better_of(there), n_steps.min(MAX_STEPS_ON_ALL_PIXELS), enough)
}

/// A subset of the pixels for a continuous mixture; `None` if all are few enough.
pub(crate) fn pixel_subset(evidence: &Evidence, hypothesis: &Hypothesis) -> Option<Evidence> {
    let every = if hypothesis.pixel_mixture().is_continuous() {
        subset_stride(evidence, hypothesis)
    } else {
        1
    };
    (every > 1).then(|| evidence.thinned(every))
}

/// Refines a fit; never worse than it was.
pub(crate) fn refine_locally(evidence: &Evidence, fitted: FittedModel) -> FittedModel {
    let work = work(evidence, &fitted.hypothesis);
    let every = subset_stride(evidence, &fitted.hypothesis);
    if every < 2 {
        return run_searches(evidence, fitted, &STEP_SIZES, MAX_FAILED_SEARCHES, patience(work));
    }
    let few = evidence.thinned(every);
    let start = score_model(&few, fitted.hypothesis.clone());
    let rough = run_searches(&few, start, &STEP_SIZES, MAX_FAILED_SEARCHES, patience(work / every));
    // The optimum of the subset may not be better on all pixels.
    let start = fitted.better_of(score_model(evidence, rough.hypothesis));
    if start.hypothesis.pixel_mixture().is_continuous() {
        return improve(evidence, start, MAX_STEPS_ON_ALL_PIXELS, 1e-5);
    }
    run_searches(
        evidence,
        start,
        &SETTLING_STEP_SIZES,
        MAX_FAILED_SETTLING_SEARCHES,
        patience(work),
    )
}

/// Stride between the pixels of a subset.
pub(crate) fn subset_stride(evidence: &Evidence, hypothesis: &Hypothesis) -> usize {
    let wanted =
        pixels_within_work(evidence, hypothesis, SUBSET_WORK, [MIN_SUBSET_PIXELS, usize::MAX]);
    (evidence.pixels.len() / wanted).max(1)
}

/// Number of pixels for an evaluation of bounded work, within bounds.
pub(crate) fn pixels_within_work(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    most_work: usize,
    [least, most]: [usize; 2],
) -> usize {
    let of_one = work(evidence, hypothesis) / evidence.pixels.len().max(1);
    (most_work / of_one.max(1)).clamp(least, most)
}

/// Work of an evaluation, in instants of light: mixtures and laws with several reference levels
/// multiply it.
fn work(evidence: &Evidence, hypothesis: &Hypothesis) -> usize {
    let of = |pixel: &PixelEvidence| pixel.light.len() + WORK_PER_EVENT * pixel.spikes.len();
    let once: usize = evidence.pixels.iter().map(of).sum();
    let law = |pixel| hypothesis.view(evidence, pixel, [0.0; 2], Vec::new()).law;
    let max_reference_states =
        evidence.pixels.first().map_or(1, |pixel| law(pixel).max_reference_states());
    once * hypothesis.pixel_mixture().n_scored() * max_reference_states
}

/// Evaluations per value without a gain after which a search stops.
fn patience(work: usize) -> usize {
    (MAX_EVALUATIONS_PER_PARAMETER * FULL_PATIENCE_WORK / work.max(1))
        .clamp(MAX_EVALUATIONS_PER_PARAMETER / 5, MAX_EVALUATIONS_PER_PARAMETER)
}

/// Successive searches with these initial step sizes, until several in a row fail.
fn run_searches(
    evidence: &Evidence,
    mut fitted: FittedModel,
    steps: &[f64],
    in_vain: usize,
    patience: usize,
) -> FittedModel {
    let mut n_in_vain = 0;
    for (seed, &step) in (1..).zip(steps) {
        let before = fitted.training();
        fitted = if fitted.hypothesis.pixel_mixture().is_continuous() {
            search_with_pinned_strata(evidence, fitted, step, seed)
        } else {
            search_cma_es(evidence, fitted, step, patience, seed)
        };
        let is_in_vain = fitted.training() - before < MIN_SEARCH_GAIN;
        n_in_vain = if is_in_vain { n_in_vain + 1 } else { 0 };
        if n_in_vain == in_vain {
            break;
        }
    }
    fitted
}

/// A search with pinned pixel strata, which is much less work, followed by gradient steps with
/// unknown strata, whose sum smooths the surface.
fn search_with_pinned_strata(
    evidence: &Evidence,
    fitted: FittedModel,
    step: f64,
    seed: u64,
) -> FittedModel {
    let pinned = score_model(evidence, fitted.hypothesis.clone().pin_strata(evidence));
    let patience = patience(work(evidence, &pinned.hypothesis));
    let found = search_cma_es(evidence, pinned, step, patience, seed);
    let there = score_model(evidence, found.hypothesis.unpin_strata(&fitted.hypothesis));
    if there.training() > fitted.training() {
        return improve(evidence, there, MAX_STEPS_ON_ALL_PIXELS, 1e-4);
    }
    fitted
}

fn search_cma_es(
    evidence: &Evidence,
    fitted: FittedModel,
    step: f64,
    patience: usize,
    seed: u64,
) -> FittedModel {
    let held = fitted.with_shared_grid(evidence);
    let (free, gradients) = gradients(evidence, &held);
    let Some(spread) = covariance_root(&held, &free, &gradients) else { return fitted };
    let start = held.hypothesis.clone();
    let at = |point: &[f64]| -> Hypothesis {
        let mut moved = start.clone();
        let by = &spread * nalgebra::DVector::from_column_slice(point);
        for (i, &f) in free.iter().enumerate() {
            let [low, high] = moved.ranges[f];
            moved.values[f] = (moved.values[f] + by[i]).clamp(low, high);
        }
        moved
    };
    let mut best = held;
    // Best score after every evaluation.
    let course = RefCell::new(Vec::new());
    let evaluate = |point: &DVector<f64>| {
        let there = score_model(evidence, at(point.as_slice()));
        let nats = there.training();
        if nats > best.training() {
            best = there;
        }
        course.borrow_mut().push(best.training());
        if nats.is_finite() { -nats } else { INVALID_OBJECTIVE }
    };
    let options = CMAESOptions::new(vec![0.0; free.len()], step)
        .max_function_evals(
            MAX_EVALUATIONS_PER_PARAMETER.min(MAX_PATIENCES * patience) * free.len(),
        )
        .seed(seed);
    // Options are invalid only without free values.
    if let Ok(mut state) = options.build(evaluate) {
        let least = CONVERGENCE_NATS / evidence.n_events().max(1) as f64;
        let enough = if patience < MAX_EVALUATIONS_PER_PARAMETER {
            CONVERGENCE_NATS_PER_EVENT.max(least)
        } else {
            least
        };
        while !has_come_to_rest(
            &course.borrow(),
            patience.min(CONVERGENCE_WINDOW_PER_PARAMETER) * free.len(),
            enough,
        ) {
            if state.next().is_some() {
                break;
            }
        }
    }
    fitted.better_of(best.rescored(evidence))
}

/// Whether the last evaluations gained no more than `enough`.
fn has_come_to_rest(course: &[f64], n_last: usize, enough: f64) -> bool {
    let before = course.len().checked_sub(n_last + 1).map(|at| course[at]);
    before.zip(course.last()).is_some_and(|(before, last)| last - before <= enough)
}

/// Cholesky root of the covariance from the gradients.
fn covariance_root(
    fitted: &FittedModel,
    free: &[usize],
    gradients: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let mut outer = scatter(fitted, gradients);
    for (i, &f) in free.iter().enumerate() {
        // Prior variance for unidentified values.
        let [low, high] = fitted.hypothesis.ranges[f];
        outer[(i, i)] += (0.2 * (high - low)).powi(-2);
    }
    Some(outer.cholesky()?.inverse().cholesky()?.l())
}
