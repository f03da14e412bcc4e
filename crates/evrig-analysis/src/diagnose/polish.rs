//! The last steps of a fit, which slopes do not show.
//!
//! An event that comes just before or just behind the crest of its pixel's light changes its
//! log-likelihood by several nats, so the whole is a ridge full of small steps: Gauss and Newton's
//! method stops on its flank, a tenth of a nat an event below the crest and several standard errors
//! beside it. An evolution strategy (CMA-ES, Hansen and Ostermeier, 2001) needs no slopes. It begins
//! with the scatter that the gradients claim.

use super::fit::{Fitted, as_it_is, fit, gradients, improved, scatter};
use super::{Evidence, Hypothesis, PixelEvidence};
use cmaes::{CMAESOptions, DVector};
use nalgebra::DMatrix;
use std::cell::RefCell;

/// Work of an evaluation, in instants of light, with which the crest is looked for, in pixels enough to
/// see the whole sensor. On all of them the search then only has to settle.
const FEW_WORK: usize = 300_000;
const LEAST_PIXELS: usize = 30;

/// Steps with all pixels behind a way that was gone with a few, and with all kinds behind one of known kinds.
const STEPS_ON_ALL: usize = 6;

/// An event is as much work as so many instants of light.
const EVENT_WORK: usize = 30;

/// First steps of settling.
const FINE_STEPS: [f64; 2] = [2.0, 1.0];

/// Searches in a row that have to be in vain where a crest is looked for, and where it is settled on.
const IN_VAIN: usize = 2;
const SETTLED_IN_VAIN: usize = 1;

/// Work with which a search is as patient as can be; where each evaluation is more it is less so, at the
/// least a fifth.
const ALL_WORK: usize = 400_000;

/// First steps, in what the gradients claim for standard errors: one search after another.
const STEPS: [f64; 6] = [1.0, 3.0, 1.0, 3.0, 1.0, 3.0];

/// Evaluations for each value that may move, at most, and so many times its patience for an impatient search.
const PER_VALUE: usize = 50;
const PATIENCES: usize = 2;

/// A search has come to rest when so many evaluations for each value have gained no more than so many nats.
const AT_REST: usize = 20;
const REST_NATS: f64 = 0.5;

/// An impatient search has when it has gained no more than this, nats an event.
const REST: f64 = 5e-3;

/// What one of two searches has to gain, nats an event, for another to follow.
const WORTH_ANOTHER: f64 = 1e-3;

/// Stands for no value: the search takes finite numbers only.
const NO_VALUE: f64 = 1e12;

/// A hypothesis fitted by so many steps at the most, and gone on with from there.
pub(super) fn fitted_and_polished(
    evidence: &Evidence,
    start: Hypothesis,
    n_steps: usize,
) -> Fitted {
    polished(evidence, fitted(evidence, start, n_steps, 1e-5))
}

/// A hypothesis fitted by so many steps at the most. Where pixels have each a value of their own, so that each
/// evaluation is much work, the way is gone with a few of them, and all say where it ends.
pub(super) fn fitted(
    evidence: &Evidence,
    start: Hypothesis,
    n_steps: usize,
    enough: f64,
) -> Fitted {
    let Some(few) = few_of(evidence, &start) else {
        return fit(evidence, start, n_steps, enough);
    };
    let begun = fit(&few, start.clone(), n_steps, enough);
    let [here, there] = [start, begun.hypothesis].map(|at| as_it_is(evidence, at));
    improved(evidence, here.or_better(there), n_steps.min(STEPS_ON_ALL), enough)
}

/// The pixels with which a way is gone, where they have each a value of their own and are too many for that.
pub(super) fn few_of(evidence: &Evidence, hypothesis: &Hypothesis) -> Option<Evidence> {
    let every = if hypothesis.kinds().is_even() { every(evidence, hypothesis) } else { 1 };
    (every > 1).then(|| evidence.thinned(every))
}

/// A fit gone on with where slopes have left it; never worse than it was.
pub(super) fn polished(evidence: &Evidence, fitted: Fitted) -> Fitted {
    let work = work(evidence, &fitted.hypothesis);
    let every = every(evidence, &fitted.hypothesis);
    if every < 2 {
        return searches(evidence, fitted, &STEPS, IN_VAIN, patience(work));
    }
    let few = evidence.thinned(every);
    let start = as_it_is(&few, fitted.hypothesis.clone());
    let rough = searches(&few, start, &STEPS, IN_VAIN, patience(work / every));
    // What is best for few may not be for all.
    let start = fitted.or_better(as_it_is(evidence, rough.hypothesis));
    if start.hypothesis.kinds().is_even() {
        return improved(evidence, start, STEPS_ON_ALL, 1e-5);
    }
    searches(evidence, start, &FINE_STEPS, SETTLED_IN_VAIN, patience(work))
}

