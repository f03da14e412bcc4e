//! Published parameters, by name.

use crate::esim::EsimParameters;
use crate::model::ModelParameters;
use crate::v2e::V2eParameters;
use crate::voltmeter::{Coefficients, VoltmeterLaw};
use serde::{Deserialize, Serialize};

/// A published set of parameters of one model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Preset {
    /// [`Coefficients::DVS346`].
    #[serde(rename = "DVS346")]
    Dvs346,
    /// [`Coefficients::DVS240`].
    #[serde(rename = "DVS240")]
    Dvs240,
    /// [`Coefficients::RAW2DVS346`].
    #[serde(rename = "Raw2DVS346")]
    Raw2Dvs346,
    /// [`Coefficients::RGB2DVS346`].
    #[serde(rename = "RGB2DVS346")]
    Rgb2Dvs346,
    /// [`EsimParameters::PUBLISHED`].
    #[serde(rename = "ESIM")]
    Esim,
    /// [`V2eParameters::CLEAN`].
    #[serde(rename = "v2e-clean")]
    V2eClean,
    /// [`V2eParameters::NOISY`].
    #[serde(rename = "v2e-noisy")]
    V2eNoisy,
}

impl Preset {
    /// All presets; the first of a model is its default.
    pub const ALL: [Self; 7] = [
        Self::Dvs346,
        Self::Dvs240,
        Self::Raw2Dvs346,
        Self::Rgb2Dvs346,
        Self::Esim,
        Self::V2eClean,
        Self::V2eNoisy,
    ];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dvs346 => "DVS346",
            Self::Dvs240 => "DVS240",
            Self::Raw2Dvs346 => "Raw2DVS346",
            Self::Rgb2Dvs346 => "RGB2DVS346",
            Self::Esim => "ESIM",
            Self::V2eClean => "v2e-clean",
            Self::V2eNoisy => "v2e-noisy",
        }
    }

    /// What it is for, in a line.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Dvs346 => "DAVIS346 from its own 8-bit frames (DVS-Voltmeter)",
            Self::Dvs240 => "DAVIS240 from its own 8-bit frames (DVS-Voltmeter)",
            Self::Raw2Dvs346 => "DAVIS346 from 10-bit raw frames of Pi Camera Module 3 (Raw2Event)",
            Self::Rgb2Dvs346 => "DAVIS346 from 8-bit gray of Pi Camera Module 3 (Raw2Event)",
            Self::Esim => "thresholds of 0.2 log units, no noise (ESIM)",
            Self::V2eClean => "thresholds of 0.2 log units with 10 % mismatch (v2e)",
            Self::V2eNoisy => "a dim scene: 30 Hz bandwidth, leak, 5 Hz of shot noise (v2e)",
        }
    }

    /// The model with the preset's parameters.
    #[must_use]
    pub const fn parameters(self) -> ModelParameters {
        match self {
            Self::Dvs346 => exact(Coefficients::DVS346),
            Self::Dvs240 => exact(Coefficients::DVS240),
            Self::Raw2Dvs346 => exact(Coefficients::RAW2DVS346),
            Self::Rgb2Dvs346 => exact(Coefficients::RGB2DVS346),
            Self::Esim => ModelParameters::Esim(EsimParameters::PUBLISHED),
            Self::V2eClean => ModelParameters::V2e(V2eParameters::CLEAN),
            Self::V2eNoisy => ModelParameters::V2e(V2eParameters::NOISY),
        }
    }
}

const fn exact(k: Coefficients) -> ModelParameters {
    ModelParameters::Voltmeter { law: VoltmeterLaw::Exact, k }
}

named!(Preset, "preset");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_read_by_its_name_and_lies_within_the_ranges() {
        for preset in Preset::ALL {
            assert_eq!(preset.to_string().parse::<Preset>().unwrap(), preset);
            assert!(preset.parameters().check().is_ok(), "{preset}");
            let json = serde_json::to_string(&preset).unwrap();
            assert_eq!(json, format!("\"{preset}\""));
        }
    }

    #[test]
    fn an_unknown_preset_names_the_nearest() {
        let error = "Raw2DVS364".parse::<Preset>().unwrap_err().to_string();
        assert!(error.contains("did you mean `Raw2DVS346`"), "{error}");
    }
}
