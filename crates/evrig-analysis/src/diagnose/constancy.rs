//! An effect has one strength. Is it the same wherever it acts?
//!
//! At the optimum the log-likelihood's slope in a strength is nothing over all events. If the
//! effect's law is right, the events of any stratum (of one brightness, one contrast rate, behind
//! one interval, with neighbours that fired or did not) have the slope that those drawn from the
//! model have there (fluctuation tests, Zeileis and Hornik, Stat. Neerl. 61, 2007). Where they have
//! not, the difference over the slope's mean square says by what share that stratum alone would
//! change the strength. An effect that stands for another one shows strengths that differ by
//! factors; one that is right does not, however many events there are.

use super::candidate::{Candidate, Parameter};
use super::fit::Fitted;
use super::kinds::kinds_of_pixels;
use super::{Evidence, Hypothesis};
use crate::predict::{Residual, residuals};
use evrig_core::geometry::Rectangle;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Strata of a covariate.
const STRATA: usize = 5;

/// Least events in a stratum.
const LEAST: usize = 150;

/// Least events of a stratum, drawn from the model, that the strength is told by. Where an effect has hardly
/// a part in what happens, that none of its few events came means nothing.
const LEAST_TELLING: f64 = 25.0;

/// Share of what all events tell of the strength that a stratum has to hold. What hardly depends on the
/// effect shows the light's own error as a great change of it: a leak does next to nothing within a
/// millisecond.
const LEAST_SHARE: f64 = 0.02;

/// The strength that a stratum alone would have.
#[derive(Debug, Clone)]
pub(super) struct Stratum {
    pub(super) covariate: &'static str,
    pub(super) range: [f64; 2],
    /// By what share it would differ from the whole's; -1: the effect is not there.
    pub(super) change: f64,
    /// Standard error of that.
    pub(super) error: f64,
}

/// What is asked about an event.
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

/// The answers, in the order of [`COVARIATES`].
fn covariates(evidence: &Evidence, r: &Residual) -> [f64; COVARIATES.len()] {
    let (near_us, n_near) = evidence.around.neighbours(r.x, r.y, r.t_us, 5_000);
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
        evidence.around.since_frame_us(r.t_us),
    ]
}

