//! Nuisances at the ends of their ranges, led back.
//!
//! A nuisance that has as much as is ordinary may stand there in the place of an effect that is much like it: a
//! junction's leak in that of a photocurrent's, of which it is the same where the light is as bright as most. Both
//! lie on a ridge that is too narrow to be followed by slopes: where one is a tenth less the other is a tenth
//! more, to a hundredth. So the nuisance is put elsewhere in its range, and the effect is sought beside it.

use super::fitted::Fitted;
use super::gauss_newton::{as_it_is, each_as_it_is};
use super::local_refinement::{every, polished};
use crate::diagnose::model::library::Parameter;
use crate::diagnose::{Evidence, Hypothesis, Nuisance};

/// Nuisances that are effects of the library when there is more of them, or may stand in for one.
const RIVALS: [Nuisance; 10] = [
    Nuisance::LogRatio,
    Nuisance::LeakHz,
    Nuisance::LogBackgroundOn,
    Nuisance::LogBackgroundOff,
    Nuisance::OffsetUs,
    Nuisance::BlurPx2,
    Nuisance::ShiftX,
    Nuisance::ShiftY,
    Nuisance::RotationDeg,
    Nuisance::Growth,
];

/// A nuisance is at an end of its range within this share of it.
const AT_END: f64 = 0.02;

/// Within this share it is near enough to be led back, through so many parts.
const NEAR_END: f64 = 0.1;
const PARTS: u32 = 4;

/// The effect's first parameter is sought beside it from halved to doubled, in steps of an eighth of that, and
/// then about the best in steps that are halved so many times.
const EIGHTHS: i32 = 8;
const HALVINGS: u32 = 4;

/// A polished fit whose last effect may have a rival among the nuisances, off the ends of their ranges where it is
/// better there.
pub(crate) fn polished_off_the_ends(evidence: &Evidence, fitted: Fitted) -> Fitted {
    let fitted = polished(evidence, fitted);
    let best_of = |part: &Evidence| {
        let elsewhere = off_the_ends(&fitted.hypothesis);
        elsewhere.into_iter().map(|back| beside(part, &back)).reduce(Fitted::or_better)
    };
    let best = match every(evidence, &fitted.hypothesis) {
        1 => best_of(evidence),
        every => best_of(&evidence.thinned(every)).map(|best| as_it_is(evidence, best.hypothesis)),
    };
    match best.filter(|best| best.training() > fitted.training()) {
        Some(better) => polished(evidence, better),
        None => fitted,
    }
}

/// A hypothesis with a nuisance that stands near the end of its range led back through it: once for each nuisance
/// and each part.
pub(crate) fn off_the_ends(hypothesis: &Hypothesis) -> Vec<Hypothesis> {
    if own(hypothesis).is_none() {
        return Vec::new();
    }
    let near_end = RIVALS.into_iter().filter(|rival| is_within(hypothesis, *rival, NEAR_END));
    let led_back = |rival: Nuisance| {
        let [low, high] = hypothesis.ranges[rival as usize];
        (0..PARTS).map(move |part| {
            let share = (f64::from(part) + 0.5) / f64::from(PARTS);
            hypothesis.with_nuisance(rival, low + (high - low) * share)
        })
    };
    near_end.flat_map(led_back).collect()
}

/// The best first parameter of the last effect, all else as it is.
pub(crate) fn beside(evidence: &Evidence, back: &Hypothesis) -> Fitted {
    let eighth = |n: i32| f64::from(n) / f64::from(EIGHTHS);
    let all = (-EIGHTHS..=EIGHTHS).map(|n| scaled(back, eighth(n))).collect();
    let best = each_as_it_is(evidence, all).into_iter().reduce(Fitted::or_better);
    let begun = best.unwrap_or_else(|| as_it_is(evidence, back.clone()));
    (1..=HALVINGS).fold(begun, |best, halving| {
        let by = eighth(1) * 0.5_f64.powi(halving as i32);
        let nearer = [-by, by].map(|by| scaled(&best.hypothesis, by)).into();
        each_as_it_is(evidence, nearer).into_iter().fold(best, Fitted::or_better)
    })
}

/// A hypothesis with that parameter doubled so many times, within its range.
fn scaled(hypothesis: &Hypothesis, doublings: f64) -> Hypothesis {
    let own = own(hypothesis);
    let moved = own.map(|(at, parameter)| hypothesis.scaled(at, parameter, doublings.exp2()));
    moved.unwrap_or_else(|| hypothesis.clone())
}

/// The first parameter of the last effect and the number of its value; what frees a nuisance has none of its own.
fn own(hypothesis: &Hypothesis) -> Option<(usize, &'static Parameter)> {
    let last = hypothesis.effects.len().checked_sub(1)?;
    let effect = hypothesis.effects[last];
    let parameter = effect.parameters.first().filter(|_| effect.frees.is_empty())?;
    Some((hypothesis.offset_of(last), parameter))
}

/// Whether a nuisance has as much as an ordinary recording may have of it.
pub(crate) fn is_full(hypothesis: &Hypothesis, nuisance: Nuisance) -> bool {
    is_within(hypothesis, nuisance, AT_END)
}

/// Whether a nuisance has as much, within this share of its range.
fn is_within(hypothesis: &Hypothesis, nuisance: Nuisance, share: f64) -> bool {
    let at = nuisance as usize;
    let [low, high] = hypothesis.ranges[at];
    // None of it is an end too, and says nothing.
    let is_none =
        (hypothesis.values[at] - nuisance.neutral().max(low)).abs() <= share * (high - low);
    hypothesis.steps[at] > 0.0 && !is_none && hypothesis.is_at_end(at, share)
}
