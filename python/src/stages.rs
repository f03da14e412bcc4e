//! The stages of a session: generate, compare, calibrate, diagnose, process, report.

use crate::errors::Failure;
use crate::generator::ChoiceArguments;
use crate::session::SessionHandle;
use crate::streams::{ComparisonResult, comparison_result, json};
use crate::task::run_owning;
use evrig::batch;
use evrig::diagnose::DiagnosisOptions;
use evrig::generate::effect::EffectSet;
use evrig::generate::input::FramePreparation;
use evrig::pipeline::{
    self, Baseline, BaselineKind, By, CalibrateRequest, CameraRequest, CompareRequest, Conditions,
    DiagnoseRequest, GenerateRequest, ObjectiveKind, PipelineProgress, ProcessRequest, VariantList,
};
use evrig::session::{Session, StreamName};
use pyo3::prelude::*;
use std::path::PathBuf;

/// How frames of a session become events.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct StageConditions {
    name: String,
    frames: String,
    effects_json: String,
    interpolate_us: Option<u32>,
    in_plane: bool,
    colour: Option<String>,
    subtract_black: bool,
    divide_exposure: bool,
    force: bool,
}

impl StageConditions {
    fn request(
        self,
        session: &Session,
        choice: ChoiceArguments,
    ) -> Result<GenerateRequest, Failure> {
        let effects: EffectSet = serde_json::from_str(&self.effects_json)
            .map_err(|error| Failure::argument("effects", &error))?;
        let preparation = FramePreparation {
            colour: self.colour.map_or(Ok(Default::default()), |name| name.parse())?,
            subtract_black: self.subtract_black,
            divide_exposure: self.divide_exposure,
        };
        let (interpolate_us, in_plane) = (self.interpolate_us, self.in_plane);
        let mut conditions = Conditions { preparation, interpolate_us, in_plane, effects };
        let choice = choice.choice();
        let parameters = choice.parameters_on(session, &self.frames)?;
        choice.prepare_on(session, &self.frames, &mut conditions)?;
        let name = StreamName::new(&self.name)?;
        Ok(GenerateRequest { from: self.frames, name, parameters, conditions, force: self.force })
    }
}

#[pymethods]
impl SessionHandle {
    /// Generates a stream from frames; its counts as JSON.
    fn generate(
        &self,
        py: Python<'_>,
        choice: ChoiceArguments,
        conditions: StageConditions,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        let session = self.session.clone();
        run_owning(py, progress, move |link| {
            let request = conditions.request(&session, choice)?;
            let mut report = |done, total| link.report("generate", done, total);
            let made = pipeline::generate(&session, &request, &mut report)?;
            json(&made.tally)
        })
    }

    /// Why the constants of a choice may not suit the frames.
    fn doubt(&self, choice: ChoiceArguments, frames: &str) -> Option<String> {
        choice.choice().doubt_of_scale(&self.session, frames)
    }

    /// Generates a stream with the camera that a diagnosis found; counts as JSON, and cautions.
    fn generate_diagnosed(
        &self,
        py: Python<'_>,
        camera: Option<PathBuf>,
        name: &str,
        seed: u64,
        force: bool,
    ) -> PyResult<(String, Vec<String>)> {
        let session = self.session.clone();
        let name = StreamName::new(name).map_err(Failure::from)?;
        let by = camera.map_or(By::Own, |path| By::Other(path, None));
        run_owning(py, None, move |_| {
            let request = CameraRequest { by, name, seed, force };
            let (made, cautions) = pipeline::generate_diagnosed(&session, &request)?;
            Ok((json(&made.tally)?, cautions))
        })
    }

