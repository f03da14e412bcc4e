//! A model: constants, effects, thresholds of the pixels; and its scores.

use crate::diagnose::effect::ModelTerm;
use crate::diagnose::model::constants::{CameraConstant, ConstantPrior, N_CONSTANTS};
use crate::diagnose::model::terms::{PixelTerms, score_view};
use crate::diagnose::model::view::ModelledPixel;
use crate::diagnose::{Evidence, ImagePose};
use crate::predict::law::{ComparatorLaw, logistic};
use evrig_core::effect_id::EffectId;
use std::sync::Arc;

#[derive(Debug, Clone)]
pub(crate) struct CameraModel {
    pub(crate) values: Vec<f64>,
    pub(crate) effects: Vec<&'static ModelTerm>,
    /// Constants held inside their ordinary ranges.
    limits: Vec<(CameraConstant, [f64; 2])>,
    /// Largest spread of the thresholds.
    pub(crate) max_spread: f64,
    /// Log threshold of each pixel relative to the mean, ON and OFF.
    pub(crate) spread: Arc<Vec<[f64; 2]>>,
    /// Its standard deviation.
    pub(crate) spread_sd: f64,
}

/// One fitted coordinate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FitCoordinate {
    pub(crate) mean: f64,
    pub(crate) sd: f64,
    pub(crate) range: [f64; 2],
    pub(crate) step: f64,
    pub(crate) changes_signal: bool,
}

impl CameraModel {
    pub(crate) fn baseline(evidence: &Evidence) -> Self {
        let values = CameraConstant::ALL.map(|c| {
            let ConstantPrior { mean, ordinary: [lo, hi], .. } = c.prior(&evidence.facts);
            mean.clamp(lo, hi)
        });
        let limits = CameraConstant::ALL.map(|c| (c, c.prior(&evidence.facts).ordinary));
        Self {
            values: values.to_vec(),
            effects: Vec::new(),
            limits: limits.to_vec(),
            max_spread: f64::INFINITY,
            spread: Arc::new(vec![[0.0; 2]; evidence.pixels.len()]),
            spread_sd: 0.0,
        }
    }

    /// Whether a constant is held inside its ordinary range.
    pub(crate) fn is_limited(&self, constant: CameraConstant) -> bool {
        self.limits.iter().any(|(limited, _)| *limited == constant)
    }

    /// Lets constants leave their ordinary ranges.
    pub(crate) fn free(&mut self, group: &[CameraConstant]) {
        self.limits.retain(|(limited, _)| !group.contains(limited));
    }

    /// Holds constants inside their ordinary ranges.
    pub(crate) fn limit(&mut self, evidence: &Evidence, group: &[CameraConstant]) {
        self.free(group);
        self.limits.extend(group.iter().map(|c| (*c, c.prior(&evidence.facts).ordinary)));
    }

    /// Removes an effect.
    pub(crate) fn remove_effect(&mut self, id: EffectId) {
        let Some(index) = self.effects.iter().position(|effect| effect.id == id) else { return };
        let at = self.offset_of(index);
        self.values.drain(at..at + self.effects[index].parameters.len());
        self.effects.remove(index);
    }

    /// The same camera with equal thresholds in all pixels of some evidence.
    pub(crate) fn for_pixels(mut self, evidence: &Evidence) -> Self {
        self.spread = Arc::new(vec![[0.0; 2]; evidence.pixels.len()]);
        self.spread_sd = 0.0;
        self
    }

    /// The effects and freed constants of this model with the other constants of another one.
    pub(crate) fn with_constants_of(&self, other: &Self) -> Self {
        let mut model = self.clone();
        for (constant, _) in &self.limits {
            model.values[*constant as usize] = other.constant(*constant);
        }
        model
    }

    /// The same camera for every `n`-th pixel.
    pub(crate) fn thinned(&self, n: usize) -> Self {
        let spread = self.spread.iter().step_by(n).copied().collect();
        Self { spread: Arc::new(spread), ..self.clone() }
    }

