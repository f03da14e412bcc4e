//! A model of the recording: nuisances and effects with their values, and its prediction for a
//! pixel.

use super::image_pose::ImagePose;
use super::library::{CandidateEffect, CandidateParameter, CandidateStage, FreedNuisance};
use super::nuisance::{N_NUISANCES, Nuisance};
use super::predicted_pixel::PredictedPixel;
use super::score_grid::{HeldGrid, PinnedStrata};
use crate::diagnose::{Evidence, PixelEvidence, PixelStratum};
use crate::predict::PixelLaw;
use evrig_core::geometry::Rectangle;

/// Nuisances and effects with their values.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// Effects beyond the baseline, in the order of acceptance.
    pub effects: Vec<&'static CandidateEffect>,
    /// The region of each effect; the whole sensor without one.
    pub regions: Vec<Option<Rectangle>>,
    /// The nuisances' values, then those of each effect, in fitted coordinates.
    pub values: Vec<f64>,
    /// Range of each value.
    pub ranges: Vec<[f64; 2]>,
    /// Finite-difference step of each value.
    pub steps: Vec<f64>,
    /// Whether pixels' own thresholds are scored as finely as their events resolve them. The
    /// search uses the coarse grid, whose score is smooth.
    pub uses_fine_grid: bool,
    /// Another hypothesis whose grid of pixel values is used.
    pub(crate) shared_grid: Option<HeldGrid>,
    /// Pixel strata that are taken as known.
    pub(crate) pinned_strata: Option<PinnedStrata>,
}

impl Hypothesis {
    /// Nuisances alone, at their prior values.
    #[must_use]
    pub fn baseline(evidence: &Evidence) -> Self {
        let prior = Nuisance::ALL.map(|nuisance| nuisance.prior(&evidence.facts));
        Self {
            effects: Vec::new(),
            regions: Vec::new(),
            values: prior.iter().map(|o| o.start).collect(),
            ranges: prior.iter().map(|o| o.range).collect(),
            steps: prior.iter().map(|o| o.step).collect(),
            uses_fine_grid: false,
            shared_grid: None,
            pinned_strata: None,
        }
    }

    /// Adds an effect, its parameters at `start` in fitted coordinates. An effect that is a
    /// nuisance beyond its prior range frees the nuisance instead.
    #[must_use]
    pub fn with(&self, effect: &'static CandidateEffect, start: &[f64]) -> Self {
        let mut other = self.clone();
        for (freed, value) in effect.freed.iter().zip(start) {
            let index = freed.nuisance as usize;
            other.ranges[index] = freed.range;
            other.values[index] = *value;
        }
        if effect.freed.is_empty() {
            for (parameter, value) in effect.parameters.iter().zip(start) {
                other.values.push(*value);
                other.ranges.push(parameter.fitted_range());
                other.steps.push(if parameter.is_fixed { 0.0 } else { parameter.fitted_step() });
            }
        }
        other.effects.push(effect);
        other.regions.push(None);
        other
    }

    /// Adds an effect, limited to a region if there is one. A freed nuisance keeps its prior
    /// outside the region and has its own value inside.
    #[must_use]
    pub(crate) fn with_effect_in(
        &self,
        effect: &'static CandidateEffect,
        start: &[f64],
        region: Option<Rectangle>,
    ) -> Self {
        let mut other = self.with(effect, start);
        if region.is_some() && !effect.freed.is_empty() {
            other.values = self.values.iter().chain(start).copied().collect();
            other.ranges.clone_from(&self.ranges);
            for freed in effect.freed {
                other.ranges.push(freed.range);
                other.steps.push(self.steps[freed.nuisance as usize]);
            }
        }
        if let Some(last) = other.regions.last_mut() {
            *last = region;
        }
        other
    }

    /// An effect's parameters and derived ones, by key.
    #[must_use]
    pub(crate) fn named_parameters(
        &self,
        evidence: &Evidence,
        index: usize,
    ) -> Vec<(&'static str, f64)> {
        let (effect, values) = (self.effects[index], self.parameters_of(index));
        if effect.freed.is_empty() {
            effect.named_parameters(evidence, &values)
        } else {
            effect.id.parameters().iter().copied().zip(values).collect()
        }
    }

    /// Fitted values of an effect's parameters, or of the nuisances that it frees.
    #[must_use]
    pub(crate) fn fitted_values(&self, index: usize) -> Vec<f64> {
        self.value_indices(index).into_iter().map(|at| self.values[at]).collect()
    }

    /// Indices of these values.
    #[must_use]
    pub(crate) fn value_indices(&self, index: usize) -> Vec<usize> {
        match self.n_own(index) {
            0 => self.effects[index].freed.iter().map(|freed| freed.nuisance as usize).collect(),
            n => (self.offset_of(index)..).take(n).collect(),
        }
    }

