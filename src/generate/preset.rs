//! Published coefficients, by name.

use super::ParameterError;
use super::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A published set of k for one pair of frame camera and event camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Preset {
    /// DAVIS346 events from its own 8-bit frames (Lin et al., DVS-Voltmeter, ECCV 2022).
    #[serde(rename = "DVS346")]
    Dvs346,
    /// DAVIS240 events from its own 8-bit frames (Lin et al., DVS-Voltmeter, ECCV 2022).
    #[serde(rename = "DVS240")]
    Dvs240,
    /// DAVIS346 events from 10-bit raw frames of Pi Camera Module 3 (Raw2Event).
    #[serde(rename = "Raw2DVS346")]
    Raw2Dvs346,
    /// DAVIS346 events from 8-bit gray of the same camera's RGB frames (Raw2Event).
    #[serde(rename = "RGB2DVS346")]
    Rgb2Dvs346,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 4] = [Self::Dvs346, Self::Dvs240, Self::Raw2Dvs346, Self::Rgb2Dvs346];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dvs346 => "DVS346",
            Self::Dvs240 => "DVS240",
            Self::Raw2Dvs346 => "Raw2DVS346",
            Self::Rgb2Dvs346 => "RGB2DVS346",
        }
    }

    /// What it is for, in a line.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Dvs346 => "DAVIS346 from its own 8-bit frames",
            Self::Dvs240 => "DAVIS240 from its own 8-bit frames",
            Self::Raw2Dvs346 => "DAVIS346 from 10-bit raw frames of Pi Camera Module 3",
            Self::Rgb2Dvs346 => "DAVIS346 from 8-bit gray frames of Pi Camera Module 3",
        }
    }

    /// The k of the event model.
    #[must_use]
    pub const fn coefficients(self) -> Coefficients {
        // The two older sets are published as products: contrast step times light in lux.
        Coefficients::published(match self {
            Self::Dvs346 => [0.000_18 * 29_250.0, 20.0, 0.000_1, 1e-7, 5e-9, 0.000_01],
            Self::Dvs240 => [0.000_094 * 47_065.0, 23.0, 0.000_2, 1e-7, 5e-8, 0.000_01],
            Self::Raw2Dvs346 => [2.388, 4.166e-7, 1.541e-6, 9.768e-8, 1.466e-11, 9.824e-6],
            Self::Rgb2Dvs346 => [
                5.332_474_147_628_972,
                0.900_333_202_726_682_3,
                8.288_263_352_543_993e-6,
                1.099_239_717_282_808_7e-7,
                3.302_652_963_977_818e-9,
                1.101_244_403_871_650_4e-7,
            ],
        })
    }
}

impl FromStr for Preset {
    type Err = ParameterError;

    /// Reads a name, in any case.
    fn from_str(text: &str) -> Result<Self, ParameterError> {
        Self::ALL
            .into_iter()
            .find(|preset| preset.name().eq_ignore_ascii_case(text))
            .ok_or_else(|| ParameterError::unknown("preset", text, &Self::ALL.map(Self::name)))
    }
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_read_by_its_name_and_lies_within_the_ranges_of_k() {
        for preset in Preset::ALL {
            assert_eq!(preset.to_string().parse::<Preset>().unwrap(), preset);
            assert!(Coefficients::new(preset.coefficients().k()).is_ok());
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