    /// Fitted constants at an end of the range in which they are held.
    pub(crate) fn at_range_end(&self, evidence: &Evidence) -> Vec<CameraConstant> {
        let coordinates = self.coordinates(evidence);
        let is_held = |c: &CameraConstant| {
            let FitCoordinate { sd, range: [low, high], .. } = coordinates[*c as usize];
            let value = self.constant(*c);
            sd > 0.0 && (value <= low || value >= high)
        };
        CameraConstant::ALL.iter().copied().filter(is_held).collect()
    }

    /// Holds a constant at a value.
    pub(crate) fn pin(&mut self, constant: CameraConstant, value: f64) {
        self.free(&[constant]);
        self.limits.push((constant, [value; 2]));
        self.values[constant as usize] = value;
    }

    /// This camera with an effect or freed constants that were fitted to another one: the values
    /// `own` as fitted, the others with the change that the fit made.
    pub(crate) fn moved_as(&self, from: &Self, fitted: Self, own: &[usize]) -> Self {
        let mut values = fitted.values;
        for (at, value) in values.iter_mut().enumerate().take(self.values.len()) {
            if !own.contains(&at) {
                *value += self.values[at] - from.values[at];
            }
        }
        let mut limits = self.limits.clone();
        limits.retain(|limited| fitted.limits.iter().any(|other| other.0 == limited.0));
        Self { values, limits, effects: fitted.effects, ..self.clone() }
    }

    /// Coordinates that are fitted.
    pub(crate) fn active(coordinates: &[FitCoordinate]) -> Vec<usize> {
        (0..coordinates.len()).filter(|at| coordinates[*at].sd > 0.0).collect()
    }

    /// Limits the spread of the thresholds.
    pub(crate) fn limit_spread(&mut self, sd: f64) {
        self.max_spread = sd;
        if self.spread_sd > sd {
            let share = sd / self.spread_sd;
            let scaled = self.spread.iter().map(|own| own.map(|v| share * v)).collect();
            self.spread = Arc::new(scaled);
            self.spread_sd = sd;
        }
    }

    /// A constant's fitted coordinate.
    pub(crate) fn constant(&self, c: CameraConstant) -> f64 {
        self.values[c as usize]
    }

    pub(crate) fn with(&self, effect: &'static ModelTerm, start: &[f64]) -> Self {
        let mut other = self.clone();
        other.effects.push(effect);
        for (p, v) in effect.parameters.iter().zip(start) {
            other.values.push(if p.is_log { v.ln() } else { *v });
        }
        other
    }

    pub(crate) fn offset_of(&self, index: usize) -> usize {
        N_CONSTANTS + self.effects[..index].iter().map(|e| e.parameters.len()).sum::<usize>()
    }

    pub(crate) fn natural(&self, index: usize) -> Vec<f64> {
        let at = self.offset_of(index);
        let effect = self.effects[index];
        effect.parameters.iter().zip(&self.values[at..]).map(|(p, v)| p.natural(*v)).collect()
    }

    pub(crate) fn coordinates(&self, evidence: &Evidence) -> Vec<FitCoordinate> {
        let mut out: Vec<FitCoordinate> = CameraConstant::ALL
            .iter()
            .map(|c| {
                let p = c.prior(&evidence.facts);
                let limit = self.limits.iter().find(|(limited, _)| limited == c);
                let range = limit.map_or([f64::NEG_INFINITY, f64::INFINITY], |(_, range)| *range);
                FitCoordinate {
                    mean: p.mean,
                    sd: p.sd,
                    range,
                    step: p.step,
                    changes_signal: c.changes_signal(),
                }
            })
            .collect();
        for effect in &self.effects {
            for p in effect.parameters {
                out.push(FitCoordinate {
                    mean: 0.0,
                    sd: if p.is_fixed { 0.0 } else { f64::INFINITY },
                    range: p.fitted_range(),
                    step: p.step,
                    changes_signal: effect.changes_signal,
                });
            }
        }
        out
    }

