//! A generator model as a user names it, before the session's own constants are looked up.

use super::error::missing;
use super::{Conditions, PipelineError, read_calibration, white_of};
use evrig_analysis::calibrate::Calibration;
use evrig_generate::input::FramePreparation;
use evrig_generate::{
    GenerateParameters, GeneratorChoice, GeneratorModel, KnobSetting, ParameterError, Preset,
};
use evrig_session::{Session, StreamKind, StreamName};

/// The choice of a generator and its parameters. `--k @calibrated` and `--preset tuned` mean the
/// constants that were calibrated on the session.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ModelChoice {
    /// `voltmeter`, `esim` or `v2e`.
    pub model: Option<String>,
    /// Name of a published set of parameters.
    pub preset: Option<String>,
    /// `k1,...,k6` of the voltmeter.
    pub k: Option<String>,
    /// Knobs of the voltmeter as `name=value`.
    pub knobs: Vec<String>,
    /// Value of white in the frames, DN.
    pub full_scale_dn: Option<f64>,
    /// `exact` or `reference`.
    pub law: Option<String>,
    /// Seed of all draws.
    pub seed: u64,
}

impl ModelChoice {
    /// A choice of nothing but the seed.
    #[must_use]
    pub fn seeded(seed: u64) -> Self {
        Self { seed, ..Self::default() }
    }

    /// Whether a model or its constants are chosen.
    #[must_use]
    pub const fn is_given(&self) -> bool {
        self.model.is_some() || self.preset.is_some() || self.k.is_some() || !self.knobs.is_empty()
    }

    /// Whether the session's own constants are chosen.
    #[must_use]
    pub fn is_calibrated(&self) -> bool {
        let is = |given: &Option<String>, word: &str| {
            given.as_deref().is_some_and(|given| given.eq_ignore_ascii_case(word))
        };
        is(&self.k, "@calibrated") || is(&self.preset, "tuned")
    }

    /// The same with this preset unless something is chosen.
    #[must_use]
    pub fn or_preset(&self, preset: &str) -> Self {
        let mut choice = self.clone();
        if !choice.is_given() {
            choice.preset = Some(preset.to_owned());
        }
        choice
    }

    /// The generator's parameters.
    ///
    /// # Errors
    /// [`PipelineError::Request`] when a name is unknown or a value out of range.
    pub fn parameters(&self) -> Result<GenerateParameters, PipelineError> {
        let wrong = |error: ParameterError| PipelineError::Request(error.to_string());
        let knobs: Result<Vec<KnobSetting>, _> = self.knobs.iter().map(|k| k.parse()).collect();
        let choice = GeneratorChoice {
            model: self.model.as_deref(),
            law: self.law.as_deref(),
            preset: self.preset.as_deref(),
            k: self.k.as_deref(),
            knobs: &knobs.map_err(wrong)?,
            full_scale_dn: self.full_scale_dn,
            seed: self.seed,
        };
        GenerateParameters::from_choice(&choice).map_err(wrong)
    }

    /// The generator's parameters on a signal of a session: white of the scene where none is given,
    /// and the session's own constants where they are chosen.
    ///
    /// # Errors
    /// As [`Self::parameters`]; [`PipelineError::Missing`] without a calibration.
    pub fn parameters_on(
        &self,
        session: &Session,
        signal: &str,
    ) -> Result<GenerateParameters, PipelineError> {
        if self.full_scale_dn.is_some() && self.is_voltmeter() {
            let what = "--full-scale-dn has no effect on the voltmeter, whose constants hold for the \
                        scale they were fitted on; choose --model esim or v2e, or omit it";
            return Err(PipelineError::Request(what.into()));
        }
        let mut choice = self.clone();
        choice.full_scale_dn = choice.full_scale_dn.or(white_of(session, signal)?);
        if choice.is_calibrated() {
            choice.k = Some(calibration(session, signal)?.k.to_string());
            choice.preset = None;
        }
        choice.parameters()
    }

    fn is_voltmeter(&self) -> bool {
        let of_preset = || {
            let preset: Option<Preset> = self.preset.as_deref().and_then(|name| name.parse().ok());
            preset.is_none_or(|preset| preset.parameters().model() == GeneratorModel::Voltmeter)
        };
        self.model.as_deref().map_or_else(of_preset, |model| model == "voltmeter")
    }

    /// A statement for published constants on frames of another scale than they were fitted on:
    /// those of the voltmeter are of 8 bits, but for the presets of raw frames.
    #[must_use]
    pub fn doubt_of_scale(&self, session: &Session, signal: &str) -> Option<String> {
        let entry = session.stream(StreamKind::Frames, signal).ok()?;
        let is_fitted = self.k.is_some() || !self.knobs.is_empty() || self.is_calibrated();
        let is_raw = self.preset.as_deref().is_some_and(|name| name.to_lowercase().contains("raw"));
        let is_doubtful = self.is_voltmeter() && !is_fitted && !is_raw;
        (is_doubtful && entry.source.ends_with("16 bit")).then(|| {
            format!(
                "the published constants are for frames of 8 bits and `{signal}` has 16: expect \
                 several times the events; run `evrig calibrate`, give --k, choose --model esim or \
                 v2e with --full-scale-dn, or import frames of 8 bits"
            )
        })
    }

    /// Prepares frames as those of the calibration, where its constants are chosen and `conditions`
    /// state no preparation: constants hold for frames prepared as those they were fitted to.
    ///
    /// # Errors
    /// [`PipelineError::Missing`] without a calibration.
    pub fn prepare_on(
        &self,
        session: &Session,
        signal: &str,
        conditions: &mut Conditions,
    ) -> Result<(), PipelineError> {
        if self.is_calibrated() && conditions.preparation == FramePreparation::default() {
            conditions.preparation = calibration(session, signal)?.preparation;
        }
        Ok(())
    }

    /// The same as arguments of a command line.
    #[must_use]
    pub fn arguments(&self) -> Vec<String> {
        let Self { model, preset, k, knobs, full_scale_dn, law, seed } = self;
        let full_scale_dn = full_scale_dn.map(|dn| dn.to_string());
        let mut arguments = vec![format!("--seed={seed}")];
        let named = [
            ("model", model),
            ("preset", preset),
            ("k", k),
            ("full-scale-dn", &full_scale_dn),
            ("law", law),
        ];
        let given = named.iter().filter_map(|(name, v)| Some(format!("--{name}={}", v.as_ref()?)));
        arguments.extend(given);
        arguments.extend(knobs.iter().map(|knob| format!("--knob={knob}")));
        arguments
    }
}

fn calibration(session: &Session, signal: &str) -> Result<Calibration, PipelineError> {
    let signal = StreamName::new(signal)?;
    read_calibration(session, &signal)?.ok_or_else(|| {
        let root = session.root().display();
        let what = format!(
            "no calibrated constants for `{signal}`; run `evrig calibrate {root} --from {signal}` \
             first"
        );
        missing(session, what)
    })
}
