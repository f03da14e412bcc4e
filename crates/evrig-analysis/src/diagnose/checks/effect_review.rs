//! Tests that every accepted effect has to pass.

use super::acceptance::{
    Adequacy, assess_adequacy, explains_nothing, leaves_recalibration_gain,
    most_inconstant_stratum, parameter_at_bound,
};
use super::accepted_effect::AcceptedEffect;
use super::null_distribution;
use super::pruning::refit_with;
use super::strength_constancy::strengths_by_stratum;
use super::two_sample_test::{StructureTest, test_structure};
use super::upper_bound::recalibration_gain;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::{Evidence, RejectedEffect};
use evrig_core::effect_id::EffectId;

/// The model with the effects that passed, and the rejected ones.
pub(crate) struct ReviewedModel {
    pub(crate) model: FittedModel,
    pub(crate) taken: Vec<AcceptedEffect>,
    pub(crate) adequacy: Adequacy,
    /// Residual structure of the model; where all are rejected, that of the full model.
    pub(crate) after: Option<StructureTest>,
    pub(crate) rejected_effects: Vec<RejectedEffect>,
}

/// What the tests use.
pub(crate) struct EffectReview<'a> {
    pub(crate) evidence: &'a Evidence,
    pub(crate) baseline: &'a FittedModel,
    /// Residual structure of the baseline.
    pub(crate) before: Option<&'a StructureTest>,
    /// Residual structures of simulated recordings.
    pub(crate) null: &'a [f64],
    /// Whether a further effect has a suggestive gain.
    pub(crate) has_suggestive_effect: bool,
    /// Whether isolated events are missing.
    pub(crate) misses_isolated_events: bool,
    pub(crate) seed: u64,
}

/// Test results of a model.
struct ModelReview {
    after: Option<StructureTest>,
    adequacy: Adequacy,
    /// Per effect: why it is rejected.
    objections: Vec<Option<String>>,
    /// Why all are rejected.
    objection_to_all: Option<String>,
}

impl ModelReview {
    fn holds(&self) -> bool {
        self.objection_to_all.is_none() && self.objections.iter().all(Option::is_none)
    }
}