/// The strengths of an effect of the model, stratum by stratum, against `drawn`, the same pixels
/// with events drawn from the model. Empty for an effect without a strength to speak of.
pub(super) fn strengths(
    evidence: &Evidence,
    drawn: &Evidence,
    model: &Fitted,
    index: usize,
) -> Vec<Stratum> {
    let hypothesis = &model.hypothesis;
    let Some(strength) = Strength::of(hypothesis, index) else { return Vec::new() };
    let moved = |sign: f64| {
        let mut other = hypothesis.clone();
        strength.at.iter().for_each(|at| other.values[*at] += sign * strength.step);
        other
    };
    let two = [moved(-1.0), moved(1.0)];
    let region = hypothesis.regions[index];
    let [real, drawn] = [evidence, drawn].map(|evidence| events(evidence, &two, &strength, region));
    let asked = |events: &[Told]| -> Vec<[f64; COVARIATES.len()]> {
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

/// Which values are a strength, and how it is counted.
struct Strength {
    at: Vec<usize>,
    step: f64,
    /// What a change of the value is divided by to be one of the strength's logarithm.
    unit: f64,
}

impl Strength {
    fn of(hypothesis: &Hypothesis, index: usize) -> Option<Self> {
        let effect: &Candidate = hypothesis.effects[index];
        if let Some(freed) = effect.frees.first() {
            let places = hypothesis.places_of(index);
            let first = *places.first()?;
            let (from, step) = (freed.nuisance.neutral(), hypothesis.steps[first]);
            if from.is_finite() {
                let unit = hypothesis.values[first] - from;
                return (unit != 0.0).then(|| Self { at: vec![first], step, unit });
            }
            // A rate of On events and one of Off events are as many times as much together.
            let rates = effect.frees.iter().zip(places);
            let rates = rates.filter(|(freed, _)| !freed.nuisance.neutral().is_finite());
            return Some(Self { at: rates.map(|(_, at)| at).collect(), step, unit: 1.0 });
        }
        let is_free = |p: &&Parameter| !p.is_fixed;
        let own = || effect.parameters.iter().filter(is_free);
        let chosen = own().find(|p| p.is_log && !p.is_hidden).or_else(|| own().find(|p| p.is_log));
        let chosen = chosen.or_else(|| own().find(|p| !p.is_hidden))?;
        let place = effect.parameters.iter().position(|p| std::ptr::eq(p, chosen))?;
        let at = hypothesis.offset_of(index) + place;
        let unit = if chosen.is_log { 1.0 } else { hypothesis.values[at] };
        (unit != 0.0).then(|| Self { at: vec![at], step: hypothesis.steps[at], unit })
    }
}

/// An event with the slope of its log-likelihood and that of the silence before it, in the
/// strength's logarithm.
struct Told {
    residual: Residual,
    slope: f64,
    cell: usize,
}

/// Those of the pixels in the effect's region.
fn events(
    evidence: &Evidence,
    two: &[Hypothesis; 2],
    strength: &Strength,
    region: Option<Rectangle>,
) -> Vec<Told> {
    let kinds = kinds_of_pixels(evidence, &two[0]);
    let unit = strength.unit / (2.0 * strength.step);
    evidence
        .pixels
        .par_iter()
        .zip(kinds)
        .filter(|(pixel, _)| region.is_none_or(|region| region.contains(pixel.x, pixel.y)))
        .flat_map_iter(|(pixel, kind)| {
            let place = (pixel.x, pixel.y);
            let [less, more] = two.each_ref().map(|hypothesis| {
                let view = hypothesis.view(evidence, pixel, kind, Vec::new());
                residuals(&view.law, view.light(), place, &pixel.spikes, &evidence.blocks).0
            });
            let log = |r: &Residual| r.log_hazard - r.compensator;
            let same = less.len() == more.len();
            let all = less.into_iter().zip(more).filter(move |_| same);
            all.filter(|(less, _)| less.previous.is_some()).map(move |(less, more)| {
                // One event alone may say so much and no more: outliers are not what differs.
                let slope = ((log(&more) - log(&less)) * unit).clamp(-FARTHEST, FARTHEST);
                let block = evidence.blocks.of(less.t_us as f64);
                Told { cell: evidence.cell(pixel, block), residual: less, slope }
            })
        })
        .collect()
}

/// Bound on what one event says of a strength's logarithm.
const FARTHEST: f64 = 30.0;

/// Slopes of a stratum's events.
#[derive(Default)]
struct Sums {
    n: f64,
    slope: f64,
    square: f64,
    fourth: f64,
    by_cell: BTreeMap<usize, (f64, f64)>,
}

impl Sums {
    fn mean(&self) -> f64 {
        self.slope / self.n.max(1.0)
    }

    /// By how many events the slope is told: fewer than there are where a few say most.
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
    real: (&[Told], &[f64]),
    drawn: (&[Told], &[f64]),
) -> Vec<Stratum> {
    let mut sorted: Vec<f64> = real.1.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let mut edges: Vec<f64> =
        (1..STRATA).filter_map(|i| sorted.get(i * sorted.len() / STRATA).copied()).collect();
    edges.dedup();
    let sums = |(events, values): (&[Told], &[f64])| {
        let mut strata: Vec<Sums> = (0..=edges.len()).map(|_| Sums::default()).collect();
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
    let overall =
        |events: &[Told]| events.iter().map(|e| e.slope).sum::<f64>() / events.len().max(1) as f64;
    // The whole's slope is not nothing where the fit saw other cells, or stopped early.
    let whole = overall(real.0) - overall(drawn.0);
    let ends = |s: usize| {
        let at = |i: usize| edges.get(i).copied();
        let [low, high] = [sorted.first(), sorted.last()].map(|v| v.copied().unwrap_or_default());
        [s.checked_sub(1).and_then(at).unwrap_or(low), at(s).unwrap_or(high)]
    };
    let drawn = sums(drawn);
    let told: f64 = drawn.iter().map(|sums| sums.square).sum();
    let strata = sums(real).into_iter().zip(drawn).enumerate();
    strata
        .filter(|(_, (_, drawn))| drawn.square >= LEAST_SHARE * told)
        .filter(|(_, (real, drawn))| real.n.min(drawn.n) >= LEAST as f64)
        .filter_map(|(s, (real, drawn))| {
            let known = drawn.square / drawn.n;
            (known > 0.0 && drawn.n_telling() >= LEAST_TELLING).then(|| Stratum {
                covariate: key,
                range: ends(s),
                change: (real.mean() - drawn.mean() - whole) / known,
                error: (real.variance() + drawn.variance()).sqrt() / known,
            })
        })
        .collect()
}
