//! May a name stand? Only on a model that leaves no structure to speak of.
//!
//! A wrong name can buy much: an effect that takes events away fits like any other that takes
//! events away. What gives it away is what it leaves: the events it removes are not those that are
//! missing. So the structure left, as trees see it ([`super::check`]), is held against what they
//! see in recordings drawn from the model itself, and against what the baseline left.

use super::strength_constancy::Stratum;
use super::two_sample_test::Structure;
use super::upper_bound::Flexible;
use crate::diagnose::Hypothesis;
use crate::diagnose::fit::cell_scores::is_suspicious;
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::model::library::Parameter;
use evrig_core::stats::Z90;

/// Structure, nats an event, that the shape of the noise and the error of the light leave under a
/// right model.
const LEAST_STRUCTURE: f64 = 0.025;

/// A name may stand on a model that leaves this share of the baseline's structure.
const LEFT_IN_PART: f64 = 0.3;

/// Where the light between frames is guessed, its errors are most of what any model leaves. There that share is
/// of what they do not show in, and of all of it may be left so much.
const LEFT_BESIDE_GUESSED: f64 = 0.5;

/// And without reserve on one that leaves this share.
const LEFT_AT_MOST: f64 = 0.1;

/// A model that leaves this share, and so much, nats an event, is so far from the truth that no part of it is either.
const LOST: f64 = 0.6;
const LOST_STRUCTURE: f64 = 4.0 * LEAST_STRUCTURE;

/// A strength may differ between strata by this share: what the error of the light and the shape of
/// the noise do to a right name.
const AS_GOOD_AS_EQUAL: f64 = 0.5;

/// Standard errors that a difference of strength has to have.
const SURE: f64 = 5.0;

/// A strength that might as well be so many times as much or less is not told.
const FACTOR: f64 = 3.0;

/// Half width of a 90 % interval of a logarithm at which a parameter is not told: that factor's.
const VAGUE: f64 = 1.1;

/// Standard errors from no effect that a parameter has to have which may have either sign.
const FROM_NOTHING: f64 = 3.0;

/// How a model stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Standing {
    /// What is left is what the model itself shows, or next to it.
    Holds,
    /// It explains a part, and something else is left.
    InPart,
    /// It leaves most of what was to be explained.
    Fails,
}

/// Judges a model by what it leaves; `null` are the structures in recordings drawn from it. A model
/// that names something which shows behind events is measured by the baseline, another by itself.
pub(crate) fn standing(
    before: Option<&Structure>,
    after: Option<&Structure>,
    null: &[f64],
    names_something: bool,
) -> Standing {
    let (Some(before), Some(after)) = (before, after) else { return Standing::Holds };
    let chance = null.iter().copied().fold(0.0, f64::max) + 2.0 * after.error;
    let least = LEAST_STRUCTURE.max(chance);
    if after.nats <= least || (names_something && after.nats <= LEFT_AT_MOST * before.nats) {
        Standing::Holds
    } else if !names_something || removes_most(before, after) {
        Standing::InPart
    } else {
        Standing::Fails
    }
}

/// Whether a model leaves so much that nothing which is made of it could stand.
pub(crate) fn is_lost(before: Option<&Structure>, after: Option<&Structure>) -> bool {
    before.zip(after).is_some_and(|(before, after)| {
        let apart = before.apart_from_light.zip(after.apart_from_light);
        after.nats - 2.0 * after.error > LOST_STRUCTURE.max(LOST * before.nats)
            && apart.is_none_or(|(before, after)| after > LOST * before)
    })
}

/// Whether a model leaves much of what there was to explain to a recalibration of its hazard, which knows no physics: what the
/// library does not have may be half explained by a name, by which trees then tell little.
pub(crate) fn leaves_much(removed: f64, left: Flexible) -> bool {
    is_suspicious(left.gain, left.error)
        && left.gain > LEFT_IN_PART * (removed.max(0.0) + left.gain)
}

/// Whether most of the structure is gone.
fn removes_most(before: &Structure, after: &Structure) -> bool {
    match before.apart_from_light.zip(after.apart_from_light) {
        Some((apart, left)) => {
            left <= LEFT_IN_PART * apart && after.nats <= LEFT_BESIDE_GUESSED * before.nats
        }
        None => after.nats <= LEFT_IN_PART * before.nats,
    }
}

/// The stratum in which an effect's strength differs most from its strength elsewhere, if by more
/// than any right name's would.
pub(crate) fn inconstant(strengths: &[Stratum]) -> Option<&Stratum> {
    let beyond = |s: &Stratum| s.change.abs() - 2.0 * s.error;
    let far = strengths.iter().filter(|s| s.change.abs() > SURE * s.error);
    far.filter(|s| beyond(s) > AS_GOOD_AS_EQUAL)
        .max_by(|a, b| (a.change.abs() / a.error).total_cmp(&(b.change.abs() / b.error)))
}

