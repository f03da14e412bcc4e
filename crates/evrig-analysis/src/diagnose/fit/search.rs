//! Search for effects that a model lacks.

use crate::diagnose::Evidence;
use crate::diagnose::fit::candidate::EffectCandidate;
use crate::diagnose::fit::coarse_pixels::{CoarsePixels, N_STEPS, WIDE_NOISE, at_prior_means};
use crate::diagnose::fit::optimizer::{FitTolerance, ModelFit, fit};
use crate::diagnose::fit::paired_gain::PairedGain;
use crate::diagnose::fit::profile::fit_profile;
use crate::diagnose::fit::score_scan::{ScanGain, ScoreScan};
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::constants::CameraConstant;
use evrig_core::effect_id::EffectId;
use std::cmp::Ordering;
use std::collections::BTreeSet;

/// Effects fitted per round with a wide noise, best by the score scan first, and with the fitted one
/// (work budget).
const N_CANDIDATES: [usize; 2] = [8, 4];

/// Optimizer steps of an effect along its profile.
const N_PROFILE_STEPS: usize = 8;

/// Gain of a scanned effect in nats below which no fit is tried.
const MIN_SCAN_GAIN_NATS: f64 = 3.0;

/// A fitted candidate.
pub(super) struct FittedCandidate {
    pub(super) candidate: EffectCandidate,
    pub(super) id: EffectId,
    pub(super) gain: PairedGain,
    pub(super) fit: ModelFit,
    pub(super) is_significant: bool,
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

/// Candidates that are better than a model as they are, the best ones.
fn reached(
    part: &Evidence,
    base: &CameraModel,
) -> impl Iterator<Item = (EffectCandidate, CameraModel)> {
    let scanned = scan_all(part, &ScoreScan::new(part, base), base).into_iter();
    let is_reached = |(gain, ..): &(ScanGain, _, _)| matches!(gain, ScanGain::Reached(_));
    scanned.filter(is_reached).take(N_CANDIDATES[1]).map(|(_, candidate, trial)| (candidate, trial))
}

/// Starts for the fits of this round: candidates that are better as they are, and those that a
/// search with a wide noise finds.
fn starts(coarse: &CoarsePixels, now: &ModelFit) -> Vec<(EffectCandidate, CameraModel)> {
    let part = &coarse.evidence;
    let wide = coarse.widened(&now.model);
    let base = now.model.thinned(coarse.n);
    let mut found: Vec<(EffectCandidate, CameraModel)> = reached(part, &base)
        .map(|(candidate, trial)| {
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

/// Candidates fitted with all constants, where constants stand at the ends of their ordinary ranges:
/// those that take the place of such constants, which no step of first order leads to.
fn in_place_of(
    extremes: &[CameraConstant],
    coarse: &CoarsePixels,
    now: &ModelFit,
) -> Vec<(EffectCandidate, CameraModel)> {
    let part = &coarse.evidence;
    let base = now.model.thinned(coarse.n);
    let mut without = base.clone();
    without.pin(CameraConstant::LogNoise, WIDE_NOISE.ln());
    for constant in extremes {
        without.values[*constant as usize] = constant.prior(&part.facts).mean;
    }
    let fitted = |(candidate, trial): (EffectCandidate, CameraModel)| {
        let own = candidate.own(&trial);
        let mut start = at_prior_means(part, &now.model.moved_as(&base, trial, &own));
        start.values[CameraConstant::LogTheta as usize] = base.constant(CameraConstant::LogTheta);
        (candidate, now.model.moved_as(&base, coarse.fit_from(start).model, &own))
    };
    reached(part, &without).map(fitted).collect()
}

/// The search in each round of a selection.
pub(super) struct EffectSearch<'a> {
    evidence: &'a Evidence,
    coarse: &'a CoarsePixels,
    /// Constants in whose place candidates were tried.
    replaced: Vec<CameraConstant>,
}

impl<'a> EffectSearch<'a> {
    pub(super) const fn new(evidence: &'a Evidence, coarse: &'a CoarsePixels) -> Self {
        Self { evidence, coarse, replaced: Vec::new() }
    }

    /// Fitted candidates, best held-out gain first.
    pub(super) fn candidates(&mut self, now: &ModelFit) -> Vec<FittedCandidate> {
        let scan = ScoreScan::new(self.evidence, &now.model);
        let near = starts(self.coarse, now).into_iter();
        let mut tried: Vec<FittedCandidate> =
            near.filter_map(|start| self.fitted(now, &scan, start, true)).collect();
        let mut extremes = now.model.at_range_end(self.evidence);
        // The search has a wide noise of its own.
        extremes.retain(|constant| *constant != CameraConstant::LogNoise);
        if extremes.iter().any(|constant| !self.replaced.contains(constant)) {
            let far = in_place_of(&extremes, self.coarse, now).into_iter();
            tried.extend(far.filter_map(|start| self.fitted(now, &scan, start, false)));
            self.replaced.extend(extremes);
        }
        tried.sort_by(|a, b| b.gain.mean.total_cmp(&a.gain.mean));
        // The better start of each.
        let mut ids = BTreeSet::new();
        tried.retain(|fitted| ids.insert(fitted.id));
        tried
    }

    /// A candidate fitted along its profile, or with all constants where they are not near those
    /// around which they follow to first order; none that imitates something else.
    fn fitted(
        &self,
        now: &ModelFit,
        scan: &ScoreScan<'_>,
        (candidate, start): (EffectCandidate, CameraModel),
        is_near: bool,
    ) -> Option<FittedCandidate> {
        let evidence = self.evidence;
        let own = candidate.own(&start);
        let gain = |fit: &ModelFit| PairedGain::of(evidence, &fit.evaluation, &now.evaluation);
        let mut fit = fit_profile(evidence, scan, start, &own, N_PROFILE_STEPS);
        if !is_near && gain(&fit).mean > 0.0 {
            fit = self::fit(evidence, fit.model, N_STEPS[1], FitTolerance::Coarse);
        }
        let gain = gain(&fit);
        let id = candidate.id(evidence, &fit.model);
        let is_significant = candidate.is_significant(evidence, gain);
        let is_refused = candidate.is_refused(evidence, &fit.model);
        let fitted = FittedCandidate { candidate, id, gain, fit, is_significant };
        (!is_refused).then_some(fitted)
    }
}
