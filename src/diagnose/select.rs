//! The search as a whole: baseline, effects one by one, null, verdict.

use super::ceiling::flexible;
use super::fit::{Fitted, fit, with_errors};
use super::nuisance::Nuisance;
use super::propose::propose;
use super::scan::{Tried, cannot_judge, scan};
use super::score::Part;
use super::strata::{held_out_nats, wrong_in};
use super::{
    Diagnosis, Evidence, FitReport, FittedEffect, HeldOut, Hypothesis, Interval, LIBRARY, Leftover,
    Mismatch, NullReport, Options, ProposedTerm, Rival, Verdict, null,
};
use statrs::function::erf::erfc;
use std::collections::BTreeMap;

/// An effect has to buy this much, nats an event, whatever the null says: below it the shape of
/// the noise, which the model has only nearly, speaks as loudly.
const LEAST_GAIN: f64 = 0.02;

/// An excess below this, nats an event, is no mismatch.
const LEAST_EXCESS: f64 = 0.06;

/// An effect's gain has to be so many of its standard errors.
const LEAST_ERRORS: f64 = 4.0;

/// Half width of a 90 % interval in standard errors.
const Z90: f64 = 1.645;

/// An effect that was taken, with what it was measured against.
struct Taken {
    gain: f64,
    error: f64,
    rivals: Vec<Rival>,
    equals: Vec<crate::effect_id::EffectId>,
}

