//! Is an effect's strength the same in all strata?
//!
//! At the optimum the total score (derivative of the log-likelihood) of a strength is zero. Under
//! the right law the events of each stratum have the same score as events simulated from the model
//! (fluctuation tests, Zeileis and Hornik, Stat. Neerl. 61, 2007). The difference over the mean
//! squared score is the relative change of strength that the stratum asks for. A wrong effect asks
//! for changes by factors.

use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::fit::pixel_strata::strata_of_pixels;
use crate::diagnose::model::library::{CandidateEffect, CandidateParameter};
use crate::diagnose::{Evidence, Hypothesis};
use crate::predict::{Residual, residuals};
use evrig_core::geometry::Rectangle;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Strata per covariate.
const N_STRATA: usize = 5;

const MIN_EVENTS_PER_STRATUM: usize = 150;

/// Effective number of simulated events that a stratum needs.
const MIN_EFFECTIVE_EVENTS: f64 = 25.0;

/// Share of the Fisher information that a stratum needs. Below it a light error of 0.1 % looks like
/// a large change of strength.
const MIN_INFORMATION_SHARE: f64 = 0.02;

/// The strength that a stratum asks for.
#[derive(Debug, Clone)]
pub(crate) struct StratumStrength {
    pub(crate) covariate: &'static str,
    pub(crate) range: [f64; 2],
    /// Relative change from the overall strength; -1: the effect is absent.
    pub(crate) change: f64,
    /// Standard error of the change.
    pub(crate) error: f64,
}

const COVARIATES: [&str; 11] = [
    "contrast_rate_per_s",
    "log_intensity",
    "interval_us",
    "polarity_on",
    "column",
    "row",
    "time_s",
    "neighbour_us",
    "neighbours",
    "sensor_rate_hz",
    "since_frame_us",
];

/// Values in the order of [`COVARIATES`].
fn covariates(evidence: &Evidence, r: &Residual) -> [f64; COVARIATES.len()] {
    let (near_us, n_near) = evidence.event_context.neighbours(r.x, r.y, r.t_us, 5_000);
    [
        r.slope_per_s,
        r.level,
        r.previous.map_or(f64::NAN, |p| p.ago_s * 1e6),
        f64::from(u8::from(r.on)),
        f64::from(r.x),
        f64::from(r.y),
        r.t_us as f64 * 1e-6,
        near_us,
        n_near,
        evidence.rate_hz(r.t_us),
        evidence.event_context.since_frame_us(r.t_us),
    ]
}

/// Strengths of an effect by stratum, against `drawn`: the same pixels with events simulated from
/// the model. Empty for an effect without a strength.
pub(crate) fn strengths_by_stratum(
    evidence: &Evidence,
    drawn: &Evidence,
    model: &FittedModel,
    index: usize,
) -> Vec<StratumStrength> {
    let hypothesis = &model.hypothesis;
    let Some(strength) = StrengthParameters::of(hypothesis, index) else { return Vec::new() };
    let moved = |sign: f64| {
        let mut other = hypothesis.clone();
        strength.at.iter().for_each(|at| other.values[*at] += sign * strength.step);
        other
    };
    let two = [moved(-1.0), moved(1.0)];
    let region = hypothesis.regions[index];
    let [real, drawn] = [evidence, drawn].map(|evidence| events(evidence, &two, &strength, region));
    let asked = |events: &[EventScore]| -> Vec<[f64; COVARIATES.len()]> {
        events.par_iter().map(|event| covariates(evidence, &event.residual)).collect()
    };
    let (of_real, of_drawn) = (asked(&real), asked(&drawn));
    let mut found = Vec::new();
    for (i, key) in COVARIATES.into_iter().enumerate() {
        let [on_real, on_drawn] =
            [&of_real, &of_drawn].map(|all| all.iter().map(|asked| asked[i]).collect::<Vec<f64>>());
        found.extend(of_covariate(key, (&real, &on_real), (&drawn, &on_drawn)));
    }
    found
}

/// The values that are a strength.
struct StrengthParameters {
    at: Vec<usize>,
    step: f64,
    /// Change of the value per change of the strength's logarithm.
    unit: f64,
}

impl StrengthParameters {
    fn of(hypothesis: &Hypothesis, index: usize) -> Option<Self> {
        let effect: &CandidateEffect = hypothesis.effects[index];
        if let Some(freed) = effect.freed.first() {
            let places = hypothesis.value_indices(index);
            let first = *places.first()?;
            let (from, step) = (freed.nuisance.neutral(), hypothesis.steps[first]);
            if from.is_finite() {
                let unit = hypothesis.values[first] - from;
                return (unit != 0.0).then(|| Self { at: vec![first], step, unit });
            }
            // ON and OFF rates change by the same factor.
            let rates = effect.freed.iter().zip(places);
            let rates = rates.filter(|(freed, _)| !freed.nuisance.neutral().is_finite());
            return Some(Self { at: rates.map(|(_, at)| at).collect(), step, unit: 1.0 });
        }
        let is_free = |p: &&CandidateParameter| !p.is_fixed;
        let own = || effect.parameters.iter().filter(is_free);
        let chosen = own().find(|p| p.is_log && !p.is_hidden).or_else(|| own().find(|p| p.is_log));
        let chosen = chosen.or_else(|| own().find(|p| !p.is_hidden))?;
        let place = effect.parameters.iter().position(|p| std::ptr::eq(p, chosen))?;
        let at = hypothesis.offset_of(index) + place;
        let unit = if chosen.is_log { 1.0 } else { hypothesis.values[at] };
        (unit != 0.0).then(|| Self { at: vec![at], step: hypothesis.steps[at], unit })
    }
}

