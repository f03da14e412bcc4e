//! Why a set of effects is refused.

use evrig_core::effect_id::{EffectId, UnknownEffect};

/// A set of effects that does not make sense or cannot act here.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// No effect has this name.
    #[error(transparent)]
    Unknown(#[from] UnknownEffect),
    /// A parameter outside its range.
    #[error("{id}: {key} is {value}; expected {low} to {high}")]
    OutOfRange {
        /// The effect.
        id: EffectId,
        /// The parameter.
        key: &'static str,
        /// What was given.
        value: f64,
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
    /// Parameters that cannot be read.
    #[error("{id}: {reason}; its parameters are {}", id.parameters().join(", "))]
    Unreadable {
        /// The effect.
        id: EffectId,
        /// What is wrong.
        reason: String,
    },
    /// Text that is not `id:key=value,...`.
    #[error("`{text}` is not an effect; write it as refractory_period:refractory_us=800")]
    NotAnEffect {
        /// The text.
        text: String,
    },
    /// A region that holds no pixel or no time.
    #[error("{id}: the region's {key} runs from {low} to {high}; the second must be larger")]
    EmptyRegion {
        /// The effect.
        id: EffectId,
        /// Which side of the region.
        key: &'static str,
        /// Its start.
        low: f64,
        /// Its end.
        high: f64,
    },
    /// An effect inside a pixel of a model that has its own.
    #[error(
        "{id} acts inside the pixel, which the model {model} keeps to itself; take the voltmeter"
    )]
    NotForModel {
        /// The effect.
        id: EffectId,
        /// The model.
        model: &'static str,
    },
    /// An effect that acts on what is not there.
    #[error("{id} needs {what}")]
    Needs {
        /// The effect.
        id: EffectId,
        /// What it needs, and how to give it.
        what: &'static str,
    },
}
