//! From a fitted model to what is said of it.

use super::departure::above;
use super::model_error::hold_the_law;
use super::proposed_term::propose;
use crate::diagnose::checks::acceptance::Standing;
use crate::diagnose::checks::accepted_effect::Taken;
use crate::diagnose::checks::event_strata::wrong_in;
use crate::diagnose::checks::two_sample_test::Structure;
use crate::diagnose::checks::upper_bound::flexible;
use crate::diagnose::fit::cell_scores::Part;
use crate::diagnose::fit::effect_scan::cannot_judge;
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::model::nuisance::Nuisance;
use crate::diagnose::sensor_wide::Alone;
use crate::diagnose::{
    Diagnosis, Evidence, FitReport, FittedEffect, Half, HeldOut, Hypothesis, Interval, LIBRARY,
    Leftover, Mismatch, NullReport, ProposedTerm, StructureReport, Suspect, Verdict,
};
use evrig_core::stats::Z90;
use std::collections::BTreeMap;

/// An excess below this, nats an event, is no mismatch.
const LEAST_EXCESS: f64 = 0.06;

/// What the search has come to.
pub(crate) struct Reached {
    pub(crate) taken: Vec<Taken>,
    pub(crate) standing: Standing,
    /// What the baseline leaves, and the model with all that was taken.
    pub(crate) before: Option<Structure>,
    pub(crate) after: Option<Structure>,
    /// What the model with all that was taken reaches, recalibrated, nats an event.
    pub(crate) reach: f64,
    pub(crate) suspects: Vec<Suspect>,
    pub(crate) halves: Vec<Half>,
    pub(crate) null: NullReport,
    /// Whether events wait for a readout that is never free, so that no effect on single pixels was looked for.
    pub(crate) is_saturated: bool,
    /// Events that are missing since no neighbour's came before.
    pub(crate) alone: Option<Alone>,
    /// What the frames show otherwise than stated, and the fit in the light as stated.
    pub(crate) departed: (Vec<FittedEffect>, Option<Fitted>),
}

/// Chance that a gain comes out as large where there is none; 1 where nothing was there to measure it by.
fn chance(gain: f64, error: f64) -> f64 {
    let z = gain / error;
    if z.is_nan() { 1.0 } else { above(z) }
}

/// What a model reaches on held-out cells when its hazard is recalibrated, nats an event.
pub(crate) fn reach(evidence: &Evidence, model: &Fitted) -> f64 {
    model.held_out() + flexible(evidence, model).gain.max(0.0)
}

/// Ceiling minus baseline, nats an event.
pub(crate) fn excess(evidence: &Evidence, baseline: &Fitted, model: &Fitted) -> f64 {
    reach(evidence, model).max(reach(evidence, baseline)) - baseline.held_out()
}

pub(crate) fn conclude(
    evidence: &Evidence,
    baseline: &Fitted,
    model: &Fitted,
    reached: Reached,
) -> Diagnosis {
    let Reached { taken, standing, suspects, halves, null, reach, .. } = reached;
    let (departures, as_stated) = reached.departed;
    let (left_before, left_after) = (reached.before, reached.after);
    let (missing, term) = reached.alone.map(|Alone { place, term }| (place, term)).unzip();
    let are_missing = missing.is_some();
    // What decides the verdict comes first.
    let found = |model: &Fitted, left: Option<&Structure>, least: f64| {
        let own = missing.iter().cloned().chain(wrong_in(evidence, model, least));
        with_structure(own.collect(), left, least)
    };
    let (before, after) = (flexible(evidence, baseline), flexible(evidence, model));
    let (low, high) = (baseline.held_out(), model.held_out());
    let ceiling = (low + before.gain).max(high + after.gain.max(0.0)).max(reach);
    let (excess, share) = removed([low, high, ceiling]);
    let verdict = verdict(taken.is_empty(), excess, share, standing).beside(
        !suspects.is_empty(),
        are_missing,
        !departures.is_empty(),
    );
    // With the light as stated for a beginning, what the frames show is a part of what is explained.
    let low = as_stated.as_ref().map_or(low, Fitted::held_out);
    let (excess, share) = removed([low, high, ceiling]);
    let (gain, error) = match taken.as_slice() {
        [] => (before.gain, before.error),
        _ => model.cells.gain(&baseline.cells, Part::HeldOut),
    };
    let is_named = matches!(verdict, Verdict::Explained | Verdict::PartlyExplained);
    let named = if is_named { effects(evidence, model, &taken) } else { Vec::new() };
    let effects = all_named(departures, named);
    let next_recording = splitter(&effects);
    let least = (0.02 * excess).max(0.002);
    Diagnosis {
        schema: "evrig.diagnosis/1".into(),
        verdict,
        mismatch: Mismatch {
            excess_nats_per_event: excess,
            p_value: chance(gain, error),
            places: found(baseline, left_before.as_ref(), least),
        },
        effects,
        nuisances: nuisances(model),
        fit: scores([low, high, ceiling], share),
        leftover: Leftover {
            excess_nats_per_event: ceiling - high,
            p_value: chance(after.gain, after.error),
            places: found(
                model,
                if taken.is_empty() { left_before.as_ref() } else { left_after.as_ref() },
                least,
            ),
        },
        proposed_term: term.or_else(|| propose_for(evidence, model, verdict, left_before.as_ref())),
        next_recording,
        cannot_judge: cannot_judge(evidence, reached.is_saturated),
        suspects,
        halves,
        stamp_step_us: evidence.facts.stamp_step_us,
        structure: left_before.zip(left_after).map(of_both),
        null,
        n_pixels: evidence.pixels.len(),
        n_events: evidence.n_events(),
    }
}

