//! Where fits with one more effect begin.
//!
//! A nuisance may have taken upon itself what an effect does: a threshold of twice its size, or noise that no
//! camera has. From there a search goes down into another valley, and a start that is right looks wrong. So some
//! begin with what has stood in out of the way, and some with nuisances as they ordinarily are.

use super::fitted::Fitted;
use super::gauss_newton::{each_as_it_is, improved};
use super::local_refinement::{LAST_STEPS, few_of, fitted};
use crate::diagnose::model::library::Candidate;
use crate::diagnose::{Evidence, Hypothesis, Nuisance};

/// Steps of a first fit, on some of the pixels.
pub(crate) const FIRST_STEPS: usize = 4;

/// Starts of an effect that are moved by a step.
pub(crate) const BEST_STARTS: usize = 2;

/// Offsets of the clocks within this are one, microseconds.
const SAME_OFFSET_US: f64 = 50.0;

/// Share of a nuisance's range within which it stands at an end.
const AT_THE_END: f64 = 1e-6;

/// Thresholds, log intensity, and noise, thresholds at white, of nuisances that begin anew between frames.
const THETAS: [f64; 3] = [0.2, 0.4, 0.8];
const NOISE: f64 = 0.2;

/// Starts of an effect on top of a model.
pub(crate) fn starts_of(
    evidence: &Evidence,
    model: &Hypothesis,
    candidate: &'static Candidate,
) -> Vec<Hypothesis> {
    let own = (candidate.starts)(evidence);
    let anew = anew(evidence, model);
    let mut starts = Vec::new();
    for start in own.iter().chain(&at_the_end(model, candidate)) {
        starts.extend(along(evidence, model, candidate, start));
    }
    for start in &own {
        starts.extend(anew.iter().map(|begun| begun.with(candidate, start)));
    }
    starts
}

/// A start on top of a model as it is, and with what may have stood in for the effect out of the way.
fn along(
    evidence: &Evidence,
    model: &Hypothesis,
    candidate: &'static Candidate,
    start: &[f64],
) -> impl Iterator<Item = Hypothesis> {
    let plain = model.with(candidate, start);
    let offset_us = (candidate.offset_us)(evidence, start);
    // Without the effect the clocks may have had to stand in for it; with it they need not.
    let us = offset_us.unwrap_or(0.0);
    let is_elsewhere = (us - plain.nuisance(Nuisance::OffsetUs)).abs() > SAME_OFFSET_US;
    let stated = is_elsewhere && candidate.frees.is_empty();
    let stated = stated.then(|| plain.with_nuisance(Nuisance::OffsetUs, us));
    [Some(plain.clone()), stated].into_iter().flatten().chain(freed(plain, candidate))
}

/// A model with nuisances as they are at first, at some thresholds. Where the light is led from frame to frame so much
/// of it is unknown that noise and threshold may be nearly anything: events that are a frame late pass for those of a
/// pixel that hardly sees.
fn anew(evidence: &Evidence, model: &Hypothesis) -> Vec<Hypothesis> {
    if !evidence.facts.is_led {
        return Vec::new();
    }
    let begun = ordinary(evidence, model, model.effects.len());
    let begun = begun.with_nuisance(Nuisance::LogNoise, NOISE.ln());
    THETAS.map(|theta| begun.with_nuisance(Nuisance::LogTheta, theta.ln())).to_vec()
}

/// A hypothesis with its nuisances as they are at first, but those that one of its first effects has freed.
fn ordinary(evidence: &Evidence, hypothesis: &Hypothesis, n_effects: usize) -> Hypothesis {
    let is_of_an_effect =
        |at: usize| (0..n_effects).any(|index| hypothesis.places_of(index).contains(&at));
    let own = Nuisance::ALL.into_iter().filter(|n| !is_of_an_effect(*n as usize));
    own.fold(hypothesis.clone(), |begun, nuisance| {
        begun.with_nuisance(nuisance, nuisance.ordinary(&evidence.facts).start)
    })
}

