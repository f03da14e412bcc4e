//! An effect in the model.

use crate::diagnose::Rival;
use evrig_core::effect_id::EffectId;

/// An effect that was taken, with what it was measured against.
pub(crate) struct Taken {
    pub(crate) gain: f64,
    pub(crate) error: f64,
    pub(crate) rivals: Vec<Rival>,
    pub(crate) equals: Vec<EffectId>,
}