    /// Number of values of its own.
    fn n_own(&self, index: usize) -> usize {
        let effect = self.effects[index];
        match effect.freed.len() {
            0 => effect.parameters.len(),
            n if self.regions[index].is_some() => n,
            _ => 0,
        }
    }

    /// Nuisances where an effect acts, from a hypothesis's values.
    #[must_use]
    pub(crate) fn nuisances_with(&self, index: usize, values: &[f64]) -> Vec<f64> {
        let mut there = values[..N_NUISANCES].to_vec();
        for (freed, at) in self.effects[index].freed.iter().zip(self.value_indices(index)) {
            there[freed.nuisance as usize] = values[at];
        }
        there
    }

    fn nuisances_at(&self, x: u16, y: u16) -> Vec<f64> {
        let mut there = self.values[..N_NUISANCES].to_vec();
        for (index, effect) in self.effects.iter().enumerate() {
            if self.regions[index].is_some_and(|region| region.contains(x, y)) {
                for (freed, at) in effect.freed.iter().zip(self.value_indices(index)) {
                    there[freed.nuisance as usize] = self.values[at];
                }
            }
        }
        there
    }

    /// With a nuisance at a value, within its range.
    pub(crate) fn with_nuisance(&self, nuisance: Nuisance, value: f64) -> Self {
        let mut other = self.clone();
        let [low, high] = other.ranges[nuisance as usize];
        other.values[nuisance as usize] = value.clamp(low, high);
        other
    }

    /// With a parameter multiplied by a factor, within its range.
    #[must_use]
    pub(crate) fn scaled(&self, at: usize, parameter: &CandidateParameter, times: f64) -> Self {
        let mut other = self.clone();
        let [low, high] = other.ranges[at];
        let there = times * parameter.from_fitted(other.values[at]);
        other.values[at] = parameter.to_fitted(there).clamp(low, high);
        other
    }

    /// With the values of a longer hypothesis made from this one, within the ranges here.
    #[must_use]
    pub(crate) fn at_values_of(&self, longer: &Self) -> Self {
        let mut other = self.clone();
        let own = other.values.iter_mut().zip(&self.ranges).zip(&longer.values);
        own.for_each(|((value, [low, high]), there)| *value = there.clamp(*low, *high));
        other
    }

    /// Whether a value lies at a bound, within this share of its range.
    #[must_use]
    pub(crate) fn is_at_end(&self, at: usize, share: f64) -> bool {
        let ([low, high], value) = (self.ranges[at], self.values[at]);
        (value - low).min(high - value) <= share * (high - low)
    }

    /// A nuisance's value in its fitted coordinate.
    #[must_use]
    pub fn nuisance(&self, nuisance: Nuisance) -> f64 {
        self.values[nuisance as usize]
    }

    /// Index of the first value of an effect.
    #[must_use]
    pub fn offset_of(&self, index: usize) -> usize {
        N_NUISANCES + (0..index).map(|before| self.n_own(before)).sum::<usize>()
    }

    /// An effect's parameters in reported units.
    #[must_use]
    pub fn parameters_of(&self, index: usize) -> Vec<f64> {
        let effect = self.effects[index];
        if effect.freed.is_empty() {
            let at = self.offset_of(index);
            let own = effect.parameters.iter().zip(&self.values[at..]);
            own.map(|(parameter, value)| parameter.from_fitted(*value)).collect()
        } else {
            (effect.report_freed)(&self.nuisances_with(index, &self.values))
        }
    }

    /// The law of the pixels from the nuisances, outside any region.
    #[must_use]
    pub fn law(&self) -> PixelLaw {
        law(&self.values)
    }

