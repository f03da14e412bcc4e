//! The short trials that every check runs, and what they must hold.

use super::judge::Judgement;
use super::strength::strengths;
use super::truth::{ConcealedEffect, ConcealedTrial, Family, SealedTruth};

/// Hidden in the short trials: an effect that acts in every pixel and leaves a mark of its own in
/// each, three times as strong as the least strength of the table; and nothing.
const HIDDEN: &[Option<&str>] = &[Some("refractory_period"), None];

/// How many times the least strength: far above any floor, so that a miss means that something
/// broke, not that a draw was unlucky.
const STRENGTH: f64 = 3.0;

/// The greatest relative error of a parameter; a right fit is within a few percent.
const LARGEST_ERROR: f64 = 0.15;

/// The short trials: always the same, so that what they hold on one machine they hold on another.
#[must_use]
pub fn quick(seed: u64) -> Vec<ConcealedTrial> {
    let (known, _) = strengths(Family::World);
    let trial = |(number, hidden): (usize, &Option<&str>)| {
        let entry = known.iter().find(|entry| Some(entry.id) == *hidden);
        let effects = entry.into_iter().map(|entry| ConcealedEffect {
            id: entry.id.into(),
            parameters: entry.parameters(STRENGTH),
            strength: STRENGTH,
        });
        ConcealedTrial {
            name: format!("quick-{number:03}"),
            family: Family::World,
            image: "leaves-1".into(),
            trajectory: "circle".into(),
            seed: seed.wrapping_add(number as u64),
            truth: SealedTruth { effects: effects.collect(), ..SealedTruth::nothing() },
        }
    };
    HIDDEN.iter().enumerate().map(trial).collect()
}

/// What the short trials did not hold; nothing when all is well.
#[must_use]
pub fn quick_failures(judgements: &[Judgement]) -> Vec<String> {
    judgements.iter().filter_map(complaint).collect()
}

fn complaint(judgement: &Judgement) -> Option<String> {
    let trial = &judgement.trial;
    let named = judgement.named.join(", ");
    let Some(hidden) = judgement.hidden.first() else {
        // Nothing was hidden: a name is a false discovery, and so is more than a minor mismatch,
        // which the error of the reconstructed light makes.
        let is_small = ["no_mismatch", "minor_mismatch"].contains(&judgement.verdict.as_str());
        return (!is_small)
            .then(|| format!("{trial}: clean, called {} ({named})", judgement.verdict));
    };
    if !judgement.is_top1 {
        let message = if named.is_empty() { &judgement.verdict } else { &named };
        return Some(format!("{trial}: hidden: {hidden}, accepted first: {message}"));
    }
    if judgement.wrong > 0 {
        return Some(format!("{trial}: hid {hidden} alone, named {named}"));
    }
    let off = judgement.parameters.iter().find(|check| check.relative_error > LARGEST_ERROR)?;
    Some(format!("{trial}: {} is {}, found {}", off.key, off.truth, off.value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prove::ParameterCheck;

    fn judgement(hidden: Option<&str>, named: &[&str], verdict: &str) -> Judgement {
        let is_top1 = named.first().copied() == hidden && hidden.is_some();
        let check = |value: f64| ParameterCheck {
            id: "refractory_period".into(),
            key: "refractory_us".into(),
            truth: 4_500.0,
            value,
            relative_error: (value / 4_500.0 - 1.0).abs(),
            is_covered: None,
            error_in_intervals: None,
        };
        Judgement {
            trial: "quick-000".into(),
            hidden: hidden.into_iter().map(str::to_owned).collect(),
            strengths: vec![3.0; usize::from(hidden.is_some())],
            named: named.iter().map(|&id| id.to_owned()).collect(),
            verdict: verdict.into(),
            is_top1,
            is_top1_or_equivalent: is_top1,
            right: usize::from(is_top1),
            wrong: named.len() - usize::from(is_top1),
            missed: 0,
            parameters: vec![check(4_600.0)],
            region_f1: None,
            share_removed: None,
            first_gain: None,
            is_outside_library: false,
            is_declared_undecidable: false,
            diagnosed_s: 1.0,
        }
    }

    const DEAD: Option<&str> = Some("refractory_period");

    #[test]
    fn the_short_trials_are_always_the_same_and_one_hides_nothing() {
        let trials = quick(1);
        assert_eq!(trials, quick(1));
        assert_eq!(trials.iter().filter(|trial| trial.truth.is_clean()).count(), 1);
        assert!(trials.iter().all(|trial| !trial.truth.is_outside_library()));
        assert_eq!(trials[0].truth.effects[0].parameters["refractory_us"], 4_500.0);
    }

    #[test]
    fn right_answers_are_not_complained_of() {
        let right = [
            judgement(DEAD, &["refractory_period"], "explained"),
            judgement(None, &[], "no_mismatch"),
        ];
        assert!(quick_failures(&right).is_empty(), "{:?}", quick_failures(&right));
    }

    #[test]
    fn a_false_name_a_miss_a_second_name_and_a_wrong_number_are() {
        let mut off = judgement(DEAD, &["refractory_period"], "explained");
        off.parameters[0].value = 6_000.0;
        off.parameters[0].relative_error = 1.0 / 3.0;
        let wrong = [
            judgement(None, &["flicker"], "explained"),
            judgement(None, &[], "unexplained"),
            judgement(DEAD, &[], "no_mismatch"),
            judgement(DEAD, &["stamp_jitter"], "explained"),
            judgement(DEAD, &["refractory_period", "flicker"], "explained"),
            off,
        ];
        for judgement in wrong {
            assert_eq!(quick_failures(std::slice::from_ref(&judgement)).len(), 1, "{judgement:?}");
        }
    }
}
