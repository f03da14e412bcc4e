//! How an effect acts on a predicted pixel.

use crate::diagnose::model::view::ModelledPixel;
use crate::diagnose::{ConfidenceInterval, Evidence};
use evrig_core::effect_id::EffectId;

/// A parameter's key and value.
pub(crate) type KeyedInterval = (&'static str, ConfidenceInterval);

/// A parameter in fitted coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModelParameter {
    pub(crate) key: &'static str,
    pub(crate) is_log: bool,
    pub(crate) range: [f64; 2],
    /// Finite-difference step.
    pub(crate) step: f64,
    pub(crate) is_fixed: bool,
}

pub(super) const fn log(key: &'static str, range: [f64; 2]) -> ModelParameter {
    ModelParameter { key, is_log: true, range, step: 3e-3, is_fixed: false }
}
pub(super) const fn linear(key: &'static str, range: [f64; 2], step: f64) -> ModelParameter {
    ModelParameter { key, is_log: false, range, step, is_fixed: false }
}
pub(super) const fn fixed(key: &'static str) -> ModelParameter {
    ModelParameter { key, is_log: false, range: [-1e9, 1e9], step: 0.0, is_fixed: true }
}

impl ModelParameter {
    pub(crate) fn natural(&self, v: f64) -> f64 {
        if self.is_log { v.exp() } else { v }
    }
    pub(crate) fn fitted_range(&self) -> [f64; 2] {
        if self.is_log { self.range.map(f64::ln) } else { self.range }
    }
}

/// The action of an effect on a predicted pixel.
#[derive(Debug)]
pub(crate) struct ModelTerm {
    pub(crate) id: EffectId,
    pub(crate) parameters: &'static [ModelParameter],
    pub(crate) changes_signal: bool,
    /// Range of the magnitude of the first parameter that an ordinary recording has.
    pub(crate) ordinary: fn(&Evidence) -> [f64; 2],
    /// Starting values, natural units.
    pub(crate) starts: fn(&Evidence) -> Vec<Vec<f64>>,
    /// Stage order.
    pub(crate) stage: u8,
    pub(crate) apply: fn(&[f64], &mut ModelledPixel<'_>),
    /// Reported parameters from the fitted ones.
    pub(crate) report: fn(&Evidence, Vec<KeyedInterval>) -> Vec<KeyedInterval>,
}
