//! Forward selection of effects by held-out log-likelihood.

use super::constants::CameraConstant;
use super::effects::{EFFECTS, ModelEffect};
use super::fit::{ModelEvaluation, ModelFit, fit, paired_gain};
use super::goodness::{NEGLIGIBLE_NATS_PER_EVENT, SIGNIFICANT_STANDARD_ERRORS};
use super::model::CameraModel;
use super::score_scan::ScoreScan;
use super::spread;
use crate::diagnose::Evidence;

/// Effects fitted per round, best by the score scan first (work budget).
const N_CANDIDATES: usize = 3;

/// Optimizer steps: constants, an effect with the constants, and after a change of the thresholds.
const N_STEPS: [usize; 3] = [15, 12, 5];

/// Rounds of thresholds and constants.
const N_SPREAD_ROUNDS: usize = 2;

/// Optimizer steps of a start.
const N_START_STEPS: usize = 1;

/// Gain of a scanned effect in nats below which no fit is tried.
const MIN_SCAN_GAIN_NATS: f64 = 3.0;

/// An accepted effect.
#[derive(Debug, Clone)]
pub(crate) struct SelectionStep {
    pub(crate) effect: &'static ModelEffect,
    /// Held-out gain, nats per event, and its standard error.
    pub(crate) gain: f64,
    pub(crate) error: f64,
    /// Effects fitted in its place, their gains and errors.
    pub(crate) others: Vec<(&'static ModelEffect, f64, f64)>,
}

/// The calibrated camera, and the model with the accepted effects.
#[derive(Debug, Clone)]
pub(crate) struct EffectSelection {
    pub(crate) calibrated: ModelFit,
    pub(crate) fit: ModelFit,
    pub(crate) steps: Vec<SelectionStep>,
    /// Spread of the thresholds and its 90 % interval.
    pub(crate) spread_ci: [f64; 3],
}

/// A fitted candidate.
struct FittedCandidate {
    effect: &'static ModelEffect,
    gain: f64,
    error: f64,
    fit: ModelFit,
}

impl FittedCandidate {
    fn is_significant(&self) -> bool {
        is_significant((self.gain, self.error))
    }
}

pub(crate) fn is_significant((gain, error): (f64, f64)) -> bool {
    gain > NEGLIGIBLE_NATS_PER_EVENT && gain > SIGNIFICANT_STANDARD_ERRORS * error
}

/// Adds effects while their held-out gain is significant; then removes those that the others
/// replace.
pub(crate) fn select(
    evidence: &Evidence,
    max_effects: usize,
    progress: &mut dyn FnMut(&str),
) -> EffectSelection {
    progress("calibration");
    let mut now = fit(evidence, at_best_offset(evidence), N_STEPS[0]);
    let mut spread_ci = [0.0; 3];
    for _ in 0..N_SPREAD_ROUNDS {
        (now, spread_ci) = with_spread(evidence, &now);
    }
    let calibrated = now.clone();
    let mut steps = Vec::new();
    while steps.len() < max_effects {
        progress("effects");
        let mut tried = best_candidates(evidence, &now);
        if !tried.first().is_some_and(FittedCandidate::is_significant) {
            break;
        }
        let FittedCandidate { effect, gain, error, fit } = tried.remove(0);
        progress(&format!("{} is accepted", effect.id));
        let others = tried.iter().map(|c| (c.effect, c.gain, c.error)).collect();
        (now, spread_ci) = with_spread(evidence, &fit);
        steps.push(SelectionStep { effect, gain, error, others });
    }
    let (fit, steps) = without_replaced(evidence, now, steps);
    EffectSelection { calibrated, fit, steps, spread_ci }
}

/// Clock offsets at which the calibration starts, microseconds: the likelihood has several maxima
/// where an edge meets the events of its neighbour.
const START_OFFSETS_US: [f64; 9] = [0.0, 2e3, -2e3, 5e3, -5e3, 10e3, -10e3, 20e3, -20e3];

/// Threshold noise of the starts, in thresholds: wide, so that every start sees its maximum.
const START_NOISE: f64 = 0.15;

/// Constants at their prior means and the offset of the best start.
fn at_best_offset(evidence: &Evidence) -> CameraModel {
    let starts = START_OFFSETS_US.map(|us| {
        let mut model = CameraModel::baseline(evidence);
        model.values[CameraConstant::OffsetUs as usize] = us;
        model.values[CameraConstant::LogNoise as usize] = START_NOISE.ln();
        let started = fit(evidence, model, N_START_STEPS);
        (started.training(evidence), started.model)
    });
    let best = starts.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or_else(|| CameraModel::baseline(evidence), |(_, model)| model)
}

fn with_spread(evidence: &Evidence, now: &ModelFit) -> (ModelFit, [f64; 3]) {
    let (model, interval) = spread::estimate(evidence, &now.model);
    (fit(evidence, model, N_STEPS[2]), interval)
}

/// Fits of the effects with the largest predicted gains, best held-out gain first. An effect with a
/// parameter at the end of its range imitates something else.
fn best_candidates(evidence: &Evidence, now: &ModelFit) -> Vec<FittedCandidate> {
    let scan = ScoreScan::new(evidence, &now.model);
    let is_new = |effect: &&ModelEffect| now.model.effects.iter().all(|own| own.id != effect.id);
    let mut scanned: Vec<(f64, &'static ModelEffect, CameraModel)> = Vec::new();
    for effect in EFFECTS.iter().filter(is_new) {
        let trials = (effect.starts)(evidence).into_iter().map(|start| {
            let trial = now.model.with(effect, &start);
            (scan.gain(evidence, &trial), effect, trial)
        });
        scanned.extend(trials.max_by(|a, b| a.0.total_cmp(&b.0)));
    }
    scanned.sort_by(|a, b| b.0.total_cmp(&a.0));
    scanned.retain(|(gain, ..)| *gain > MIN_SCAN_GAIN_NATS);
    let mut tried: Vec<FittedCandidate> = scanned
        .into_iter()
        .take(N_CANDIDATES)
        .map(|(_, effect, trial)| {
            let fit = fit(evidence, trial, N_STEPS[1]);
            let (gain, error) = paired_gain(evidence, &fit.evaluation, &now.evaluation, true);
            FittedCandidate { effect, gain, error, fit }
        })
        .collect();
    tried.retain(|candidate| !candidate.fit.model.is_at_bound());
    tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    tried
}

/// Backward elimination; the last effect was significant beside all others.
fn without_replaced(
    evidence: &Evidence,
    mut now: ModelFit,
    mut steps: Vec<SelectionStep>,
) -> (ModelFit, Vec<SelectionStep>) {
    let mut index = 0;
    while index + 1 < steps.len() {
        let mut model = now.model.clone();
        model.remove_effect(index);
        let without = fit(evidence, model, N_STEPS[1]);
        let gain = paired_gain(evidence, &now.evaluation, &without.evaluation, true);
        if is_significant(gain) {
            (steps[index].gain, steps[index].error) = gain;
            index += 1;
        } else {
            now = without;
            steps.remove(index);
            index = 0;
        }
    }
    (now, steps)
}

/// Held-out log-likelihood, nats per event.
pub(crate) fn held_out(evidence: &Evidence, evaluation: &ModelEvaluation) -> f64 {
    let n_blocks = evidence.blocks.n();
    let cells = evaluation.cells(evidence);
    let held = (0..cells.len()).filter(|i| evidence.is_held_out(i / n_blocks, i % n_blocks));
    let [sum, n] = held.fold([0.0; 2], |[s, n], i| [s + cells[i][0], n + cells[i][1]]);
    sum / n.max(1.0)
}