/// What there is to explain, and the share of it that is removed.
fn removed([low, high, ceiling]: [f64; 3]) -> (f64, Option<f64>) {
    let excess = ceiling - low;
    (excess, (excess > 0.0).then(|| (high - low) / excess))
}

/// What frames and a census show, then what the predicted pixels do; what both show is theirs.
fn all_named(mut others: Vec<FittedEffect>, named: Vec<FittedEffect>) -> Vec<FittedEffect> {
    others.retain(|other| named.iter().all(|own| own.id != other.id));
    others.extend(named);
    others
}

/// The recording that would tell the first effect with equals from them.
fn splitter(effects: &[FittedEffect]) -> Option<String> {
    let unsure = effects.iter().find(|effect| !effect.equivalent.is_empty())?;
    LIBRARY.iter().find(|c| c.id == unsure.id).map(|c| c.splitter.to_owned())
}

impl Verdict {
    /// The verdict where an effect bought something and did not hold, where events are missing by no law of a pixel,
    /// and where frames or a census show something beside what the predicted pixels do.
    fn beside(self, is_suspected: bool, are_missing: bool, frames_show: bool) -> Self {
        let own = match self {
            Self::NoMismatch if is_suspected || are_missing => Self::Unexplained,
            Self::Explained if are_missing => Self::PartlyExplained,
            verdict => verdict,
        };
        match own {
            Self::NoMismatch if frames_show => Self::Explained,
            Self::Unexplained if frames_show => Self::PartlyExplained,
            verdict => verdict,
        }
    }
}

