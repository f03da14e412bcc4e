//! What decides the events of a generation, and the generator it describes.

use crate::esim::{Esim, EsimParameters};
use crate::generator::Generator;
use crate::grid::PixelGrid;
use crate::knobs::KnobSetting;
use crate::model::{GeneratorModel, ModelParameters};
use crate::parameter_error::ParameterError;
use crate::preset::Preset;
use crate::v2e::{V2e, V2eParameters};
use crate::voltmeter::{Coefficients, LazyVoltmeter, ScalarVoltmeter, VoltmeterLaw};
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;

/// Everything that decides which events a sequence of frames gives. The number of threads does not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GenerateParameters {
    /// The model with its parameters.
    pub model: ModelParameters,
    /// The preset the parameters came from, if they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
    /// The knobs applied to the preset.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub knobs: Vec<KnobSetting>,
    /// Seed of all draws.
    pub seed: u64,
}

/// A user's choice of model and parameters; the rest has defaults.
#[derive(Debug, Clone, Copy, Default)]
pub struct GeneratorChoice<'a> {
    /// Model name; when not given, the preset's, or `voltmeter`.
    pub model: Option<&'a str>,
    /// Law name, for the voltmeter; `exact` when not given.
    pub law: Option<&'a str>,
    /// Preset name; the model's first in [`Preset::ALL`] when neither it nor k is given.
    pub preset: Option<&'a str>,
    /// `k1,...,k6`, for the voltmeter.
    pub k: Option<&'a str>,
    /// Knobs applied in order, for the voltmeter.
    pub knobs: &'a [KnobSetting],
    /// Brightness of white in the frames (DN) for the models that need it; 255 when not given.
    pub full_scale_dn: Option<f64>,
    /// Seed of all draws.
    pub seed: u64,
}

impl GenerateParameters {
    /// A model with published parameters.
    #[must_use]
    pub const fn from_preset(preset: Preset, seed: u64) -> Self {
        Self { model: preset.parameters(), preset: Some(preset), knobs: Vec::new(), seed }
    }

    /// The paper's event model with k of its own and the exact law.
    #[must_use]
    pub const fn from_k(k: Coefficients, seed: u64) -> Self {
        let model = ModelParameters::Voltmeter { law: VoltmeterLaw::Exact, k };
        Self { model, preset: None, knobs: Vec::new(), seed }
    }

    /// Parameters from names and numbers as a user writes them.
    ///
    /// # Errors
    /// A name nothing has, a value out of range, or settings that do not go together.
    pub fn from_choice(choice: &GeneratorChoice<'_>) -> Result<Self, ParameterError> {
        let (preset, mut model) = choice.start()?;
        match &mut model {
            ModelParameters::Voltmeter { law, k } => {
                *law = choice.law.map_or(Ok(VoltmeterLaw::Exact), str::parse)?;
                for setting in choice.knobs {
                    *k = setting.knob.turn(*k, setting.value)?;
                }
            }
            ModelParameters::Esim(EsimParameters { full_scale_dn, .. })
            | ModelParameters::V2e(V2eParameters { full_scale_dn, .. }) => {
                *full_scale_dn = choice.full_scale_dn.unwrap_or(*full_scale_dn);
                choice.refuse_voltmeter_settings(model.model())?;
            }
        }
        model.check()?;
        Ok(Self { model, preset, knobs: choice.knobs.to_vec(), seed: choice.seed })
    }
}

impl GeneratorChoice<'_> {
    /// Where the knobs start: the k given, the preset given, or the model's first preset.
    fn start(&self) -> Result<(Option<Preset>, ModelParameters), ParameterError> {
        let model: Option<GeneratorModel> = self.model.map(str::parse).transpose()?;
        let not_for = |given: String, model: GeneratorModel| ParameterError::NotForModel {
            given,
            model: model.name(),
        };
        match (self.preset, self.k) {
            (Some(_), Some(_)) => Err(ParameterError::PresetAndK),
            (None, Some(k)) => match model.unwrap_or_default() {
                GeneratorModel::Voltmeter => Ok((
                    None,
                    ModelParameters::Voltmeter { law: VoltmeterLaw::Exact, k: k.parse()? },
                )),
                other => Err(not_for("k".into(), other)),
            },
            (Some(name), None) => {
                let preset: Preset = name.parse()?;
                let parameters = preset.parameters();
                match model {
                    Some(model) if model != parameters.model() => {
                        Err(not_for(format!("the preset {preset}"), model))
                    }
                    _ => Ok((Some(preset), parameters)),
                }
            }
            (None, None) => {
                let preset = match model.unwrap_or_default() {
                    GeneratorModel::Voltmeter => Preset::Dvs346,
                    GeneratorModel::Esim => Preset::Esim,
                    GeneratorModel::V2e => Preset::V2eClean,
                };
                Ok((Some(preset), preset.parameters()))
            }
        }
    }

    fn refuse_voltmeter_settings(&self, model: GeneratorModel) -> Result<(), ParameterError> {
        let law = self.law.map(|law| format!("the law {law}"));
        let knob = self.knobs.first().map(|setting| format!("the knob {}", setting.knob));
        match law.or(knob) {
            Some(given) => Err(ParameterError::NotForModel { given, model: model.name() }),
            None => Ok(()),
        }
    }
}

