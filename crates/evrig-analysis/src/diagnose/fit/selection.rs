//! Forward selection of effects by held-out log-likelihood.

use crate::diagnose::Evidence;
use crate::diagnose::fit::candidate::EffectCandidate;
use crate::diagnose::fit::optimizer::{
    FitTolerance, ModelEvaluation, ModelFit, fit, fit_coordinates, paired_gain,
};
use crate::diagnose::fit::profile::fit_profile;
use crate::diagnose::fit::score_scan::{ScanGain, ScoreScan};
use crate::diagnose::fit::spread;
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::constants::CameraConstant;
use crate::diagnose::test::goodness::GoodnessOfFit;
use evrig_core::effect_id::EffectId;
use std::cmp::Ordering;
use std::collections::BTreeSet;

/// Effects fitted per round with a wide noise, best by the score scan first, and with the fitted one
/// (work budget).
const N_CANDIDATES: [usize; 2] = [8, 4];

/// Largest number of optimizer steps with a part of the pixels, and with all.
const N_STEPS: [usize; 2] = [10, 12];

/// Rounds of thresholds and constants.
const N_SPREAD_ROUNDS: usize = 2;

/// Optimizer steps of a start, and of an effect along its profile.
const N_START_STEPS: usize = 4;
const N_PROFILE_STEPS: usize = 8;

/// Events of a coarse fit; all pixels refine it.
const N_COARSE_EVENTS: usize = 4_000;

/// Gain of a scanned effect in nats below which no fit is tried.
const MIN_SCAN_GAIN_NATS: f64 = 3.0;