fn scores([baseline, r#final, ceiling]: [f64; 3], share: Option<f64>) -> FitReport {
    let ceiling_is = "flexible_fit".into();
    FitReport {
        heldout_nats_per_event: HeldOut { baseline, r#final, ceiling, ceiling_is },
        share_of_excess_removed: share,
        forward: BTreeMap::new(),
    }
}

fn verdict(names_nothing: bool, excess: f64, share: Option<f64>, standing: Standing) -> Verdict {
    match (names_nothing, share, standing) {
        (true, _, Standing::Holds) if excess < LEAST_EXCESS => Verdict::NoMismatch,
        (true, ..) => Verdict::Unexplained,
        (false, Some(share), Standing::Holds) if share >= 0.5 => Verdict::Explained,
        (false, Some(share), _) if share >= 0.25 => Verdict::PartlyExplained,
        (false, ..) => Verdict::Unexplained,
    }
}

/// Strata where a score is wrong, and ranges of what else happened on the sensor, which no score of
/// one pixel sees, where real events and the model's differ in number.
fn with_structure(
    mut places: Vec<crate::diagnose::Where>,
    left: Option<&Structure>,
    least: f64,
) -> Vec<crate::diagnose::Where> {
    let around = left.into_iter().flat_map(|left| left.places.iter().cloned());
    places.extend(around.filter(|place| place.excess_nats_per_event > least));
    places
}

fn of_both((before, after): (Structure, Structure)) -> StructureReport {
    StructureReport { baseline: left(&before), r#final: left(&after) }
}

fn left(structure: &Structure) -> crate::diagnose::StructureLeft {
    crate::diagnose::StructureLeft {
        nats_per_event: structure.nats,
        error: structure.error,
        nats_apart_from_light: structure.apart_from_light,
        accuracy: structure.accuracy,
        told_by: structure.by.iter().take(4).map(|(key, _)| (*key).to_owned()).collect(),
    }
}

/// A term for what is left, where the named effects leave much.
fn propose_for(
    evidence: &Evidence,
    model: &Fitted,
    verdict: Verdict,
    left: Option<&Structure>,
) -> Option<ProposedTerm> {
    let is_wanted = matches!(verdict, Verdict::Unexplained | Verdict::PartlyExplained);
    let of_own = is_wanted.then(|| propose(evidence, model)).flatten();
    // Where what tells most is no matter of the pixel's own light and past, the hazard depends on it.
    let of_others = || left.and_then(|left| left.term());
    match of_own {
        Some(own) => match of_others() {
            Some(other) if other.heldout_gain_nats_per_event > own.heldout_gain_nats_per_event => {
                Some(other)
            }
            _ => Some(own),
        },
        None => is_wanted.then(of_others).flatten(),
    }
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

fn effects(evidence: &Evidence, model: &Fitted, taken: &[Taken]) -> Vec<FittedEffect> {
    let hypothesis = &model.hypothesis;
    taken
        .iter()
        .enumerate()
        .map(|(index, taken)| {
            let candidate = hypothesis.effects[index];
            let mut equivalent = taken.equals.clone();
            let twins = candidate.twins.iter().filter(|twin| !taken.equals.contains(twin));
            equivalent.extend(twins);
            if evidence.facts.clocks.is_none() {
                equivalent.extend(candidate.same);
            }
            let p_value = (chance(taken.gain, taken.error) * LIBRARY.len() as f64).min(1.0);
            FittedEffect {
                id: candidate.id,
                name: candidate.id.name().into(),
                equation: candidate.equation.into(),
                says: (candidate.says)(&hypothesis.parameters_of(index)),
                parameters: parameters(evidence, model, index),
                heldout_gain_nats_per_event: taken.gain,
                heldout_gain_error: taken.error,
                p_value,
                region: hypothesis.regions[index].and_then(|r| serde_json::to_value(r).ok()),
                equivalent,
                rivals: taken.rivals.clone(),
            }
        })
        .collect()
}

pub(crate) fn parameters(
    evidence: &Evidence,
    model: &Fitted,
    index: usize,
) -> BTreeMap<String, Interval> {
    let hypothesis = &model.hypothesis;
    let candidate = hypothesis.effects[index];
    let mut told = BTreeMap::new();
    if candidate.frees.is_empty() {
        let at = hypothesis.offset_of(index);
        for (i, p) in candidate.parameters.iter().enumerate().filter(|(_, p)| !p.is_hidden) {
            let (value, error) = (hypothesis.values[at + i], model.error_of(at + i));
            let range = hypothesis.ranges[at + i];
            told.insert(p.key.to_owned(), interval(value, error, range, |v| p.from_fitted(v)));
        }
        let derived = |values: &[f64]| {
            let own: Vec<f64> =
                candidate.parameters.iter().zip(values).map(|(p, v)| p.from_fitted(*v)).collect();
            (candidate.derived)(evidence, &own)
        };
        let own: Vec<usize> = (at..at + candidate.parameters.len()).collect();
        let of = |values: &[f64]| derived(&values[at..]);
        told.extend(following(model, &own, of));
    } else {
        let keys = candidate.id.parameters();
        let of = |values: &[f64]| {
            let there = hypothesis.nuisances_under(index, values);
            keys.iter().copied().zip((candidate.report)(&there)).collect()
        };
        told.extend(following(model, &hypothesis.places_of(index), of));
    }
    let first = candidate.id.parameters().first().and_then(|key| told.get_mut(*key));
    if let Some(Interval { value, ci90: [Some(low), Some(high)] }) = first {
        let more = Z90 * (candidate.against)(evidence);
        *low = *value - (*value - *low).hypot(more);
        *high = *value + (*high - *value).hypot(more);
    }
    hold_the_law(&mut told, evidence.step_us);
    told
}

/// Quantities that follow from fitted values: one value at a time is moved by its error to either side, as far
/// as its range goes.
fn following(
    model: &Fitted,
    moving: &[usize],
    of: impl Fn(&[f64]) -> Vec<(&'static str, f64)>,
) -> Vec<(String, Interval)> {
    let Hypothesis { values, ranges, steps, .. } = &model.hypothesis;
    let here = of(values);
    let mut spread = vec![[0.0_f64; 2]; here.len()];
    for &i in moving {
        let error = model.error_of(i);
        let mut beside = values.clone();
        beside[i] += steps[i];
        if steps[i] <= 0.0 || of(&beside) == here {
            continue;
        }
        let [down, up] = [-Z90, Z90].map(|z| {
            let mut moved = values.clone();
            moved[i] = (values[i] + z * error).clamp(ranges[i][0], ranges[i][1]);
            of(&moved)
        });
        for (n, [low, high]) in spread.iter_mut().enumerate() {
            let by = [down[n].1 - here[n].1, up[n].1 - here[n].1];
            let wide = |change: f64| if error.is_finite() { change } else { f64::NAN };
            *low = low.hypot(wide(by[0].min(by[1]).min(0.0)));
            *high = high.hypot(wide(by[0].max(by[1]).max(0.0)));
        }
    }
    let end = |e: f64| Some(e).filter(|e| e.is_finite());
    here.into_iter()
        .zip(spread)
        .map(|((key, v), [low, high])| {
            (key.to_owned(), Interval { value: v, ci90: [end(v - low), end(v + high)] })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_that_nothing_measured_is_no_sign_and_one_without_scatter_is_a_sure_one() {
        assert_eq!([chance(0.0, 0.0), chance(1.0, 0.0)], [1.0, 0.0]);
        assert!((chance(1.644_853_6, 1.0) - 0.05).abs() < 1e-6);
    }
}
