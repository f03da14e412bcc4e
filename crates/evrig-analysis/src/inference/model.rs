//! A model: constants, effects, thresholds of the pixels; and its scores.

use super::constants::{CameraConstant, ConstantPrior, N_CONSTANTS};
use super::effects::ModelEffect;
use super::law::{ComparatorLaw, logistic};
use super::pass::{HazardTerm, TermVisitor, visit};
use super::view::ModelledPixel;
use crate::diagnose::{Evidence, ImagePose};
use std::sync::Arc;

#[derive(Debug, Clone)]
pub(crate) struct CameraModel {
    pub(crate) values: Vec<f64>,
    pub(crate) effects: Vec<&'static ModelEffect>,
    /// Constants held inside a range.
    pub(crate) limits: Vec<(CameraConstant, [f64; 2])>,
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

/// A pixel's terms.
#[derive(Debug, Clone, Default)]
pub(crate) struct PixelTerms {
    /// Log hazard of each scored event, and its block.
    pub(crate) log_hazard: Vec<f64>,
    pub(crate) block: Vec<u16>,
    /// Compensator of each block.
    pub(crate) compensator: Vec<f64>,
}

struct TermCollector(PixelTerms);

impl TermVisitor for TermCollector {
    fn silence(&mut self, block: usize, compensator: f64) {
        self.0.compensator[block] += compensator;
    }
    fn event(&mut self, term: &HazardTerm) {
        self.0.log_hazard.push(term.log_hazard);
        self.0.block.push(term.block as u16);
    }
}

impl CameraModel {
    pub(crate) fn baseline(evidence: &Evidence) -> Self {
        let values = CameraConstant::ALL.map(|c| {
            let ConstantPrior { mean, ordinary: [lo, hi], .. } = c.prior(&evidence.facts);
            mean.clamp(lo, hi)
        });
        Self {
            values: values.to_vec(),
            effects: Vec::new(),
            limits: Vec::new(),
            max_spread: f64::INFINITY,
            spread: Arc::new(vec![[0.0; 2]; evidence.pixels.len()]),
            spread_sd: 0.0,
        }
    }

    /// Whether the first parameter of the last effect, its strength or its scale, lies at the end of
    /// its range.
    pub(crate) fn is_at_bound(&self) -> bool {
        let Some(index) = self.effects.len().checked_sub(1) else { return false };
        let at = self.offset_of(index);
        let first = self.effects[index].parameters.iter().zip(&self.values[at..]).take(1);
        first.into_iter().any(|(parameter, value)| {
            let [low, high] = parameter.fitted_range();
            !parameter.is_fixed && (*value <= low || *value >= high)
        })
    }

    /// Removes an effect.
    pub(crate) fn remove_effect(&mut self, index: usize) {
        let at = self.offset_of(index);
        self.values.drain(at..at + self.effects[index].parameters.len());
        self.effects.remove(index);
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

    pub(crate) fn with(&self, effect: &'static ModelEffect, start: &[f64]) -> Self {
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

    fn law(&self, evidence: &Evidence, spread: [f64; 2]) -> ComparatorLaw {
        let v = |c: CameraConstant| self.values[c as usize];
        let (theta, half) =
            (v(CameraConstant::LogTheta).exp(), (0.5 * v(CameraConstant::LogRatio)).exp());
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
            jitter_s: evidence.facts.stamp_step_us.unwrap_or(0.0) * 1e-6 / 12.0_f64.sqrt(),
            ..ComparatorLaw::default()
        }
    }

    /// The pixel as the model predicts it. `base` is a signal of the same model whose law and
    /// clock alone differ.
    pub(crate) fn view<'a>(
        &self,
        evidence: &'a Evidence,
        number: usize,
        base: Option<Vec<f64>>,
    ) -> ModelledPixel<'a> {
        let pixel = &evidence.pixels[number];
        let own = [evidence.start_us, evidence.step_us];
        let stated = evidence.facts.clock_tie.map(|t| t.as_stated(own, evidence.seconds()));
        let [start_us, step_us] = stated.unwrap_or(own);
        let has_base = base.is_some();
        let signal = base.unwrap_or_else(|| pixel.light.iter().map(|v| f64::from(*v)).collect());
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
        view.darkness = pixel.light.iter().map(|l| view.law.darkness(f64::from(*l))).collect();
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
        let pedestal = self.constant(CameraConstant::Pedestal);
        if pedestal != 0.0 {
            for signal in &mut view.signal {
                let light = signal.exp();
                *signal = (light + pedestal).max(0.05 * light).ln();
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
        for (signal, level) in view.signal.iter_mut().zip(&view.pixel.light) {
            *signal += drift;
            drift += if level.is_finite() { step * f64::from(level.exp()) } else { 0.0 };
        }
    }

    pub(crate) fn score(
        &self,
        evidence: &Evidence,
        number: usize,
        base: Option<Vec<f64>>,
    ) -> PixelTerms {
        let view = self.view(evidence, number, base);
        score_view(evidence, number, &view)
    }
}

pub(crate) fn score_view(
    evidence: &Evidence,
    number: usize,
    view: &ModelledPixel<'_>,
) -> PixelTerms {
    let mut scorer = TermCollector(PixelTerms {
        compensator: vec![0.0; evidence.blocks.n()],
        ..PixelTerms::default()
    });
    visit(
        &view.law,
        view.sampled(),
        &evidence.pixels[number].spikes,
        &evidence.blocks,
        &mut scorer,
    );
    scorer.0
}