    /// Applies the model to a pixel of a stratum. `signal` is reused memory.
    #[must_use]
    pub fn view<'a>(
        &self,
        evidence: &'a Evidence,
        pixel: &'a PixelEvidence,
        stratum: PixelStratum,
        mut signal: Vec<f32>,
    ) -> PredictedPixel<'a> {
        signal.clear();
        signal.extend_from_slice(&pixel.light);
        let mut view = self.bare(evidence, pixel, signal);
        let nuisances = self.nuisances_at(pixel.x, pixel.y);
        view.blur(nuisances[Nuisance::BlurPx2 as usize]);
        view.displace(ImagePose::of(&nuisances));
        self.apply(&mut view, stratum, &CandidateStage::ALL);
        view
    }

    /// The same where `signal` is that of a hypothesis with the same signal.
    pub(crate) fn view_with<'a>(
        &self,
        evidence: &'a Evidence,
        pixel: &'a PixelEvidence,
        stratum: PixelStratum,
        signal: Vec<f32>,
    ) -> PredictedPixel<'a> {
        let mut view = self.bare(evidence, pixel, signal);
        self.apply(&mut view, stratum, &CandidateStage::AFTER_SIGNAL);
        view
    }

    /// Whether a pixel's signal is the unchanged light.
    pub(crate) fn leaves_light_unchanged(&self, pixel: &PixelEvidence) -> bool {
        let is_behind =
            |effect: &&CandidateEffect| CandidateStage::AFTER_SIGNAL.contains(&effect.stage);
        self.effects.iter().all(is_behind) && {
            let nuisances = self.nuisances_at(pixel.x, pixel.y);
            nuisances[Nuisance::BlurPx2 as usize] == 0.0
                && ImagePose::of(&nuisances) == ImagePose::default()
        }
    }

    /// Whether another hypothesis has the same signal in every pixel; laws and clocks may differ.
    pub(crate) fn has_same_signal(&self, other: &Self) -> bool {
        let is_same_set = self.effects.len() == other.effects.len()
            && self.regions == other.regions
            && self.effects.iter().zip(&other.effects).all(|(a, b)| std::ptr::eq(*a, *b));
        if !is_same_set {
            return false;
        }
        let same = |i: usize| self.values[i] == other.values[i];
        let affects_signal = |nuisance: &Nuisance| {
            *nuisance == Nuisance::BlurPx2 || ImagePose::NUISANCES.contains(nuisance)
        };
        let mut seeing = Nuisance::ALL.into_iter().filter(affects_signal);
        if !seeing.all(|n| same(n as usize)) {
            return false;
        }
        // A drift is measured in thresholds.
        let drifts = self.effects.iter().any(|effect| effect.stage == CandidateStage::Drift);
        if drifts && !(same(Nuisance::LogTheta as usize) && same(Nuisance::LogRatio as usize)) {
            return false;
        }
        self.effects.iter().enumerate().all(|(index, effect)| {
            let frees_it = |freed: &FreedNuisance| affects_signal(&freed.nuisance);
            let is_behind = CandidateStage::AFTER_SIGNAL.contains(&effect.stage);
            let is_behind = is_behind && !drifts && !effect.freed.iter().any(frees_it);
            is_behind || self.value_indices(index).into_iter().all(same)
        })
    }

    fn bare<'a>(
        &self,
        evidence: &'a Evidence,
        pixel: &'a PixelEvidence,
        signal: Vec<f32>,
    ) -> PredictedPixel<'a> {
        let own = [evidence.start_us, evidence.step_us];
        let stated = evidence.facts.clock_tie.map(|tied| tied.as_stated(own, evidence.seconds()));
        let [start_us, step_us] = stated.unwrap_or(own);
        let nuisances = self.nuisances_at(pixel.x, pixel.y);
        PredictedPixel {
            evidence,
            pixel,
            // Stamps that were spread over a grid step have a uniform error.
            law: PixelLaw {
                jitter_s: evidence.facts.stamp_step_us.unwrap_or(0.0) * 1e-6 / 12.0_f64.sqrt(),
                ..law(&nuisances)
            },
            signal,
            start_us: start_us + nuisances[Nuisance::OffsetUs as usize],
            step_us,
        }
    }

    fn apply(
        &self,
        view: &mut PredictedPixel<'_>,
        stratum: PixelStratum,
        stages: &[CandidateStage],
    ) {
        for stage in stages {
            for (index, effect) in self.effects.iter().enumerate() {
                let place = (view.pixel.x, view.pixel.y);
                let is_here = self.regions[index].is_none_or(|r| r.contains(place.0, place.1));
                if is_here && effect.stage == *stage && effect.freed.is_empty() {
                    (effect.apply)(&self.parameters_of(index), stratum, view);
                }
            }
        }
    }
}

/// A pixel law from the nuisances' values.
fn law(values: &[f64]) -> PixelLaw {
    let value = |nuisance: Nuisance| values[nuisance as usize];
    let (theta, half) = (value(Nuisance::LogTheta).exp(), (0.5 * value(Nuisance::LogRatio)).exp());
    let noise = theta * value(Nuisance::LogNoise).exp();
    PixelLaw {
        theta_on: theta * half,
        theta_off: theta / half,
        // In ON thresholds: the leak causes ON events.
        leak_per_s: theta * half * value(Nuisance::LeakHz),
        noise_at_white: noise,
        noise_exponent: value(Nuisance::NoiseExponent),
        noise_at_rest: value(Nuisance::LogNoiseAtRest).exp(),
        noise_speed_per_s: noise * value(Nuisance::LogNoiseHz).exp(),
        shot_at_white: 0.0,
        shot_speed_per_s: 0.0,
        background_on_hz: value(Nuisance::LogBackgroundOn).exp(),
        background_off_hz: value(Nuisance::LogBackgroundOff).exp(),
        background_reset: value(Nuisance::BackgroundResetsReference),
        noise_carry: value(Nuisance::NoiseInReference),
        refractory_s: 0.0,
        filter_refractory_s: 0.0,
        drop_fraction: 0.0,
        jitter_s: 0.0,
        corrects_stamps: false,
    }
}