    pub(crate) fn log_prior(&self, coordinates: &[FitCoordinate]) -> f64 {
        self.values
            .iter()
            .zip(coordinates)
            .filter(|(_, c)| c.sd > 0.0 && c.sd.is_finite())
            .map(|(v, c)| -0.5 * ((v - c.mean) / c.sd).powi(2))
            .sum()
    }

    /// The law of a pixel whose log thresholds differ by `spread` from the mean.
    pub(crate) fn law(&self, evidence: &Evidence, spread: [f64; 2]) -> ComparatorLaw {
        let v = |c: CameraConstant| self.values[c as usize];
        let (theta, half) =
            (v(CameraConstant::LogTheta).exp(), (0.5 * v(CameraConstant::LogRatio)).exp());
        // A uniform error within the step of the stamps.
        let grid_us = evidence.facts.stamp_step_us.unwrap_or(0.0) / 12.0_f64.sqrt();
        ComparatorLaw {
            theta: [theta * half * spread[0].exp(), theta / half * spread[1].exp()],
            leak_per_s: theta * half * v(CameraConstant::LeakHz),
            noise: theta * v(CameraConstant::LogNoise).exp(),
            noise_exponent: v(CameraConstant::NoiseExponent),
            rest_share: logistic(v(CameraConstant::LogitRest)),
            noise_rate_hz: v(CameraConstant::LogNoiseRate).exp(),
            stored_share: logistic(v(CameraConstant::LogitStored)),
            background_hz: [
                v(CameraConstant::LogBackgroundOn).exp(),
                v(CameraConstant::LogBackgroundOff).exp(),
            ],
            background_reset: logistic(v(CameraConstant::LogitBackgroundReset)),
            jitter_s: 1e-6 * v(CameraConstant::LogStampError).exp().hypot(grid_us),
            ..ComparatorLaw::default()
        }
    }