/// A start with what may have stood in for the effect out of its way; none where nothing may have.
fn freed(start: Hypothesis, candidate: &'static Candidate) -> impl Iterator<Item = Hypothesis> {
    let raises = if candidate.stand_ins.is_empty() { &[] } else { candidate.raises };
    raises.iter().map(move |raise| {
        let log_theta = start.nuisance(Nuisance::LogTheta) + raise;
        let raised = start.with_nuisance(Nuisance::LogTheta, log_theta);
        let freed = |other: Hypothesis, &(nuisance, value): &(Nuisance, f64)| {
            other.with_nuisance(nuisance, value)
        };
        candidate.stand_ins.iter().fold(raised, freed)
    })
}

/// Where nuisances stand that an effect frees, if the end of an ordinary range holds one of them: a camera that is all
/// but ideal tells its leak so finely that no other start is near enough.
fn at_the_end(model: &Hypothesis, candidate: &Candidate) -> Option<Vec<f64>> {
    let freed = || candidate.frees.iter().map(|freed| freed.nuisance);
    let is_held = freed().any(|nuisance| model.is_at_end(nuisance as usize, AT_THE_END));
    is_held.then(|| freed().map(|nuisance| model.nuisance(nuisance)).collect())
}

/// The best of a fit as it is and with the values that its last effect may start from: beside nuisances
/// that are fitted, one of them may lie behind a ridge that the fit has not come over.
pub(crate) fn restarted(evidence: &Evidence, fitted: Fitted) -> Fitted {
    let Some(last) = fitted.hypothesis.effects.len().checked_sub(1) else { return fitted };
    let effect = fitted.hypothesis.effects[last];
    if !effect.frees.is_empty() {
        return fitted;
    }
    let begun = each_as_it_is(evidence, at_its_starts(evidence, &fitted.hypothesis, last));
    begun.into_iter().fold(fitted, Fitted::or_better)
}

/// A hypothesis with an effect's own parameters at each of the values that they may start from.
fn at_its_starts(evidence: &Evidence, hypothesis: &Hypothesis, index: usize) -> Vec<Hypothesis> {
    let at = hypothesis.offset_of(index);
    let begun = |start: Vec<f64>| {
        let mut begun = hypothesis.clone();
        begun.values[at..at + start.len()].copy_from_slice(&start);
        begun
    };
    (hypothesis.effects[index].starts)(evidence).into_iter().map(begun).collect()
}

/// The same model fitted from where all of it began: nuisances at their ordinary values, the last effect where it
/// may start. Without the effect they have taken what it does upon themselves, all together, and from there a
/// search may go down into another valley with it. `None` where the last effect is a nuisance out of its range.
pub(crate) fn afresh(evidence: &Evidence, hypothesis: &Hypothesis) -> Option<Fitted> {
    let last = hypothesis.effects.len().checked_sub(1)?;
    let effect = hypothesis.effects[last];
    if !effect.frees.is_empty() {
        return None;
    }
    let ordinary = ordinary(evidence, hypothesis, last);
    let theta = hypothesis.nuisance(Nuisance::LogTheta);
    let at_theta = ordinary.with_nuisance(Nuisance::LogTheta, theta);
    let both = [ordinary, at_theta];
    let starts = both.iter().flat_map(|begun| at_its_starts(evidence, begun, last)).collect();
    let few = few_of(evidence, hypothesis);
    let there = few.as_ref().unwrap_or(evidence);
    let mut scored = each_as_it_is(there, starts);
    scored.sort_by(|a, b| b.training().total_cmp(&a.training()));
    scored.truncate(BEST_STARTS);
    let moved = scored.into_iter().map(|begun| improved(there, begun, FIRST_STEPS, 1e-4));
    let best = moved.reduce(Fitted::or_better)?;
    Some(fitted(evidence, best.hypothesis, LAST_STEPS, 1e-4))
}
