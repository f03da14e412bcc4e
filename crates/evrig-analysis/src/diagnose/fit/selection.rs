//! Forward selection of effects by held-out log-likelihood.

use crate::diagnose::Evidence;
use crate::diagnose::fit::candidate::EffectCandidate;
use crate::diagnose::fit::coarse_pixels::{CoarsePixels, N_STEPS, refined};
use crate::diagnose::fit::optimizer::{FitTolerance, ModelEvaluation, ModelFit, fit};
use crate::diagnose::fit::paired_gain::PairedGain;
use crate::diagnose::fit::search::{EffectSearch, FittedCandidate};
use crate::diagnose::fit::spread;
use crate::diagnose::levels::DOUBT_STANDARD_ERRORS;
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::test::goodness::GoodnessOfFit;
use evrig_core::effect_id::EffectId;

/// Rounds of thresholds and constants.
const N_SPREAD_ROUNDS: usize = 2;

/// An accepted effect.
#[derive(Debug, Clone)]
pub(crate) struct SelectionStep {
    pub(crate) candidate: EffectCandidate,
    pub(crate) id: EffectId,
    pub(crate) gain: PairedGain,
    /// Effects fitted in its place, and their gains.
    pub(crate) others: Vec<(EffectId, PairedGain)>,
}

/// The calibrated camera, and the model with the accepted effects.
#[derive(Debug, Clone)]
pub(crate) struct EffectSelection {
    pub(crate) calibrated: ModelFit,
    pub(crate) fit: ModelFit,
    pub(crate) steps: Vec<SelectionStep>,
    /// Spread of the thresholds and its 90 % interval.
    pub(crate) spread_ci: [f64; 3],
    /// Goodness of `fit`.
    pub(crate) goodness: GoodnessOfFit,
}

/// Adds effects while a test doubts the model and their held-out gain is significant; then removes
/// those that the others replace.
pub(crate) fn select(
    evidence: &Evidence,
    max_effects: usize,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> EffectSelection {
    progress("calibration");
    let coarse = CoarsePixels::of(evidence);
    let mut now = coarse.refit(evidence, &CameraModel::baseline(evidence));
    let mut spread_ci;
    (now, spread_ci) = with_spread(evidence, now);
    let calibrated = now.clone();
    let mut steps = Vec::new();
    if let Some((step, fit)) = with_bursts(evidence, &coarse, &now) {
        (now, spread_ci) = with_spread(evidence, fit);
        steps.push(step);
    }
    let mut goodness = GoodnessOfFit::of(evidence, &now, seed);
    let mut search = EffectSearch::new(evidence, &coarse);
    while steps.len() < max_effects && goodness.is_doubted() {
        progress("effects");
        let tried = search.candidates(&now);
        let Some((step, fit)) = accepted(evidence, &coarse, tried) else { break };
        progress(&format!("{} is accepted", step.id));
        (now, spread_ci) = with_spread(evidence, fit);
        steps.push(step);
        goodness = GoodnessOfFit::of(evidence, &now, seed);
    }
    let n_accepted = steps.len();
    let (fit, steps) = without_replaced(evidence, &coarse, now, steps);
    if steps.len() < n_accepted {
        goodness = GoodnessOfFit::of(evidence, &fit, seed);
    }
    EffectSelection { calibrated, fit, steps, spread_ci, goodness }
}

/// The bursts that follow the camera's own frames, where they account for held-out events.
fn with_bursts(
    evidence: &Evidence,
    coarse: &CoarsePixels,
    now: &ModelFit,
) -> Option<(SelectionStep, ModelFit)> {
    evidence.bursts.as_ref()?;
    let candidate = EffectCandidate::structural(EffectId::ApsCoupling)?;
    let start = candidate.starts(evidence, &now.model).pop()?;
    let fit = coarse.refit(evidence, &start);
    let gain = PairedGain::of(evidence, &fit.evaluation, &now.evaluation);
    let id = EffectId::ApsCoupling;
    let step = SelectionStep { candidate, id, gain, others: Vec::new() };
    candidate.is_significant(evidence, gain).then_some((step, fit))
}

/// The best significant candidate, fitted with all constants.
fn accepted(
    evidence: &Evidence,
    coarse: &CoarsePixels,
    mut tried: Vec<FittedCandidate>,
) -> Option<(SelectionStep, ModelFit)> {
    while tried.first().is_some_and(|best| best.is_significant) {
        let (best, fitted) = best_of_rivals(coarse, &tried);
        let FittedCandidate { candidate, id, gain, .. } = tried.remove(best);
        let fit = refined(evidence, fitted);
        if !candidate.is_refused(evidence, &fit.model) {
            let others = tried.iter().map(|c| (c.id, c.gain)).collect();
            return Some((SelectionStep { candidate, id, gain, others }, fit));
        }
    }
    None
}

/// Share of the largest gain from which a candidate rivals the best one: a profile, in which the
/// constants follow to first order, orders gains to about a quarter.
const RIVAL_SHARE: f64 = 0.75;

/// The best of the candidates with nearly the largest gain, each fitted with all constants to a part
/// of the pixels.
fn best_of_rivals(coarse: &CoarsePixels, tried: &[FittedCandidate]) -> (usize, ModelFit) {
    let is_rival = |(_, c): &(usize, &FittedCandidate)| {
        c.is_significant && c.gain.mean >= RIVAL_SHARE * tried[0].gain.mean
    };
    let rivals = tried.iter().enumerate().filter(is_rival);
    let fitted = rivals.map(|(index, c)| (index, coarse.fit(&c.fit.model)));
    let score = |fit: &ModelFit| held_out(&coarse.evidence, &fit.evaluation);
    let best = fitted.max_by(|a, b| score(&a.1).total_cmp(&score(&b.1)));
    best.unwrap_or_else(|| (0, coarse.fit(&tried[0].fit.model)))
}

fn with_spread(evidence: &Evidence, mut now: ModelFit) -> (ModelFit, [f64; 3]) {
    let mut spread_ci = [0.0; 3];
    for _ in 0..N_SPREAD_ROUNDS {
        let (model, interval) = spread::estimate(evidence, &now.model);
        now = fit(evidence, model, N_STEPS[1], FitTolerance::Fine);
        spread_ci = interval;
    }
    (now, spread_ci)
}

/// Backward elimination of the effects whose gain beside the others has fallen and is no longer
/// significant; the last effect was significant beside all others.
fn without_replaced(
    evidence: &Evidence,
    coarse: &CoarsePixels,
    mut now: ModelFit,
    mut steps: Vec<SelectionStep>,
) -> (ModelFit, Vec<SelectionStep>) {
    let mut index = 0;
    while index + 1 < steps.len() {
        let mut model = now.model.clone();
        steps[index].candidate.remove(evidence, &mut model);
        let (without, _) = with_spread(evidence, coarse.refit(evidence, &model));
        let gain = PairedGain::of(evidence, &now.evaluation, &without.evaluation);
        let accepted = steps[index].gain;
        let has_fallen = gain.mean < accepted.mean - DOUBT_STANDARD_ERRORS * accepted.error;
        if !has_fallen || steps[index].candidate.is_significant(evidence, gain) {
            steps[index].gain = gain;
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
