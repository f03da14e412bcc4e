//! An effect in the model.

use crate::diagnose::CompetingHypothesis;
use evrig_core::effect_id::EffectId;

/// An effect of the model, with its gain and its competitors.
pub(crate) struct AcceptedEffect {
    pub(crate) gain: f64,
    pub(crate) error: f64,
    pub(crate) competing_hypotheses: Vec<CompetingHypothesis>,
    pub(crate) indistinguishable: Vec<EffectId>,
}
