//! A request to generate events by a model.

use crate::pipeline::conditions::Conditions;
use evrig_generate::GenerateParameters;
use evrig_session::StreamName;

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct GenerateRequest {
    /// The signal: name of a frame stream, or `scene`.
    pub from: String,
    /// Name of the stream to make.
    pub name: StreamName,
    /// Model, parameters and seed.
    pub parameters: GenerateParameters,
    /// Preparation of the frames and physical effects.
    pub conditions: Conditions,
    /// Run even when the result is fresh.
    pub force: bool,
}