/// Whether the events tell none of an effect's parameters: what fits at any strength stands in for
/// something else. The model comes with its errors.
pub(crate) fn is_vague(model: &Fitted, index: usize) -> bool {
    let hypothesis = &model.hypothesis;
    hypothesis.effects[index].frees.is_empty()
        && asked(hypothesis, index).all(|(at, p)| {
            let (value, error) = (hypothesis.values[at], model.error_of(at));
            // A value that the range holds has no error: the events ask for more of it than there is.
            let is_told =
                if p.is_log { Z90 * error <= VAGUE } else { value.abs() >= FROM_NOTHING * error };
            !is_told
        })
}

/// The hypothesis with an effect's first parameter that events are asked for held at a third of its value,
/// and at three times as much, as far as its range goes; `None` where it has no room to either side.
pub(crate) fn strength_aside(hypothesis: &Hypothesis, index: usize) -> Option<[Hypothesis; 2]> {
    let (at, parameter) = asked(hypothesis, index).next()?;
    let aside = [1.0 / FACTOR, FACTOR].map(|times| {
        let mut moved = hypothesis.scaled(at, parameter, times);
        moved.ranges[at] = [moved.values[at]; 2];
        moved
    });
    aside.iter().all(|moved| moved.values[at] != hypothesis.values[at]).then_some(aside)
}

/// Parameters of an effect that the events are asked for and that are reported, each with the number of its
/// value; where what is reported only follows from them, all of them.
fn asked(
    hypothesis: &Hypothesis,
    index: usize,
) -> impl Iterator<Item = (usize, &'static Parameter)> {
    let parameters = hypothesis.effects[index].parameters;
    let all_follow = parameters.iter().all(|p| p.is_hidden);
    let numbered = (hypothesis.offset_of(index)..).zip(parameters);
    numbered.filter(move |(_, p)| !p.is_fixed && (all_follow || !p.is_hidden))
}

/// Share of its range within which a value stands at an end.
const AT_THE_END: f64 = 1e-3;

/// What stands at an end of its range, if something does: the events ask for more of it than there is, so
/// that the effect stands in for something else.
pub(crate) fn at_an_end(hypothesis: &Hypothesis, index: usize) -> Option<&'static Parameter> {
    asked(hypothesis, index)
        .find(|(at, _)| hypothesis.is_at_end(*at, AT_THE_END))
        .map(|(_, parameter)| parameter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_stands_by_what_its_model_leaves() {
        let (much, some, little) = (Structure::of(0.3), Structure::of(0.08), Structure::of(0.01));
        let of = |after: &Structure| standing(Some(&much), Some(after), &[0.002], true);
        assert_eq!(of(&little), Standing::Holds);
        assert_eq!(of(&some), Standing::InPart);
        assert_eq!(of(&Structure::of(0.2)), Standing::Fails);
        assert_eq!(standing(Some(&some), Some(&some), &[], false), Standing::InPart);
        assert_eq!(standing(Some(&little), Some(&little), &[], false), Standing::Holds);
    }

    #[test]
    fn what_leaves_nearly_all_that_was_there_is_lost_where_that_was_much() {
        let lost =
            |before, after| is_lost(Some(&Structure::of(before)), Some(&Structure::of(after)));
        assert!(lost(0.36, 0.29) && !lost(0.36, 0.2) && !lost(0.08, 0.08));
        let apart =
            |nats, apart| Structure { apart_from_light: Some(apart), ..Structure::of(nats) };
        assert!(!is_lost(Some(&apart(0.3, 0.2)), Some(&apart(0.25, 0.05))));
    }

    #[test]
    fn what_a_recalibration_still_gains_is_much_if_it_is_sure_and_a_third_of_all() {
        let left = |gain, error| Flexible { gain, error };
        assert!(leaves_much(0.14, left(0.13, 0.03)));
        assert!(!leaves_much(0.14, left(0.13, 0.05)), "it is not sure");
        assert!(!leaves_much(1.7, left(0.13, 0.03)), "it is little beside what is gone");
        assert!(!leaves_much(0.02, left(0.03, 0.001)), "it is no mismatch");
    }

    #[test]
    fn where_light_is_guessed_a_name_stands_by_what_its_errors_do_not_show_in() {
        let of = |nats: f64, apart: f64| Structure {
            apart_from_light: Some(apart),
            ..Structure::of(nats)
        };
        let standing = |before: Structure, after: Structure| {
            standing(Some(&before), Some(&after), &[0.002], true)
        };
        // Of 0.19 nats 0.07 are left, which the light's errors alone leave.
        assert_eq!(standing(of(0.19, 0.15), of(0.07, 0.03)), Standing::InPart);
        assert_eq!(standing(of(0.19, 0.15), of(0.07, 0.06)), Standing::Fails);
        assert_eq!(standing(of(0.19, 0.15), of(0.12, 0.03)), Standing::Fails);
    }

    #[test]
    fn a_strength_that_differs_by_factors_is_not_one() {
        let stratum = |change: f64, error: f64| Stratum {
            covariate: "row",
            range: [0.0, 1.0],
            change,
            error,
        };
        // Surely different, yet by a tenth: the light's own error does that.
        assert!(inconstant(&[stratum(0.1, 0.005), stratum(-0.9, 0.6)]).is_none());
        let all = [stratum(0.1, 0.005), stratum(-0.95, 0.08)];
        assert!(inconstant(&all).is_some_and(|found| found.change < -0.9));
    }
}
