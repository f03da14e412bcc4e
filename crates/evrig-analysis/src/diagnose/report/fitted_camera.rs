//! A fitted model as a camera for event generation.

use crate::diagnose::SessionFacts;
use crate::diagnose::model::registration::FittedRegistration;
use evrig_core::effect_id::EffectId;
use evrig_generate::effect::RecordingContext;
use evrig_generate::forward::CameraConstants;
use serde::{Deserialize, Serialize};

/// The event camera of a model; each effect is the generator's own implementation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedCamera {
    /// The camera, for any signal.
    pub camera: CameraConstants,
    /// Registration to the signal of its recording.
    #[serde(alias = "seen")]
    pub registration: FittedRegistration,
    /// Named effects: in the camera's effects, in its law or in the signal.
    pub named: Vec<EffectId>,
    /// What the generator cannot represent.
    pub left_out: Vec<String>,
}

impl FittedCamera {
    /// Bounds the background rate by `most_hz`. A fit uses active pixels, whose unexplained events
    /// count as background; silent pixels bound it.
    #[must_use]
    pub fn with_background_up_to(mut self, most_hz: f64) -> Self {
        self.camera.background_hz = self.camera.background_hz.min(most_hz);
        self
    }
}

/// What effects of readout and frames depend on in a recording.
#[must_use]
pub fn surroundings(facts: &SessionFacts) -> RecordingContext {
    RecordingContext { aps_starts_us: facts.aps_us.clone(), frame_times_us: facts.aps_us.clone() }
}