    /// Compares a simulated stream with a real one.
    fn compare<'py>(
        &self,
        py: Python<'py>,
        simulated: &str,
        real: String,
        seed: u64,
        force: bool,
    ) -> PyResult<ComparisonResult<'py>> {
        let session = self.session.clone();
        let name = StreamName::new(simulated).map_err(Failure::from)?;
        let request = CompareRequest { real, simulated: name, seed, force };
        let (comparison, _) =
            run_owning(py, None, move |_| Ok(pipeline::compare(&session, &request)?))?;
        comparison_result(py, simulated, comparison)
    }

    /// Fits the constants of the voltmeter; the calibration as JSON.
    fn calibrate(&self, py: Python<'_>, request: CalibrationArguments) -> PyResult<String> {
        let (session, request) = (self.session.clone(), request.request()?);
        run_owning(py, None, move |_| json(&pipeline::calibrate(&session, &request)?.0))
    }

    /// Diagnoses the session; the diagnosis as JSON.
    fn diagnose(
        &self,
        py: Python<'_>,
        request: DiagnosisArguments,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        let session = self.session.clone();
        run_owning(py, progress, move |link| {
            let request = request.request(&session)?;
            let mut n_steps = 0;
            let mut report = |step: &str| {
                n_steps += 1;
                link.report(step, n_steps, 0);
            };
            json(&pipeline::diagnose(&session, &request, &mut report)?.0)
        })
    }

    /// Runs every stage; those that were run, and those that were left out with the reason.
    fn process(
        &self,
        py: Python<'_>,
        choice: ChoiceArguments,
        variants: Option<String>,
        force: bool,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<ProcessedStages> {
        let root = self.session.root().to_owned();
        run_owning(py, progress, move |link| {
            let variants = variants.as_deref().map(VariantList::read).transpose()?;
            let request =
                ProcessRequest { choice: choice.choice(), variants, force, n_pixels: None };
            let processed = batch::process_session(&root, &request, &|progress| match progress {
                PipelineProgress::Stage { stage, done, total, .. } => {
                    link.report(stage, done, total);
                }
                PipelineProgress::Diagnosis(what) => link.report(what, 0, 0),
                PipelineProgress::Message(_) => link.check(),
            })?;
            let run = processed.results().map(|result| result.stage()).collect();
            let left = processed.skipped().map(|left| (left.stage, left.because.clone()));
            Ok((run, left.collect()))
        })
    }

    /// The report as HTML.
    fn report(&self, py: Python<'_>) -> PyResult<String> {
        let session = self.session.clone();
        run_owning(py, None, move |_| Ok(pipeline::report(&session)?))
    }
}

/// Stages that were run, and those that were left out with the reason.
type ProcessedStages = (Vec<&'static str>, Vec<(&'static str, String)>);

/// What a calibration is asked.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CalibrationArguments {
    frames: String,
    real: String,
    objective: String,
    n_evaluations: usize,
    seed: u64,
    force: bool,
}

impl CalibrationArguments {
    fn request(self) -> Result<CalibrateRequest, Failure> {
        let Self { frames: from, real, objective, n_evaluations, seed, force } = self;
        let objective = match objective.as_str() {
            "score" => ObjectiveKind::Score,
            "emd" => ObjectiveKind::Emd,
            other => {
                let text = format!("objective: expected \"score\" or \"emd\", got \"{other}\"");
                return Err(Failure::Argument(text));
            }
        };
        Ok(CalibrateRequest { from, real, objective, n_evaluations, seed, force })
    }
}

/// What a diagnosis is asked.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct DiagnosisArguments {
    real: String,
    baseline: Option<String>,
    frames: Option<String>,
    n_pixels: Option<usize>,
    seed: u64,
    force: bool,
}

impl DiagnosisArguments {
    fn request(self, session: &Session) -> Result<DiagnoseRequest, Failure> {
        let baseline = self.baseline(session)?;
        let defaults = DiagnosisOptions::default();
        let options = DiagnosisOptions {
            n_pixels: self.n_pixels.unwrap_or(defaults.n_pixels),
            seed: self.seed,
            ..defaults
        };
        Ok(DiagnoseRequest { real: self.real, baseline, options, force: self.force })
    }

    fn baseline(&self, session: &Session) -> Result<Baseline, Failure> {
        let kind = match self.baseline.as_deref() {
            None => None,
            Some("scene") => Some(BaselineKind::Scene),
            Some("motion") => Some(BaselineKind::Motion),
            Some("frames") => Some(BaselineKind::Frames),
            Some(other) => {
                return Err(Failure::Argument(format!(
                    "baseline: expected \"scene\", \"motion\" or \"frames\", got \"{other}\""
                )));
            }
        };
        let found = Baseline::chosen(session, kind, self.frames.as_deref());
        found.ok_or_else(|| {
            Failure::Session(format!(
                "{} has neither a scene nor frames on the events' pixel grid; run process(), or \
                 record with the camera's own frames on",
                session.root().display()
            ))
        })
    }
}