/// An event with its score (including the silence before it) in the strength's logarithm.
struct EventScore {
    residual: Residual,
    slope: f64,
    cell: usize,
}

/// Scores of the events in the effect's region.
fn events(
    evidence: &Evidence,
    two: &[Hypothesis; 2],
    strength: &StrengthParameters,
    region: Option<Rectangle>,
) -> Vec<EventScore> {
    let mixture = strata_of_pixels(evidence, &two[0]);
    let unit = strength.unit / (2.0 * strength.step);
    evidence
        .pixels
        .par_iter()
        .zip(mixture)
        .filter(|(pixel, _)| region.is_none_or(|region| region.contains(pixel.x, pixel.y)))
        .flat_map_iter(|(pixel, stratum)| {
            let place = (pixel.x, pixel.y);
            let [less, more] = two.each_ref().map(|hypothesis| {
                let view = hypothesis.view(evidence, pixel, stratum, Vec::new());
                residuals(&view.law, view.light(), place, &pixel.spikes, &evidence.blocks).0
            });
            let log = |r: &Residual| r.log_hazard - r.compensator;
            let same = less.len() == more.len();
            let all = less.into_iter().zip(more).filter(move |_| same);
            all.filter(|(less, _)| less.previous.is_some()).map(move |(less, more)| {
                let slope =
                    ((log(&more) - log(&less)) * unit).clamp(-MAX_EVENT_SCORE, MAX_EVENT_SCORE);
                let block = evidence.blocks.of(less.t_us as f64);
                EventScore { cell: evidence.cell(pixel, block), residual: less, slope }
            })
        })
        .collect()
}

/// Bound on one event's score, against outliers.
const MAX_EVENT_SCORE: f64 = 30.0;

/// Scores of a stratum.
#[derive(Default)]
struct ScoreSums {
    n: f64,
    slope: f64,
    square: f64,
    fourth: f64,
    by_cell: BTreeMap<usize, (f64, f64)>,
}

impl ScoreSums {
    fn mean(&self) -> f64 {
        self.slope / self.n.max(1.0)
    }

    /// Effective number of events: fewer than there are where few dominate.
    fn n_telling(&self) -> f64 {
        self.square.powi(2) / self.fourth.max(f64::MIN_POSITIVE)
    }

    /// Squared standard error of the mean, from the scatter over cells.
    fn variance(&self) -> f64 {
        let mean = self.mean();
        let square: f64 = self.by_cell.values().map(|(s, n)| (s - mean * n).powi(2)).sum();
        square / self.n.max(1.0).powi(2)
    }
}

fn of_covariate(
    key: &'static str,
    real: (&[EventScore], &[f64]),
    drawn: (&[EventScore], &[f64]),
) -> Vec<StratumStrength> {
    let mut sorted: Vec<f64> = real.1.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let mut edges: Vec<f64> =
        (1..N_STRATA).filter_map(|i| sorted.get(i * sorted.len() / N_STRATA).copied()).collect();
    edges.dedup();
    let sums = |(events, values): (&[EventScore], &[f64])| {
        let mut strata: Vec<ScoreSums> = (0..=edges.len()).map(|_| ScoreSums::default()).collect();
        for (event, &value) in events.iter().zip(values).filter(|(_, v)| v.is_finite()) {
            let sums = &mut strata[edges.partition_point(|edge| *edge <= value)];
            sums.n += 1.0;
            sums.slope += event.slope;
            sums.square += event.slope.powi(2);
            sums.fourth += event.slope.powi(4);
            let cell = sums.by_cell.entry(event.cell).or_default();
            cell.0 += event.slope;
            cell.1 += 1.0;
        }
        strata
    };
    let overall = |events: &[EventScore]| {
        events.iter().map(|e| e.slope).sum::<f64>() / events.len().max(1) as f64
    };
    // The total score is not zero where the fit used other cells, or stopped early.
    let whole = overall(real.0) - overall(drawn.0);
    let ends = |s: usize| {
        let at = |i: usize| edges.get(i).copied();
        let [low, high] = [sorted.first(), sorted.last()].map(|v| v.copied().unwrap_or_default());
        [s.checked_sub(1).and_then(at).unwrap_or(low), at(s).unwrap_or(high)]
    };
    let drawn = sums(drawn);
    let all_square: f64 = drawn.iter().map(|sums| sums.square).sum();
    let strata = sums(real).into_iter().zip(drawn).enumerate();
    strata
        .filter(|(_, (_, drawn))| drawn.square >= MIN_INFORMATION_SHARE * all_square)
        .filter(|(_, (real, drawn))| real.n.min(drawn.n) >= MIN_EVENTS_PER_STRATUM as f64)
        .filter_map(|(s, (real, drawn))| {
            let known = drawn.square / drawn.n;
            (known > 0.0 && drawn.n_telling() >= MIN_EFFECTIVE_EVENTS).then(|| StratumStrength {
                covariate: key,
                range: ends(s),
                change: (real.mean() - drawn.mean() - whole) / known,
                error: (real.variance() + drawn.variance()).sqrt() / known,
            })
        })
        .collect()
}