/// The generator that the parameters describe, on its own `threads` threads or, without a
/// number, on rayon's common pool. The events are the same either way.
///
/// # Errors
/// A parameter out of range, or [`ParameterError::Threads`] when threads cannot be started.
pub fn build(
    parameters: &GenerateParameters,
    threads: Option<NonZeroUsize>,
) -> Result<Box<dyn Generator>, ParameterError> {
    parameters.model.check()?;
    let seed = parameters.seed;
    Ok(match parameters.model {
        ModelParameters::Voltmeter { law: VoltmeterLaw::Exact, k } => {
            Box::new(PixelGrid::new(LazyVoltmeter::new(k, seed), threads)?)
        }
        ModelParameters::Voltmeter { law: law @ VoltmeterLaw::Reference, k } => {
            Box::new(PixelGrid::new(ScalarVoltmeter::new(k, law, seed), threads)?)
        }
        ModelParameters::Esim(parameters) => {
            Box::new(PixelGrid::new(Esim::new(parameters, seed), threads)?)
        }
        ModelParameters::V2e(parameters) => {
            Box::new(PixelGrid::new(V2e::new(parameters, seed), threads)?)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Knob;
    use evrig_core::event::Events;
    use evrig_core::frame::Luminance;
    use evrig_core::geometry::Size;

    #[test]
    fn a_record_of_parameters_is_read_back_as_written() {
        let knobs = [KnobSetting { knob: Knob::EventSensitivity, value: 3.0 }];
        let turned = GeneratorChoice {
            preset: Some("raw2dvs346"),
            knobs: &knobs,
            ..GeneratorChoice::default()
        };
        let v2e =
            GeneratorChoice { preset: Some("v2e-noisy"), seed: 7, ..GeneratorChoice::default() };
        let esim = GeneratorChoice {
            model: Some("esim"),
            full_scale_dn: Some(1023.0),
            ..GeneratorChoice::default()
        };
        for (choice, name) in [(turned, "voltmeter"), (v2e, "v2e"), (esim, "esim")] {
            let parameters = GenerateParameters::from_choice(&choice).unwrap();
            let json = serde_json::to_string(&parameters).unwrap();
            assert_eq!(serde_json::from_str::<GenerateParameters>(&json).unwrap(), parameters);
            assert!(json.contains(&format!("\"name\":\"{name}\"")), "{json}");
            assert_eq!(build(&parameters, NonZeroUsize::new(2)).unwrap().name(), name);
        }
    }

    #[test]
    fn every_preset_gives_the_same_ordered_events_on_one_thread_and_on_two() {
        let size = Size::new(150, 100);
        let frame = |i: i64| {
            let wave =
                |pixel: usize| 120.0 + 100.0 * (0.07 * (pixel as f32 + 9.0 * i as f32)).sin();
            let values = (0..size.n_pixels()).map(wave).collect();
            Luminance { t_us: 1_700_000_000_000_000 + 10_000 * i, size, values }
        };
        for preset in Preset::ALL {
            let parameters = GenerateParameters::from_preset(preset, 3);
            let [one, two] = [1, 2].map(|threads| {
                let mut generator = build(&parameters, NonZeroUsize::new(threads)).unwrap();
                let mut out = Events::new();
                (0..5).for_each(|i| generator.push(&frame(i), &mut out).unwrap());
                out
            });
            assert!(one == two && one.len() > 10_000, "{preset}: {} events", one.len());
            assert_eq!(one.as_slice().first_disorder(), None, "{preset}");
        }
    }

    #[test]
    fn wrong_choices_say_what_would_be_right() {
        let error = |choice| GenerateParameters::from_choice(&choice).unwrap_err().to_string();
        let base = GeneratorChoice::default();
        assert!(
            error(GeneratorChoice { model: Some("voltmetre"), ..base }).contains("`voltmeter`")
        );
        assert!(error(GeneratorChoice { law: Some("exakt"), ..base }).contains("`exact`"));
        let k = Some("1,1,0,0,0,0");
        assert!(
            error(GeneratorChoice { preset: Some("DVS346"), k, ..base }).contains("one of the two")
        );
        assert!(
            error(GeneratorChoice { model: Some("esim"), k, ..base }).contains("k does not go")
        );
        let model = Some("v2e");
        assert!(
            error(GeneratorChoice { model, preset: Some("DVS346"), ..base })
                .contains("preset DVS346")
        );
        assert!(error(GeneratorChoice { model, law: Some("exact"), ..base }).contains("law exact"));
        let white = GeneratorChoice { model, full_scale_dn: Some(0.0), ..base };
        assert!(error(white).contains("full_scale_dn"));
    }
}
