//! Fitted values in reported units, with confidence intervals.

use super::model_error::widen_by_model_error;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::{ConfidenceInterval, Evidence, Hypothesis, Nuisance};
use evrig_core::stats::Z90;
use std::collections::BTreeMap;

/// A fitted value in reported units, its interval within the fitted range.
fn interval(
    value: f64,
    error: f64,
    [low, high]: [f64; 2],
    reported: impl Fn(f64) -> f64,
) -> ConfidenceInterval {
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
    ConfidenceInterval { value: reported(value), ci90 }
}

pub(super) fn nuisances(model: &FittedModel) -> BTreeMap<String, ConfidenceInterval> {
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

pub(super) fn parameters(
    evidence: &Evidence,
    model: &FittedModel,
    index: usize,
) -> BTreeMap<String, ConfidenceInterval> {
    let hypothesis = &model.hypothesis;
    let candidate = hypothesis.effects[index];
    let mut intervals = BTreeMap::new();
    if candidate.freed.is_empty() {
        let at = hypothesis.offset_of(index);
        for (i, p) in candidate.parameters.iter().enumerate().filter(|(_, p)| !p.is_hidden) {
            let (value, error) = (hypothesis.values[at + i], model.error_of(at + i));
            let range = hypothesis.ranges[at + i];
            intervals.insert(p.key.to_owned(), interval(value, error, range, |v| p.from_fitted(v)));
        }
        let derived = |values: &[f64]| {
            let own: Vec<f64> =
                candidate.parameters.iter().zip(values).map(|(p, v)| p.from_fitted(*v)).collect();
            (candidate.derived)(evidence, &own)
        };
        let own: Vec<usize> = (at..at + candidate.parameters.len()).collect();
        let of = |values: &[f64]| derived(&values[at..]);
        intervals.extend(derived_intervals(model, &own, of));
    } else {
        let keys = candidate.id.parameters();
        let of = |values: &[f64]| {
            let there = hypothesis.nuisances_with(index, values);
            keys.iter().copied().zip((candidate.report_freed)(&there)).collect()
        };
        intervals.extend(derived_intervals(model, &hypothesis.value_indices(index), of));
    }
    let first = candidate.id.parameters().first().and_then(|key| intervals.get_mut(*key));
    if let Some(ConfidenceInterval { value, ci90: [Some(low), Some(high)] }) = first {
        let more = Z90 * (candidate.reference_error)(evidence);
        *low = *value - (*value - *low).hypot(more);
        *high = *value + (*high - *value).hypot(more);
    }
    widen_by_model_error(&mut intervals, evidence.step_us);
    intervals
}

/// Intervals of derived quantities: each value is moved by its error to either side, within its
/// range.
fn derived_intervals(
    model: &FittedModel,
    moving: &[usize],
    of: impl Fn(&[f64]) -> Vec<(&'static str, f64)>,
) -> Vec<(String, ConfidenceInterval)> {
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
            (key.to_owned(), ConfidenceInterval { value: v, ci90: [end(v - low), end(v + high)] })
        })
        .collect()
}