/// An accepted effect.
#[derive(Debug, Clone)]
pub(crate) struct SelectionStep {
    pub(crate) candidate: EffectCandidate,
    pub(crate) id: EffectId,
    /// Held-out gain, nats per event, and its standard error.
    pub(crate) gain: f64,
    pub(crate) error: f64,
    /// Effects fitted in its place, their gains and errors.
    pub(crate) others: Vec<(EffectId, f64, f64)>,
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

/// A fitted candidate.
struct FittedCandidate {
    candidate: EffectCandidate,
    id: EffectId,
    gain: f64,
    error: f64,
    fit: ModelFit,
    is_significant: bool,
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
    while steps.len() < max_effects && goodness.is_doubted() {
        progress("effects");
        let Some((step, fit)) =
            accepted(evidence, &coarse, best_candidates(evidence, &coarse, &now))
        else {
            break;
        };
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
    let (gain, error) = paired_gain(evidence, &fit.evaluation, &now.evaluation);
    let id = EffectId::ApsCoupling;
    let step = SelectionStep { candidate, id, gain, error, others: Vec::new() };
    candidate.is_significant(evidence, (gain, error)).then_some((step, fit))
}

/// The best significant candidate, fitted with all constants.
fn accepted(
    evidence: &Evidence,
    coarse: &CoarsePixels,
    mut tried: Vec<FittedCandidate>,
) -> Option<(SelectionStep, ModelFit)> {
    while tried.first().is_some_and(|best| best.is_significant) {
        let (best, fitted) = best_of_rivals(coarse, &tried);
        let FittedCandidate { candidate, id, gain, error, .. } = tried.remove(best);
        let fit = refined(evidence, fitted);
        if !candidate.is_refused(evidence, &fit.model) {
            let others = tried.iter().map(|c| (c.id, c.gain, c.error)).collect();
            return Some((SelectionStep { candidate, id, gain, error, others }, fit));
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
        c.is_significant && c.gain >= RIVAL_SHARE * tried[0].gain
    };
    let rivals = tried.iter().enumerate().filter(is_rival);
    let fitted = rivals.map(|(index, c)| (index, coarse.fit(&c.fit.model)));
    let score = |fit: &ModelFit| held_out(&coarse.evidence, &fit.evaluation);
    let best = fitted.max_by(|a, b| score(&a.1).total_cmp(&score(&b.1)));
    best.unwrap_or_else(|| (0, coarse.fit(&tried[0].fit.model)))
}

/// Threshold noise of a search, in thresholds: wide against the innovations that an effect causes,
/// so that the likelihood has one maximum. The fitted noise follows (graduated optimization).
const WIDE_NOISE: f64 = 0.15;

/// A coarse number of pixels.
struct CoarsePixels {
    /// Every `n`-th pixel is taken.
    n: usize,
    evidence: Evidence,
    /// Constants at which its fits start.
    start: CameraModel,
}

impl CoarsePixels {
    fn of(evidence: &Evidence) -> Self {
        let n = (evidence.n_events() / N_COARSE_EVENTS).max(1);
        let part = evidence.thinned(n);
        Self { n, start: wide_start(&part), evidence: part }
    }

    /// Fits a model whose effects alone are known, with equal thresholds: a wide noise first, then
    /// the fitted one.
    fn fit(&self, start: &CameraModel) -> ModelFit {
        let part = &self.evidence;
        let mut wide = start.with_constants_of(&self.start).for_pixels(part);
        wide.pin(CameraConstant::LogNoise, WIDE_NOISE.ln());
        let mut free = fit(part, wide, N_STEPS[0], FitTolerance::Coarse).model;
        free.limit(part, &[CameraConstant::LogNoise]);
        fit(part, free, N_STEPS[0], FitTolerance::Coarse)
    }

    /// A fit to all pixels of a model whose effects alone are known.
    fn refit(&self, evidence: &Evidence, start: &CameraModel) -> ModelFit {
        refined(evidence, self.fit(start))
    }

    /// A model fitted with a wide noise.
    fn widened(&self, now: &CameraModel) -> ModelFit {
        let mut model = now.thinned(self.n);
        let noise = model.constant(CameraConstant::LogNoise).max(WIDE_NOISE.ln());
        model.pin(CameraConstant::LogNoise, noise);
        fit(&self.evidence, model, N_STEPS[1], FitTolerance::Coarse)
    }
}

/// A fit to all pixels from that to a part of them.
fn refined(evidence: &Evidence, coarse: ModelFit) -> ModelFit {
    fit(evidence, coarse.model.for_pixels(evidence), N_STEPS[1], FitTolerance::Coarse)
}

/// Clock offsets from which a start is looked for, in bounds of the stated clock: between sparse
/// frames the likelihood has several maxima in time.
const START_OFFSETS: [f64; 3] = [-1.0, 0.0, 1.0];

/// Constants at their prior means, with the threshold, the offset and a wide noise fitted: the best
/// of several starts.
fn wide_start(part: &Evidence) -> CameraModel {
    const FITTED: [CameraConstant; 3] =
        [CameraConstant::LogTheta, CameraConstant::LogNoise, CameraConstant::OffsetUs];
    let active = FITTED.map(|constant| constant as usize).to_vec();
    let baseline = CameraModel::baseline(part);
    let fits = START_OFFSETS.map(|offset| {
        let mut model = baseline.clone();
        model.values[CameraConstant::LogNoise as usize] = WIDE_NOISE.ln();
        model.values[CameraConstant::OffsetUs as usize] = offset * part.facts.offset_bound_us;
        fit_coordinates(part, model, active.clone(), N_START_STEPS, FitTolerance::Coarse)
    });
    let best = fits.into_iter().max_by(|a, b| a.training(part).total_cmp(&b.training(part)));
    best.map_or(baseline, |fit| fit.model)
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

/// The best start of each candidate, the largest gain first.
fn scan_all(
    part: &Evidence,
    scan: &ScoreScan<'_>,
    base: &CameraModel,
) -> Vec<(ScanGain, EffectCandidate, CameraModel)> {
    let mut scanned: Vec<(ScanGain, EffectCandidate, CameraModel)> = Vec::new();
    for candidate in EffectCandidate::beyond(part, base) {
        let trials = candidate.starts(part, base).into_iter().map(|trial| {
            let gain = scan.gain(&trial, &candidate.own(&trial));
            (gain, candidate, trial)
        });
        scanned.extend(trials.max_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(Ordering::Equal)));
    }
    scanned.sort_by(|a, b| b.0.nats().total_cmp(&a.0.nats()));
    scanned.retain(|(gain, ..)| gain.nats() > MIN_SCAN_GAIN_NATS);
    scanned
}

/// Starts for the fits of this round: candidates that are better as they are, and those that a
/// search with a wide noise finds.
fn search(coarse: &CoarsePixels, now: &ModelFit) -> Vec<(EffectCandidate, CameraModel)> {
    let part = &coarse.evidence;
    let wide = coarse.widened(&now.model);
    let base = now.model.thinned(coarse.n);
    let near = scan_all(part, &ScoreScan::new(part, &base), &base);
    let reached = near.into_iter().filter(|(gain, ..)| matches!(gain, ScanGain::Reached(_)));
    let mut found: Vec<(EffectCandidate, CameraModel)> = reached
        .take(N_CANDIDATES[1])
        .map(|(_, candidate, trial)| {
            let own = candidate.own(&trial);
            (candidate, now.model.moved_as(&base, trial, &own))
        })
        .collect();
    let scan = ScoreScan::new(part, &wide.model);
    let mut scanned = scan_all(part, &scan, &wide.model);
    scanned.truncate(N_CANDIDATES[0]);
    let before = wide.training(part);
    let mut fitted: Vec<(f64, EffectCandidate, CameraModel)> = scanned
        .into_iter()
        .map(|(_, candidate, trial)| {
            let own = candidate.own(&trial);
            let fit = fit_profile(part, &scan, trial, &own, N_PROFILE_STEPS);
            let gain = fit.training(part) - before;
            (gain, candidate, now.model.moved_as(&wide.model, fit.model, &own))
        })
        .collect();
    fitted.retain(|(gain, ..)| *gain > MIN_SCAN_GAIN_NATS);
    fitted.sort_by(|a, b| b.0.total_cmp(&a.0));
    fitted.truncate(N_CANDIDATES[1]);
    found.extend(fitted.into_iter().map(|(_, candidate, model)| (candidate, model)));
    found
}

/// Fitted candidates, best held-out gain first.
fn best_candidates(
    evidence: &Evidence,
    coarse: &CoarsePixels,
    now: &ModelFit,
) -> Vec<FittedCandidate> {
    let found = search(coarse, now);
    let scan = ScoreScan::new(evidence, &now.model);
    let refined = |(candidate, start): (EffectCandidate, CameraModel)| {
        let own = candidate.own(&start);
        let fit = fit_profile(evidence, &scan, start, &own, N_PROFILE_STEPS);
        let (gain, error) = paired_gain(evidence, &fit.evaluation, &now.evaluation);
        let id = candidate.id(evidence, &fit.model);
        let is_significant = candidate.is_significant(evidence, (gain, error));
        let fitted = FittedCandidate { candidate, id, gain, error, fit, is_significant };
        (!candidate.is_refused(evidence, &fitted.fit.model)).then_some(fitted)
    };
    let mut tried: Vec<FittedCandidate> = found.into_iter().filter_map(refined).collect();
    tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    // The better start of each.
    let mut ids = BTreeSet::new();
    tried.retain(|fitted| ids.insert(fitted.id));
    tried
}

/// Backward elimination; the last effect was significant beside all others.
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
        let gain = paired_gain(evidence, &now.evaluation, &without.evaluation);
        if steps[index].candidate.is_significant(evidence, gain) {
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
