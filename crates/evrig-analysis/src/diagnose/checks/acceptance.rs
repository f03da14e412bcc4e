//! Acceptance criteria for named effects.
//!
//! A wrong effect can gain much: effects that remove events fit each other's data. They leave
//! residual structure, since they remove the wrong events. The residual structure of the
//! two-sample test ([`super::two_sample_test`]) is compared with that of simulated recordings and
//! with that of the baseline.

use super::strength_constancy::StratumStrength;
use super::two_sample_test::StructureTest;
use super::upper_bound::RecalibrationGain;
use crate::diagnose::Hypothesis;
use crate::diagnose::fit::cell_scores::is_suggestive;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::model::library::CandidateParameter;
use evrig_core::stats::Z90;

/// Residual structure that the noise model's shape and light errors leave under a true model.
const MIN_STRUCTURE_NATS_PER_EVENT: f64 = 0.025;

/// Share of the baseline's structure that a partially adequate model may leave.
const MAX_LEFT_SHARE_PARTIAL: f64 = 0.3;

/// The same for all features where the light between frames is interpolated.
const MAX_LEFT_SHARE_INTERPOLATED: f64 = 0.5;

/// Share that an adequate model may leave.
const MAX_LEFT_SHARE_ADEQUATE: f64 = 0.1;

/// A model that leaves this share, and the structure below, explains nothing.
const MIN_LEFT_SHARE_UNEXPLAINED: f64 = 0.6;
const MIN_STRUCTURE_UNEXPLAINED: f64 = 4.0 * MIN_STRUCTURE_NATS_PER_EVENT;

/// Relative difference of strength between strata that light errors cause under a true model.
const MAX_STRENGTH_CHANGE: f64 = 0.5;

/// Significance level for a difference of strength.
const MIN_STRENGTH_CHANGE_STANDARD_ERRORS: f64 = 5.0;

/// A strength is identified if the data exclude this factor to either side.
const STRENGTH_FACTOR: f64 = 3.0;

/// Half width of the 90 % interval of a logarithm: ln 3, the factor above.
const MAX_LOG_HALF_WIDTH: f64 = 1.1;

/// Distance from zero of an identified signed parameter, standard errors.
const MIN_STANDARD_ERRORS_FROM_ZERO: f64 = 3.0;

/// Adequacy of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Adequacy {
    /// The residual structure is at the level of simulated recordings.
    Adequate,
    /// The model explains a part.
    Partial,
    /// Most of the structure is left.
    Inadequate,
}

/// Adequacy by residual structure; `null` are the values of simulated recordings. A model with an
/// effect that events can show is compared with the baseline.
pub(crate) fn assess_adequacy(
    before: Option<&StructureTest>,
    after: Option<&StructureTest>,
    null: &[f64],
    names_something: bool,
) -> Adequacy {
    let (Some(before), Some(after)) = (before, after) else { return Adequacy::Adequate };
    let chance = null.iter().copied().fold(0.0, f64::max) + 2.0 * after.error;
    let least = MIN_STRUCTURE_NATS_PER_EVENT.max(chance);
    if after.nats <= least
        || (names_something && after.nats <= MAX_LEFT_SHARE_ADEQUATE * before.nats)
    {
        Adequacy::Adequate
    } else if !names_something || removes_most_structure(before, after) {
        Adequacy::Partial
    } else {
        Adequacy::Inadequate
    }
}

pub(crate) fn explains_nothing(
    before: Option<&StructureTest>,
    after: Option<&StructureTest>,
) -> bool {
    before.zip(after).is_some_and(|(before, after)| {
        let apart = before.without_light_features.zip(after.without_light_features);
        after.nats - 2.0 * after.error
            > MIN_STRUCTURE_UNEXPLAINED.max(MIN_LEFT_SHARE_UNEXPLAINED * before.nats)
            && apart.is_none_or(|(before, after)| after > MIN_LEFT_SHARE_UNEXPLAINED * before)
    })
}

/// Whether a recalibrated hazard, which knows no physics, still gains much: an effect outside the
/// library may be half explained by a named one without structure that the classifier sees.
pub(crate) fn leaves_recalibration_gain(removed: f64, left: RecalibrationGain) -> bool {
    is_suggestive(left.gain, left.error)
        && left.gain > MAX_LEFT_SHARE_PARTIAL * (removed.max(0.0) + left.gain)
}

fn removes_most_structure(before: &StructureTest, after: &StructureTest) -> bool {
    match before.without_light_features.zip(after.without_light_features) {
        Some((apart, left)) => {
            left <= MAX_LEFT_SHARE_PARTIAL * apart
                && after.nats <= MAX_LEFT_SHARE_INTERPOLATED * before.nats
        }
        None => after.nats <= MAX_LEFT_SHARE_PARTIAL * before.nats,
    }
}

/// The stratum with the most significant difference of strength, if larger than under a true
/// model.
pub(crate) fn most_inconstant_stratum(strengths: &[StratumStrength]) -> Option<&StratumStrength> {
    let beyond = |s: &StratumStrength| s.change.abs() - 2.0 * s.error;
    let far =
        strengths.iter().filter(|s| s.change.abs() > MIN_STRENGTH_CHANGE_STANDARD_ERRORS * s.error);
    far.filter(|s| beyond(s) > MAX_STRENGTH_CHANGE)
        .max_by(|a, b| (a.change.abs() / a.error).total_cmp(&(b.change.abs() / b.error)))
}

