//! The models that make events from frames, with their parameters.

use crate::esim::EsimParameters;
use crate::parameter_error::ParameterError;
use crate::v2e::V2eParameters;
use crate::voltmeter::{Coefficients, VoltmeterLaw};
use serde::{Deserialize, Serialize};

/// A model that makes events from frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GeneratorModel {
    /// Drifting Brownian motion between two barriers (DVS-Voltmeter, Raw2Event).
    #[default]
    Voltmeter,
    /// Log brightness on straight lines between frames (Rebecq et al. 2018).
    Esim,
    /// Lin-log photoreceptor with bandwidth, leak, noise and mismatch (Hu et al. 2021).
    V2e,
}

/// A model with all its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "name", rename_all = "lowercase", deny_unknown_fields)]
pub enum ModelParameters {
    /// The paper's event model.
    Voltmeter {
        /// How its law is drawn from.
        law: VoltmeterLaw,
        /// k1 to k6.
        k: Coefficients,
    },
    /// The ESIM pixel.
    Esim(EsimParameters),
    /// The v2e pixel.
    V2e(V2eParameters),
}

impl GeneratorModel {
    /// All models.
    pub const ALL: [Self; 3] = [Self::Voltmeter, Self::Esim, Self::V2e];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Voltmeter => "voltmeter",
            Self::Esim => "esim",
            Self::V2e => "v2e",
        }
    }
}

impl ModelParameters {
    /// Which model it is.
    #[must_use]
    pub const fn model(&self) -> GeneratorModel {
        match self {
            Self::Voltmeter { .. } => GeneratorModel::Voltmeter,
            Self::Esim(_) => GeneratorModel::Esim,
            Self::V2e(_) => GeneratorModel::V2e,
        }
    }

    /// Refuses what lies outside the ranges; a [`Coefficients`] cannot.
    ///
    /// # Errors
    /// The first parameter out of range, by name.
    pub fn check(&self) -> Result<(), ParameterError> {
        match self {
            Self::Voltmeter { .. } => Ok(()),
            Self::Esim(parameters) => parameters.check(),
            Self::V2e(parameters) => parameters.check(),
        }
    }
}

named!(GeneratorModel, "model");