    /// The pixel as the model predicts it. `base` is the pixel under a model of the same signal
    /// whose law and clock alone differ.
    pub(crate) fn view<'a>(
        &self,
        evidence: &'a Evidence,
        number: usize,
        base: Option<&ModelledPixel<'_>>,
    ) -> ModelledPixel<'a> {
        let pixel = &evidence.pixels[number];
        let own = [evidence.start_us, evidence.step_us];
        let stated = evidence.facts.clock_tie.map(|t| t.as_stated(own, evidence.seconds()));
        let [start_us, step_us] = stated.unwrap_or(own);
        let has_base = base.is_some();
        let signal = base.map_or_else(
            || pixel.light.iter().map(|v| f64::from(*v)).collect(),
            |base| base.signal.clone(),
        );
        let mut view = ModelledPixel {
            pixel,
            y: pixel.y,
            middle: evidence.middle,
            signal,
            start_us: start_us + self.constant(CameraConstant::OffsetUs),
            step_us,
            law: self.law(evidence, self.spread[number]),
            darkness: Vec::new(),
        };
        view.darkness = match base
            .filter(|b| b.law.noise_exponent.to_bits() == view.law.noise_exponent.to_bits())
        {
            Some(base) => base.darkness.clone(),
            None => pixel.light.iter().map(|l| view.law.darkness(f64::from(*l))).collect(),
        };
        if !has_base {
            self.constants_on_light(evidence, &mut view);
        }
        for stage in 0..=4 {
            if stage == 2 && !has_base {
                self.photo_leak(&mut view);
            }
            for (index, effect) in self.effects.iter().enumerate() {
                if effect.stage == stage && (!has_base || !effect.changes_signal) {
                    (effect.apply)(&self.natural(index), &mut view);
                }
            }
        }
        view
    }

    fn constants_on_light(&self, evidence: &Evidence, view: &mut ModelledPixel<'_>) {
        let pixel = view.pixel;
        let blur = self.constant(CameraConstant::BlurPx2);
        if blur != 0.0 && !pixel.laplacian.is_empty() {
            for (signal, l) in view.signal.iter_mut().zip(&pixel.laplacian) {
                *signal += (0.5 * blur * f64::from(*l)).clamp(-0.7, 0.7);
            }
        }
        let pose = ImagePose {
            shift_px: [
                self.constant(CameraConstant::ShiftX),
                self.constant(CameraConstant::ShiftY),
            ],
            rotation_deg: self.constant(CameraConstant::RotationDeg),
            scale_change: self.constant(CameraConstant::Scale),
        };
        if pose != ImagePose::default() && !pixel.gradient[0].is_empty() {
            let place = [f64::from(pixel.x) + 0.5, f64::from(pixel.y) + 0.5];
            let source = pose.source_of(place, evidence.middle);
            let [dx, dy] = [0, 1].map(|i| source[i] - place[i]);
            let [gx, gy] = &pixel.gradient;
            for ((signal, gx), gy) in view.signal.iter_mut().zip(gx).zip(gy) {
                *signal += dx * f64::from(*gx) + dy * f64::from(*gy);
            }
        }
        self.sharpen_in_time(evidence, view);
        let pedestal = self.constant(CameraConstant::Pedestal);
        if pedestal != 0.0 {
            for signal in &mut view.signal {
                let share = pedestal * (-*signal).exp();
                *signal += if share.abs() < 0.02 {
                    // The logarithm's series, to 1e-8.
                    share * (1.0 - share * (0.5 - share * (1.0 / 3.0 - 0.25 * share)))
                } else {
                    share.max(-0.95).ln_1p()
                };
            }
        }
    }

    /// Undoes a blur in time, to second order.
    fn sharpen_in_time(&self, evidence: &Evidence, view: &mut ModelledPixel<'_>) {
        let variance = self.constant(CameraConstant::TemporalBlur);
        if variance == 0.0 {
            return;
        }
        let frame = evidence.facts.frame_us / evidence.step_us;
        let half = ((0.5 * frame).round() as usize).max(1);
        let factor = 0.5 * variance * (frame / half as f64).powi(2);
        let blurred = view.signal.clone();
        for i in half..blurred.len().saturating_sub(half) {
            let curvature = blurred[i - half] - 2.0 * blurred[i] + blurred[i + half];
            if curvature.is_finite() {
                view.signal[i] -= (factor * curvature).clamp(-0.5, 0.5);
            }
        }
    }

    fn photo_leak(&self, view: &mut ModelledPixel<'_>) {
        let hz = self.constant(CameraConstant::PhotoLeakHz);
        if hz == 0.0 {
            return;
        }
        let step = hz * view.law.theta[0] * view.step_us * 1e-6;
        let mut drift = 0.0;
        for (signal, light) in view.signal.iter_mut().zip(view.pixel.intensity()) {
            *signal += drift;
            drift += if light.is_finite() { step * f64::from(*light) } else { 0.0 };
        }
    }

    /// Whether the signal of the pixels is that of a model whose effects are the first of this one.
    pub(crate) fn has_signal_of(&self, base: &Self, coordinates: &[FitCoordinate]) -> bool {
        let is_changed = |at: &usize| self.values[*at].to_bits() != base.values[*at].to_bits();
        let changes_signal = |at: usize| coordinates[at].changes_signal || self.needs_signal(at);
        self.effects[base.effects.len()..].iter().all(|effect| !effect.changes_signal)
            && !(0..base.values.len()).filter(is_changed).any(changes_signal)
    }

    /// Thresholds scale the leaks, which are part of the signal.
    pub(crate) fn needs_signal(&self, at: usize) -> bool {
        let scaled = self.constant(CameraConstant::PhotoLeakHz) != 0.0
            || self.effects.iter().any(|e| e.stage == 2);
        let thresholds = [CameraConstant::LogTheta, CameraConstant::LogRatio];
        scaled && thresholds.iter().any(|constant| *constant as usize == at)
    }

    pub(crate) fn score(
        &self,
        evidence: &Evidence,
        number: usize,
        base: Option<&ModelledPixel<'_>>,
    ) -> PixelTerms {
        let view = self.view(evidence, number, base);
        score_view(evidence, number, &view)
    }
}
