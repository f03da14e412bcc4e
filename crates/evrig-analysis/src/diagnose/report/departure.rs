//! Departures of the frames from what the session states.
//!
//! The scene fits lenses, rows and path to the frames, so that the signal includes such departures
//! and the events show none. They are effects all the same. Their gain is measured against the
//! signal as stated.

use crate::diagnose::effect::library_effect;
use crate::diagnose::fit::optimizer::{FitTolerance, ModelFit, fit};
use crate::diagnose::fit::paired_gain::PairedGain;
use crate::diagnose::{ConfidenceInterval, Evidence, FittedEffect};
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::effect_id::EffectId;
use rayon::prelude::*;
use statrs::function::erf::erfc;
use std::collections::BTreeMap;

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

/// The camera fitted to the signal as stated, and the held-out gain of each departure with its
/// standard error; zero where the signal does not depend on it.
pub(crate) fn gains(
    evidence: &Evidence,
    departures: &[Departure],
    baseline: &ModelFit,
) -> (Option<ModelFit>, Vec<PairedGain>) {
    let refitted = |departure: &Departure| {
        let mut without = departure.without.clone()?;
        // Hot pixels are left out.
        let is_left = |x, y| evidence.pixels.iter().any(|pixel| (pixel.x, pixel.y) == (x, y));
        without.pixels.retain(|pixel| is_left(pixel.x, pixel.y));
        Some(fit(&without, baseline.model.clone(), N_REFIT_STEPS, FitTolerance::Coarse))
    };
    let mut fits: Vec<Option<ModelFit>> = departures.iter().map(refitted).collect();
    let gain = |i: usize| {
        let with = fits[i + 1..].iter().flatten().next().unwrap_or(baseline);
        let gained = fits[i]
            .as_ref()
            .map(|without| PairedGain::of(evidence, &with.evaluation, &without.evaluation));
        gained.unwrap_or_default()
    };
    let gains = (0..fits.len()).map(gain).collect();
    (fits.iter_mut().find_map(Option::take), gains)
}

/// Optimizer steps to another signal.
const N_REFIT_STEPS: usize = 6;

/// Upper tail probability of a standard normal variable.
pub(crate) fn upper_tail_probability(z: f64) -> f64 {
    0.5 * erfc(z / std::f64::consts::SQRT_2)
}

pub(crate) fn effect_of(departure: &Departure, gain: PairedGain) -> FittedEffect {
    let interval = |&(key, estimate): &(&'static str, [f64; 2])| {
        (key.to_owned(), ConfidenceInterval::normal(estimate))
    };
    let equation = library_effect(departure.id).map_or("", |effect| effect.equation);
    FittedEffect {
        id: departure.id,
        name: departure.id.name().into(),
        equation: equation.into(),
        description: departure.description.clone(),
        parameters: departure.parameters.iter().map(interval).collect::<BTreeMap<_, _>>(),
        heldout_gain_nats_per_event: gain.mean,
        heldout_gain_error: gain.error,
        p_value: upper_tail_probability(departure.z),
        indistinguishable: Vec::new(),
        competing_hypotheses: Vec::new(),
    }
}