/// Every so many-th pixel is looked at.
pub(super) fn every(evidence: &Evidence, hypothesis: &Hypothesis) -> usize {
    let wanted = pixels_for(evidence, hypothesis, FEW_WORK, [LEAST_PIXELS, usize::MAX]);
    (evidence.pixels.len() / wanted).max(1)
}

/// How many pixels may be looked at for an evaluation to be so much work, in instants of light; within bounds.
pub(super) fn pixels_for(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    most_work: usize,
    [least, most]: [usize; 2],
) -> usize {
    let of_one = work(evidence, hypothesis) / evidence.pixels.len().max(1);
    (most_work / of_one.max(1)).clamp(least, most)
}

/// How much an evaluation is, in instants of light: pixels of several kinds are scored several times, and what
/// a pixel may compare with is followed side by side.
fn work(evidence: &Evidence, hypothesis: &Hypothesis) -> usize {
    let of = |pixel: &PixelEvidence| pixel.light.len() + EVENT_WORK * pixel.spikes.len();
    let once: usize = evidence.pixels.iter().map(of).sum();
    let law = |pixel| hypothesis.view(evidence, pixel, [0.0; 2], Vec::new()).law;
    let n_memories = evidence.pixels.first().map_or(1, |pixel| law(pixel).max_reference_states());
    once * hypothesis.kinds().n_scored() * n_memories
}

/// How many evaluations for each value a search goes on for without a gain.
fn patience(work: usize) -> usize {
    (PER_VALUE * ALL_WORK / work.max(1)).clamp(PER_VALUE / 5, PER_VALUE)
}

/// Searches one behind the other, with these first steps, until so many in a row are in vain.
fn searches(
    evidence: &Evidence,
    mut fitted: Fitted,
    steps: &[f64],
    in_vain: usize,
    patience: usize,
) -> Fitted {
    let mut n_in_vain = 0;
    for (seed, &step) in (1..).zip(steps) {
        let before = fitted.training();
        fitted = if fitted.hypothesis.kinds().is_even() {
            searched_of_known_kinds(evidence, fitted, step, seed)
        } else {
            searched(evidence, fitted, step, patience, seed)
        };
        let is_in_vain = fitted.training() - before < WORTH_ANOTHER;
        n_in_vain = if is_in_vain { n_in_vain + 1 } else { 0 };
        if n_in_vain == in_vain {
            break;
        }
    }
    fitted
}

/// The same where pixels have each a value of their own: with each taken to have its likeliest, which is scored once
/// where all are many times the work. A sum over all of them smooths the ridge: from what is better under that too,
/// slopes lead along it.
fn searched_of_known_kinds(evidence: &Evidence, fitted: Fitted, step: f64, seed: u64) -> Fitted {
    let pinned = as_it_is(evidence, fitted.hypothesis.clone().pinned(evidence));
    let patience = patience(work(evidence, &pinned.hypothesis));
    let found = searched(evidence, pinned, step, patience, seed);
    let there = as_it_is(evidence, found.hypothesis.unpinned(&fitted.hypothesis));
    if there.training() > fitted.training() {
        return improved(evidence, there, STEPS_ON_ALL, 1e-4);
    }
    fitted
}

fn searched(evidence: &Evidence, fitted: Fitted, step: f64, patience: usize, seed: u64) -> Fitted {
    let held = fitted.held(evidence);
    let (free, gradients) = gradients(evidence, &held);
    let Some(spread) = spread(&held, &free, &gradients) else { return fitted };
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
    // The best so far, behind every evaluation.
    let course = RefCell::new(Vec::new());
    let evaluate = |point: &DVector<f64>| {
        let there = as_it_is(evidence, at(point.as_slice()));
        let nats = there.training();
        if nats > best.training() {
            best = there;
        }
        course.borrow_mut().push(best.training());
        if nats.is_finite() { -nats } else { NO_VALUE }
    };
    let options = CMAESOptions::new(vec![0.0; free.len()], step)
        .max_function_evals(PER_VALUE.min(PATIENCES * patience) * free.len())
        .seed(seed);
    // Options are wrong only for no coordinates at all; then the start is the answer.
    if let Ok(mut state) = options.build(evaluate) {
        let least = REST_NATS / evidence.n_events().max(1) as f64;
        let enough = if patience < PER_VALUE { REST.max(least) } else { least };
        while !is_at_rest(&course.borrow(), patience.min(AT_REST) * free.len(), enough) {
            if state.next().is_some() {
                break;
            }
        }
    }
    fitted.or_better(best.released(evidence))
}

/// Whether the last evaluations have gained no more than `enough`.
fn is_at_rest(course: &[f64], n_last: usize, enough: f64) -> bool {
    let before = course.len().checked_sub(n_last + 1).map(|at| course[at]);
    before.zip(course.last()).is_some_and(|(before, last)| last - before <= enough)
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