/// Diagnoses: which effects of the library does the recording show beyond the baseline?
///
/// `progress` is told what is being looked at.
#[must_use]
pub fn diagnose(
    evidence: &Evidence,
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> Diagnosis {
    progress("baseline");
    let few = evidence.thinned(2);
    let begun = fit(&few, Hypothesis::baseline(evidence), 12, 1e-4);
    let baseline = fit(evidence, begun.hypothesis, 12, 1e-5);
    let (baseline, model, taken) = take_all(evidence, &few, baseline, options, progress);
    let (mut model, mut taken) = prune(evidence, &baseline, model, taken);
    progress("null");
    let n_null = options.n_null;
    let greatest = null::greatest_gains(evidence, &model, n_null, options.seed, progress);
    let worst = greatest.iter().copied().fold(0.0, f64::max);
    let flexible_before = flexible(evidence, &baseline);
    let excess = {
        let final_now = held_out_nats(&model) + flexible(evidence, &model).gain.max(0.0);
        let before = held_out_nats(&baseline) + flexible_before.gain.max(0.0);
        final_now.max(before) - held_out_nats(&baseline)
    };
    let bar = LEAST_GAIN.max(worst).max(0.01 * excess);
    while taken.last().is_some_and(|last| last.gain < bar) {
        taken.pop();
        let kept: Vec<usize> = (0..taken.len()).collect();
        model = refit_with(evidence, &baseline, &model, &kept);
    }
    let model = with_errors(evidence, model);
    let report = NullReport { n: n_null, greatest_gains: greatest, bar_nats_per_event: bar };
    conclude(evidence, &baseline, &model, &taken, report)
}

/// Takes effects one by one while they buy enough. A fit with an effect may come by better
/// nuisances than the fit without had found; the model then takes them over before it is compared,
/// so that they are not booked to the effect.
fn take_all(
    evidence: &Evidence,
    few: &Evidence,
    mut baseline: Fitted,
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> (Fitted, Fitted, Vec<Taken>) {
    let mut model = baseline.clone();
    let mut taken = Vec::new();
    while taken.len() < options.max_effects {
        let mut tried: Vec<Tried> = scan(evidence, few, &model, progress)
            .into_iter()
            .filter(|tried| has_signature(evidence, tried))
            .collect();
        for _ in 0..3 {
            let Some(best) = tried.first() else { break };
            let same = model.hypothesis.at_values_of(&best.fitted.hypothesis);
            let without = fit(evidence, same, 6, 1e-5);
            if without.cells.nats(Part::Training) <= model.cells.nats(Part::Training) + 1e-4 {
                break;
            }
            model = without;
            if taken.is_empty() {
                baseline = model.clone();
            }
            tried = tried.into_iter().map(|tried| tried.against(&model)).collect();
            tried.sort_by(|a, b| b.gain.held_out.total_cmp(&a.gain.held_out));
        }
        let Some(best) = tried.first() else { break };
        let gain = best.gain;
        if gain.held_out < LEAST_GAIN || gain.held_out < LEAST_ERRORS * gain.error {
            break;
        }
        taken.push(Taken {
            gain: gain.held_out,
            error: gain.error,
            rivals: rivals(&tried),
            equals: equals(&tried),
        });
        model = fit(evidence, best.fitted.hypothesis.clone(), 8, 1e-5);
    }
    (baseline, model, taken)
}

/// Whether what belongs to the effect that was tried last is in the events.
fn has_signature(evidence: &Evidence, tried: &Tried) -> bool {
    let hypothesis = &tried.fitted.hypothesis;
    let last = hypothesis.effects.len() - 1;
    (hypothesis.effects[last].agrees)(evidence, &hypothesis.parameters_of(last))
}

fn rivals(tried: &[Tried]) -> Vec<Rival> {
    let rest = tried.iter().skip(1).take(5);
    rest.map(|t| Rival { id: t.gain.id, heldout_gain_nats_per_event: t.gain.held_out }).collect()
}

/// Those whose score is within one standard error of the best's.
fn equals(tried: &[Tried]) -> Vec<crate::effect_id::EffectId> {
    let Some(best) = tried.first() else { return Vec::new() };
    let close = |t: &&Tried| {
        let (gain, error) = best.fitted.cells.gain(&t.fitted.cells, Part::HeldOut);
        gain <= error
    };
    // A first fit on some of the pixels does not compare.
    let full = |t: &&Tried| {
        t.fitted.cells.n_events.iter().sum::<f64>()
            == best.fitted.cells.n_events.iter().sum::<f64>()
    };
    tried.iter().skip(1).filter(full).filter(close).map(|t| t.gain.id).collect()
}

/// Leaves out what has become idle: an effect that was taken early and that later ones replace.
fn prune(
    evidence: &Evidence,
    baseline: &Fitted,
    mut model: Fitted,
    mut taken: Vec<Taken>,
) -> (Fitted, Vec<Taken>) {
    let mut index = 0;
    while taken.len() > 1 && index < taken.len() {
        let rest: Vec<usize> = (0..taken.len()).filter(|&i| i != index).collect();
        let without = refit_with(evidence, baseline, &model, &rest);
        let (loss, error) = model.cells.gain(&without.cells, Part::HeldOut);
        if loss < LEAST_GAIN || loss < LEAST_ERRORS * error {
            taken.remove(index);
            model = without;
        } else {
            index += 1;
        }
    }
    (model, taken)
}

/// The model with only some of its effects.
fn refit_with(evidence: &Evidence, baseline: &Fitted, model: &Fitted, kept: &[usize]) -> Fitted {
    let mut hypothesis = baseline.hypothesis.clone();
    for &index in kept {
        let effect = model.hypothesis.effects[index];
        let start: Vec<f64> = if effect.frees.is_empty() {
            let at = model.hypothesis.offset_of(index);
            model.hypothesis.values[at..at + effect.parameters.len()].to_vec()
        } else {
            effect.frees.iter().map(|f| model.hypothesis.nuisance(f.nuisance)).collect()
        };
        hypothesis = hypothesis.with(effect, &start);
    }
    fit(evidence, hypothesis, 6, 1e-4)
}

/// Chance of a standard normal value above `z`.
fn above(z: f64) -> f64 {
    0.5 * erfc(z / std::f64::consts::SQRT_2)
}

fn conclude(
    evidence: &Evidence,
    baseline: &Fitted,
    model: &Fitted,
    taken: &[Taken],
    null: NullReport,
) -> Diagnosis {
    let (before, after) = (flexible(evidence, baseline), flexible(evidence, model));
    let (low, high) = (held_out_nats(baseline), held_out_nats(model));
    let ceiling = (low + before.gain).max(high + after.gain.max(0.0));
    let excess = ceiling - low;
    let share = (excess > 0.0).then(|| (high - low) / excess);
    let (gain, error) = model.cells.gain(&baseline.cells, Part::HeldOut);
    let z = if taken.is_empty() { before.gain / before.error } else { gain / error };
    let verdict = match (taken.is_empty(), share) {
        (true, _) if excess < LEAST_EXCESS => Verdict::NoMismatch,
        (true, _) => Verdict::Unexplained,
        (false, Some(share)) if share >= 0.5 => Verdict::Explained,
        (false, Some(share)) if share >= 0.25 => Verdict::PartlyExplained,
        (false, _) => Verdict::Unexplained,
    };
    let is_named = matches!(verdict, Verdict::Explained | Verdict::PartlyExplained);
    let effects = if is_named { effects(model, taken) } else { Vec::new() };
    let next_recording = effects
        .iter()
        .find(|e| !e.equivalent.is_empty())
        .and_then(|e| LIBRARY.iter().find(|c| c.id == e.id).map(|c| c.splitter.to_owned()));
    let least = (0.02 * excess).max(0.002);
    Diagnosis {
        schema: "evrig.diagnosis/1".into(),
        verdict,
        mismatch: Mismatch {
            excess_nats_per_event: excess,
            p_value: above(z),
            places: wrong_in(evidence, baseline, least),
        },
        effects,
        nuisances: nuisances(model),
        fit: FitReport {
            heldout_nats_per_event: HeldOut {
                baseline: low,
                r#final: high,
                ceiling,
                ceiling_is: "flexible_fit".into(),
            },
            share_of_excess_removed: share,
            forward: BTreeMap::new(),
        },
        leftover: Leftover {
            excess_nats_per_event: ceiling - high,
            p_value: above(after.gain / after.error),
            places: wrong_in(evidence, model, least),
        },
        proposed_term: propose_for(evidence, model, verdict),
        next_recording,
        cannot_judge: cannot_judge(evidence),
        null,
        n_pixels: evidence.pixels.len(),
        n_events: evidence.n_events(),
    }
}

/// A term for what is left, where the named effects leave much.
fn propose_for(evidence: &Evidence, model: &Fitted, verdict: Verdict) -> Option<ProposedTerm> {
    let is_wanted = matches!(verdict, Verdict::Unexplained | Verdict::PartlyExplained);
    is_wanted.then(|| propose(evidence, model)).flatten()
}

/// A fitted value as it is reported, its interval within the range it was fitted in.
fn interval(
    value: f64,
    error: f64,
    [low, high]: [f64; 2],
    reported: impl Fn(f64) -> f64,
) -> Interval {
    let end = |z: f64| {
        let end = (value + z * error).clamp(low, high);
        Some(reported(end)).filter(|v| v.is_finite())
    };
    let mut ci90 = if error.is_finite() { [end(-Z90), end(Z90)] } else { [None, None] };
    if let [Some(a), Some(b)] = ci90
        && a > b
    {
        ci90 = [Some(b), Some(a)];
    }
    Interval { value: reported(value), ci90 }
}

fn nuisances(model: &Fitted) -> BTreeMap<String, Interval> {
    let hypothesis = &model.hypothesis;
    Nuisance::ALL
        .iter()
        .filter(|n| hypothesis.ranges[**n as usize][0] < hypothesis.ranges[**n as usize][1])
        .map(|&n| {
            let error = model.error_of(n as usize);
            let range = hypothesis.ranges[n as usize];
            let value = hypothesis.nuisance(n);
            (n.key().to_owned(), interval(value, error, range, |v| n.reported(v)))
        })
        .collect()
}

fn effects(model: &Fitted, taken: &[Taken]) -> Vec<FittedEffect> {
    let hypothesis = &model.hypothesis;
    taken
        .iter()
        .enumerate()
        .map(|(index, taken)| {
            let candidate = hypothesis.effects[index];
            let mut equivalent = taken.equals.clone();
            equivalent.extend(candidate.same);
            let p_value = (above(taken.gain / taken.error) * LIBRARY.len() as f64).min(1.0);
            FittedEffect {
                id: candidate.id,
                name: candidate.id.name().into(),
                equation: candidate.equation.into(),
                says: (candidate.says)(&hypothesis.parameters_of(index)),
                parameters: parameters(model, index),
                heldout_gain_nats_per_event: taken.gain,
                heldout_gain_error: taken.error,
                p_value,
                region: None,
                equivalent,
                rivals: taken.rivals.clone(),
            }
        })
        .collect()
}

fn parameters(model: &Fitted, index: usize) -> BTreeMap<String, Interval> {
    let hypothesis = &model.hypothesis;
    let candidate = hypothesis.effects[index];
    if candidate.frees.is_empty() {
        let at = hypothesis.offset_of(index);
        let own = candidate.parameters.iter().enumerate().filter(|(_, p)| !p.is_hidden);
        return own
            .map(|(i, p)| {
                let (value, error) = (hypothesis.values[at + i], model.error_of(at + i));
                let range = hypothesis.ranges[at + i];
                (p.key.to_owned(), interval(value, error, range, |v| p.from_fitted(v)))
            })
            .collect();
    }
    let value = (candidate.report)(&hypothesis.values);
    // One freed value at a time is moved by its error.
    let mut spread = vec![0.0_f64; value.len()];
    for freed in candidate.frees {
        let i = freed.nuisance as usize;
        let mut moved = hypothesis.values.clone();
        moved[i] += Z90 * model.error_of(i);
        for ((s, there), here) in spread.iter_mut().zip((candidate.report)(&moved)).zip(&value) {
            *s = s.hypot(there - here);
        }
    }
    let keys = candidate.id.parameters().iter();
    keys.zip(value.iter().zip(&spread))
        .map(|(key, (&v, &s))| {
            let end = |e: f64| Some(e).filter(|e| e.is_finite());
            ((*key).to_owned(), Interval { value: v, ci90: [end(v - s), end(v + s)] })
        })
        .collect()
}