impl EffectReview<'_> {
    /// Rejects effects with inconstant strength, and all effects of a model that leaves too much
    /// structure. A rejected effect has biased the others, so the rest is refitted and tested
    /// again.
    pub(crate) fn review(&self, model: FittedModel, taken: Vec<AcceptedEffect>) -> ReviewedModel {
        let review = self.review_model(&model, self.assess(&model));
        if review.holds() {
            let ModelReview { after, adequacy, .. } = review;
            return ReviewedModel { model, taken, adequacy, after, rejected_effects: Vec::new() };
        }
        let rejected_effects = rejected_effects(&model, &taken, &review);
        let kept: Vec<usize> =
            (0..taken.len()).filter(|&i| review.objections[i].is_none()).collect();
        if !kept.is_empty() && kept.len() < taken.len() {
            let rest = refit_with(self.evidence, self.baseline, &model, &kept);
            let again = self.review_model(&rest, self.assess(&rest));
            if again.holds() {
                let taken = of(taken, &review.objections, Option::is_none);
                let rejected_effects = of(rejected_effects, &review.objections, Option::is_some);
                let ModelReview { after, adequacy, .. } = again;
                return ReviewedModel { model: rest, taken, adequacy, after, rejected_effects };
            }
        }
        self.reject_all(review, rejected_effects)
    }

    /// Rejects all effects of a model that leaves nearly all of a large structure.
    pub(crate) fn reject_if_unexplained(
        &self,
        model: &FittedModel,
        taken: &[AcceptedEffect],
    ) -> Option<ReviewedModel> {
        if taken.is_empty() {
            return None;
        }
        let assessment = self.assess(model);
        explains_nothing(self.before, assessment.0.as_ref()).then(|| {
            let review = self.review_model(model, assessment);
            let rejected_effects = rejected_effects(model, taken, &review);
            self.reject_all(review, rejected_effects)
        })
    }

    fn reject_all(
        &self,
        review: ModelReview,
        rejected_effects: Vec<RejectedEffect>,
    ) -> ReviewedModel {
        let ModelReview { after, adequacy, .. } = review;
        ReviewedModel {
            model: self.baseline.clone(),
            taken: Vec::new(),
            adequacy,
            after,
            rejected_effects,
        }
    }

    /// Whether a model leaves most of the structure.
    pub(crate) fn is_inadequate(&self, model: &FittedModel) -> bool {
        self.assess(model).1 == Adequacy::Inadequate
    }

    fn assess(&self, model: &FittedModel) -> (Option<StructureTest>, Adequacy) {
        let after = test_structure(self.evidence, model, self.seed);
        let adequacy = assess_adequacy(
            self.before,
            after.as_ref(),
            self.null,
            has_effect_seen_in_events(model),
        );
        (after, adequacy)
    }

    /// Why a recalibrated hazard rules out the model, if it does. Interpolated light always leaves
    /// such a gain.
    fn unexplained_remainder(&self, model: &FittedModel) -> Option<String> {
        if self.has_suggestive_effect
            || !self.evidence.facts.is_light_dense()
            || !has_effect_seen_in_events(model)
        {
            return None;
        }
        let left = recalibration_gain(self.evidence, model);
        let removed = model.held_out() - self.baseline.held_out();
        leaves_recalibration_gain(removed, left).then(|| {
            format!(
                "it gains {removed:.2} nats per event, and a recalibrated hazard gains another \
                 {:.2} that no effect of the library explains",
                left.gain
            )
        })
    }

    /// Why an effect only imitates a neighbour filter, if it does: such a filter does not remove
    /// events at random.
    fn filter_objection(&self, model: &FittedModel, index: usize) -> Option<String> {
        let is_loss = model.hypothesis.effects[index].id == EffectId::EventDrop;
        (self.misses_isolated_events && is_loss).then(|| {
            "the missing events are those that no neighbour's event came before".to_owned()
        })
    }

    fn review_model(
        &self,
        model: &FittedModel,
        (after, adequacy): (Option<StructureTest>, Adequacy),
    ) -> ModelReview {
        let n = model.hypothesis.effects.len();
        let objection_to_all = match adequacy {
            Adequacy::Inadequate => {
                Some("a classifier still separates simulated from recorded events".to_owned())
            }
            Adequacy::Adequate | Adequacy::Partial => self.unexplained_remainder(model),
        };
        let drawn = null_distribution::draw_recording(self.evidence, &model.hypothesis, self.seed);
        let own = |index: usize| objection(self.evidence, &drawn, model, index);
        let objections =
            (0..n).map(|index| self.filter_objection(model, index).or_else(|| own(index)));
        let objections = objections.collect();
        ModelReview { after, adequacy, objections, objection_to_all }
    }
}

/// Whether an effect of the model shows in events; dead pixels have none.
fn has_effect_seen_in_events(model: &FittedModel) -> bool {
    model.hypothesis.effects.iter().any(|effect| !effect.acts_on_silent_pixels)
}

/// The items whose objection satisfies a predicate.
fn of<T>(
    all: Vec<T>,
    objections: &[Option<String>],
    is_asked: fn(&Option<String>) -> bool,
) -> Vec<T> {
    let own = all.into_iter().zip(objections).filter(|(_, objection)| is_asked(objection));
    own.map(|(each, _)| each).collect()
}

/// Why an effect is rejected: a parameter at a bound, or inconstant strength.
fn objection(
    evidence: &Evidence,
    drawn: &Evidence,
    model: &FittedModel,
    index: usize,
) -> Option<String> {
    if let Some(parameter) = parameter_at_bound(&model.hypothesis, index) {
        let [low, high] = parameter.range;
        return Some(format!("{} is at a bound of its range, {low} to {high}", parameter.key));
    }
    let strengths = strengths_by_stratum(evidence, drawn, model, index);
    let worst = most_inconstant_stratum(&strengths)?;
    let [low, high] = worst.range;
    let how = match worst.change {
        less if less < -0.8 => "it is nearly absent",
        less if less < 0.0 => "it is much weaker",
        _ => "it is much stronger",
    };
    Some(format!("for {} from {low:.4} to {high:.4} {how}", worst.covariate))
}

fn rejected_effects(
    model: &FittedModel,
    taken: &[AcceptedEffect],
    review: &ModelReview,
) -> Vec<RejectedEffect> {
    let effects = model.hypothesis.effects.iter().zip(taken).zip(&review.objections);
    let together = || "it was found together with an effect that was rejected".to_owned();
    effects
        .map(|((effect, taken), objection)| RejectedEffect {
            id: effect.id,
            heldout_gain_nats_per_event: taken.gain,
            because: objection
                .as_ref()
                .or(review.objection_to_all.as_ref())
                .cloned()
                .unwrap_or_else(together),
        })
        .collect()
}
