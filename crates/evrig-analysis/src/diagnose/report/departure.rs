//! Departures of the frames from what the session states.
//!
//! The scene fits lenses, rows and path to the frames, so that the signal includes such departures
//! and the events show none. They are effects all the same. Their gain is measured against the
//! signal as stated.

use crate::diagnose::fit::cell_scores::CellSet;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::fit::local_refinement::fit_and_refine;
use crate::diagnose::{ConfidenceInterval, Evidence, FittedEffect, Hypothesis, LIBRARY};
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::effect_id::EffectId;
use evrig_core::stats::Z90;
use rayon::prelude::*;
use statrs::function::erf::erfc;
use std::collections::BTreeMap;

const MAX_STEPS: usize = 12;

/// A departure of the frames from what the session states.
#[derive(Debug, Clone)]
pub struct Departure {
    /// The effect.
    pub id: EffectId,
    /// Parameters by key, each with its standard error.
    pub parameters: Vec<(&'static str, [f64; 2])>,
    /// The finding in a sentence.
    pub description: String,
    /// Distance from the statement, standard errors.
    pub z: f64,
    /// The evidence with a signal without this departure and those after it in the list; `None`
    /// where the signal does not depend on it.
    pub without: Option<Evidence>,
}

impl Evidence {
    /// The same events with another signal.
    #[must_use]
    pub fn with_light_of(&self, drive: &dyn Drive) -> Self {
        let mut other = self.clone();
        let n = self.pixels.first().map_or(0, |pixel| pixel.light.len());
        let start_us = self.window_us[0] + self.start_us as i64;
        let grid = TimeGrid { start_us, step_us: self.step_us as u32, n };
        other.pixels.par_iter_mut().for_each(|pixel| {
            let place = [f64::from(pixel.x) + 0.5, f64::from(pixel.y) + 0.5];
            let mut light = vec![f32::NAN; n];
            drive.sample(place, grid, &mut light);
            let known =
                pixel.light_mut().iter_mut().zip(light).filter(|(here, _)| here.is_finite());
            known.for_each(|(here, there)| *here = there);
        });
        other
    }
}

/// Departures as effects, and the fit to the signal as stated, if that differs. Scored on the
/// pixels of `evidence`, which may lack hot pixels.
pub(crate) fn as_effects<'a>(
    evidence: &Evidence,
    departures: impl Iterator<Item = &'a Departure>,
    baseline: &FittedModel,
) -> (Vec<FittedEffect>, Option<FittedModel>) {
    let departures: Vec<&Departure> = departures.collect();
    let refitted = |without: &Evidence| {
        let mut without = without.clone();
        let is_left = |x, y| evidence.pixels.iter().any(|pixel| (pixel.x, pixel.y) == (x, y));
        without.pixels.retain(|pixel| is_left(pixel.x, pixel.y));
        refitted(&without, baseline)
    };
    let mut lights: Vec<Option<FittedModel>> =
        departures.iter().map(|departure| departure.without.as_ref().map(refitted)).collect();
    let effects = (0..departures.len())
        .map(|i| {
            let with = lights[i + 1..].iter().flatten().next().unwrap_or(baseline);
            let gained = lights[i].as_ref().map(|w| with.cells.gain(&w.cells, CellSet::HeldOut));
            effect_of(departures[i], gained.unwrap_or_default())
        })
        .collect();
    let first = lights.iter_mut().find_map(Option::take);
    (effects, first)
}

/// Upper tail probability of a standard normal variable.
pub(crate) fn upper_tail_probability(z: f64) -> f64 {
    0.5 * erfc(z / std::f64::consts::SQRT_2)
}

fn refitted(evidence: &Evidence, baseline: &FittedModel) -> FittedModel {
    let start = Hypothesis::baseline(evidence).at_values_of(&baseline.hypothesis);
    fit_and_refine(evidence, start, MAX_STEPS)
}

pub(crate) fn effect_of(departure: &Departure, (gain, error): (f64, f64)) -> FittedEffect {
    let interval = |&(key, [value, error]): &(&'static str, [f64; 2])| {
        let ci90 = [Some(value - Z90 * error), Some(value + Z90 * error)];
        (key.to_owned(), ConfidenceInterval { value, ci90 })
    };
    let equation = LIBRARY.iter().find(|c| c.id == departure.id).map_or("", |c| c.equation);
    FittedEffect {
        id: departure.id,
        name: departure.id.name().into(),
        equation: equation.into(),
        description: departure.description.clone(),
        parameters: departure.parameters.iter().map(interval).collect::<BTreeMap<_, _>>(),
        heldout_gain_nats_per_event: gain,
        heldout_gain_error: error,
        p_value: upper_tail_probability(departure.z),
        region: None,
        indistinguishable: Vec::new(),
        competing_hypotheses: Vec::new(),
    }
}
