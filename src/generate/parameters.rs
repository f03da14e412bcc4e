//! What a generation is made of, as a stage record keeps it, and the generator it gives.

use super::grid::Grid;
use super::voltmeter::{Coefficients, LazyVoltmeter, ScalarVoltmeter};
use super::{Generator, KnobSetting, ParameterError, Preset};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

/// A model that makes events from frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// Drifting Brownian motion between two barriers (DVS-Voltmeter, Raw2Event).
    Voltmeter,
}

/// How the voltmeter's law is drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Law {
    /// The stated equation, exactly.
    #[default]
    Exact,
    /// The published program's shortcuts, for comparison with its output.
    Reference,
}

/// A model with all its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "lowercase", deny_unknown_fields)]
pub enum ModelParameters {
    /// The paper's event model.
    Voltmeter {
        /// How its law is drawn from.
        law: Law,
        /// k1 to k6.
        k: Coefficients,
    },
}

/// All that decides which events a run of frames gives. Threads are not in it: they
/// do not change the result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GenerateParameters {
    /// The model with its parameters.
    pub model: ModelParameters,
    /// The preset the parameters came from, if they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
    /// The knobs that were turned to get from there to the parameters.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub knobs: Vec<KnobSetting>,
    /// Seed of all draws.
    pub seed: u64,
}

/// What a user says about a generation; the rest follows from it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Choice<'a> {
    /// Model name; `voltmeter` when not given.
    pub model: Option<&'a str>,
    /// Law name; `exact` when not given.
    pub law: Option<&'a str>,
    /// Preset name; the model's first when neither it nor k is given.
    pub preset: Option<&'a str>,
    /// `k1,...,k6`.
    pub k: Option<&'a str>,
    /// Knobs turned from there, one after another.
    pub knobs: &'a [KnobSetting],
    /// Seed of all draws.
    pub seed: u64,
}

impl Model {
    /// All models.
    pub const ALL: [Self; 1] = [Self::Voltmeter];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Voltmeter => "voltmeter",
        }
    }
}

impl Law {
    /// All laws.
    pub const ALL: [Self; 2] = [Self::Exact, Self::Reference];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Reference => "reference",
        }
    }
}

impl ModelParameters {
    /// Which model it is.
    #[must_use]
    pub const fn model(&self) -> Model {
        match self {
            Self::Voltmeter { .. } => Model::Voltmeter,
        }
    }
}

impl GenerateParameters {
    /// The paper's event model with a published set of k and the exact law.
    #[must_use]
    pub fn from_preset(preset: Preset, seed: u64) -> Self {
        Self { preset: Some(preset), ..Self::from_k(preset.coefficients(), seed) }
    }

    /// The paper's event model with k of its own and the exact law.
    #[must_use]
    pub fn from_k(k: Coefficients, seed: u64) -> Self {
        let model = ModelParameters::Voltmeter { law: Law::Exact, k };
        Self { model, preset: None, knobs: Vec::new(), seed }
    }

    /// Parameters from names and numbers as a user writes them.
    ///
    /// # Errors
    /// A name nothing has, a k out of range, or a preset together with k.
    pub fn from_choice(choice: &Choice<'_>) -> Result<Self, ParameterError> {
        let model = choice.model.map_or(Ok(Model::Voltmeter), str::parse)?;
        match model {
            Model::Voltmeter => Self::voltmeter(choice),
        }
    }

    fn voltmeter(choice: &Choice<'_>) -> Result<Self, ParameterError> {
        let law = choice.law.map_or(Ok(Law::Exact), str::parse)?;
        let (preset, k) = match (choice.preset, choice.k) {
            (Some(_), Some(_)) => return Err(ParameterError::PresetAndK),
            (None, Some(k)) => (None, k.parse()?),
            (preset, None) => {
                let preset = preset.map_or(Ok(Preset::Dvs346), str::parse)?;
                (Some(preset), preset.coefficients())
            }
        };
        let turn = |k: Coefficients, setting: &KnobSetting| setting.knob.turn(k, setting.value);
        let k = choice.knobs.iter().try_fold(k, turn)?;
        let model = ModelParameters::Voltmeter { law, k };
        Ok(Self { model, preset, knobs: choice.knobs.to_vec(), seed: choice.seed })
    }
}

/// The generator that the parameters describe, on its own `threads` threads or, without a
/// number, on rayon's common pool. The events are the same either way.
///
/// # Errors
/// [`ParameterError::Threads`] when the threads cannot be started.
pub fn build(
    parameters: &GenerateParameters,
    threads: Option<NonZeroUsize>,
) -> Result<Box<dyn Generator>, ParameterError> {
    let seed = parameters.seed;
    Ok(match parameters.model {
        ModelParameters::Voltmeter { law: Law::Exact, k } => {
            Box::new(Grid::new(LazyVoltmeter::new(k, seed), threads)?)
        }
        ModelParameters::Voltmeter { law: law @ Law::Reference, k } => {
            Box::new(Grid::new(ScalarVoltmeter::new(k, law, seed), threads)?)
        }
    })
}

macro_rules! named {
    ($name:ident, $kind:literal) => {
        impl FromStr for $name {
            type Err = ParameterError;
            fn from_str(text: &str) -> Result<Self, ParameterError> {
                Self::ALL
                    .into_iter()
                    .find(|item| item.name().eq_ignore_ascii_case(text))
                    .ok_or_else(|| ParameterError::unknown($kind, text, &Self::ALL.map(Self::name)))
            }
        }
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

named!(Model, "model");
named!(Law, "law");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::Knob;

    #[test]
    fn a_record_of_parameters_is_read_back_as_written() {
        let knobs = [KnobSetting { knob: Knob::EventSensitivity, value: 3.0 }];
        let choice = Choice { preset: Some("raw2dvs346"), knobs: &knobs, ..Choice::default() };
        let parameters = GenerateParameters::from_choice(&choice).unwrap();
        let json = serde_json::to_string(&parameters).unwrap();
        assert_eq!(serde_json::from_str::<GenerateParameters>(&json).unwrap(), parameters);
        assert!(json.contains("\"k\":[3.0,4.166e-7"), "{json}");
        assert_eq!(build(&parameters, NonZeroUsize::new(2)).unwrap().name(), "voltmeter");
    }

    #[test]
    fn wrong_choices_say_what_would_be_right() {
        let error = |choice| GenerateParameters::from_choice(&choice).unwrap_err().to_string();
        let base = Choice::default();
        assert!(error(Choice { model: Some("voltmetre"), ..base }).contains("`voltmeter`"));
        assert!(error(Choice { law: Some("exakt"), ..base }).contains("`exact`"));
        let both = Choice { preset: Some("DVS346"), k: Some("1,1,0,0,0,0"), ..base };
        assert!(error(both).contains("one of the two"));
    }
}