/// Whether the data identify none of an effect's parameters. Needs standard errors.
pub(crate) fn is_unidentified(model: &FittedModel, index: usize) -> bool {
    let hypothesis = &model.hypothesis;
    hypothesis.effects[index].freed.is_empty()
        && fitted_parameters(hypothesis, index).all(|(at, p)| {
            let (value, error) = (hypothesis.values[at], model.error_of(at));
            // A value at a bound has no standard error.
            let is_told = if p.is_log {
                Z90 * error <= MAX_LOG_HALF_WIDTH
            } else {
                value.abs() >= MIN_STANDARD_ERRORS_FROM_ZERO * error
            };
            !is_told
        })
}

/// The hypothesis with an effect's first fitted parameter fixed at a third and at three times its
/// value, within its range; `None` without room to either side.
pub(crate) fn with_strength_fixed_aside(
    hypothesis: &Hypothesis,
    index: usize,
) -> Option<[Hypothesis; 2]> {
    let (at, parameter) = fitted_parameters(hypothesis, index).next()?;
    let aside = [1.0 / STRENGTH_FACTOR, STRENGTH_FACTOR].map(|times| {
        let mut moved = hypothesis.scaled(at, parameter, times);
        moved.ranges[at] = [moved.values[at]; 2];
        moved
    });
    aside.iter().all(|moved| moved.values[at] != hypothesis.values[at]).then_some(aside)
}

/// Fitted and reported parameters of an effect with their value indices; all of them where the
/// reported ones are derived.
fn fitted_parameters(
    hypothesis: &Hypothesis,
    index: usize,
) -> impl Iterator<Item = (usize, &'static CandidateParameter)> {
    let parameters = hypothesis.effects[index].parameters;
    let all_follow = parameters.iter().all(|p| p.is_hidden);
    let numbered = (hypothesis.offset_of(index)..).zip(parameters);
    numbered.filter(move |(_, p)| !p.is_fixed && (all_follow || !p.is_hidden))
}

/// Share of its range within which a value counts as at a bound.
const BOUND_TOLERANCE: f64 = 1e-3;

/// A fitted parameter at a bound of its range, if any: the data ask for more than the law allows.
pub(crate) fn parameter_at_bound(
    hypothesis: &Hypothesis,
    index: usize,
) -> Option<&'static CandidateParameter> {
    fitted_parameters(hypothesis, index)
        .find(|(at, _)| hypothesis.is_at_end(*at, BOUND_TOLERANCE))
        .map(|(_, parameter)| parameter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adequacy_depends_on_the_residual_structure() {
        let (much, some, little) =
            (StructureTest::of(0.3), StructureTest::of(0.08), StructureTest::of(0.01));
        let of = |after: &StructureTest| assess_adequacy(Some(&much), Some(after), &[0.002], true);
        assert_eq!(of(&little), Adequacy::Adequate);
        assert_eq!(of(&some), Adequacy::Partial);
        assert_eq!(of(&StructureTest::of(0.2)), Adequacy::Inadequate);
        assert_eq!(assess_adequacy(Some(&some), Some(&some), &[], false), Adequacy::Partial);
        assert_eq!(assess_adequacy(Some(&little), Some(&little), &[], false), Adequacy::Adequate);
    }

    #[test]
    fn a_model_that_leaves_a_large_structure_explains_nothing() {
        let lost = |before, after| {
            explains_nothing(Some(&StructureTest::of(before)), Some(&StructureTest::of(after)))
        };
        assert!(lost(0.36, 0.29) && !lost(0.36, 0.2) && !lost(0.08, 0.08));
        let apart = |nats, apart| StructureTest {
            without_light_features: Some(apart),
            ..StructureTest::of(nats)
        };
        assert!(!explains_nothing(Some(&apart(0.3, 0.2)), Some(&apart(0.25, 0.05))));
    }

    #[test]
    fn a_recalibration_gain_matters_if_significant_and_large() {
        let left = |gain, error| RecalibrationGain { gain, error };
        assert!(leaves_recalibration_gain(0.14, left(0.13, 0.03)));
        assert!(!leaves_recalibration_gain(0.14, left(0.13, 0.05)), "it is not sure");
        assert!(
            !leaves_recalibration_gain(1.7, left(0.13, 0.03)),
            "it is little beside what is gone"
        );
        assert!(!leaves_recalibration_gain(0.02, left(0.03, 0.001)), "it is no mismatch");
    }

    #[test]
    fn interpolated_light_is_judged_without_light_features() {
        let of = |nats: f64, apart: f64| StructureTest {
            without_light_features: Some(apart),
            ..StructureTest::of(nats)
        };
        let adequacy = |before: StructureTest, after: StructureTest| {
            assess_adequacy(Some(&before), Some(&after), &[0.002], true)
        };
        // Of 0.19 nats 0.07 are left, as from light errors alone.
        assert_eq!(adequacy(of(0.19, 0.15), of(0.07, 0.03)), Adequacy::Partial);
        assert_eq!(adequacy(of(0.19, 0.15), of(0.07, 0.06)), Adequacy::Inadequate);
        assert_eq!(adequacy(of(0.19, 0.15), of(0.12, 0.03)), Adequacy::Inadequate);
    }

    #[test]
    fn a_strength_that_differs_by_factors_is_inconstant() {
        let stratum = |change: f64, error: f64| StratumStrength {
            covariate: "row",
            range: [0.0, 1.0],
            change,
            error,
        };
        // Significant, but a difference of a tenth is within light errors.
        assert!(most_inconstant_stratum(&[stratum(0.1, 0.005), stratum(-0.9, 0.6)]).is_none());
        let all = [stratum(0.1, 0.005), stratum(-0.95, 0.08)];
        assert!(most_inconstant_stratum(&all).is_some_and(|found| found.change < -0.9));
    }
}
