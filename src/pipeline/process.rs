//! Every stage of a session for which it has the inputs, in the order in which they need each
//! other.

mod result;

pub use result::{ProcessStep, Processed, SkippedStage, StageResult};

use super::scene_source::SCENE;
use super::{
    AlignProgress, CalibrateRequest, CompareRequest, Conditions, DiagnoseRequest, FilterRequest,
    GenerateRequest, Generated, ModelChoice, ObjectiveKind, PipelineError, PipelineProgress,
    ReferenceStream, VariantList, align, calibrate, common_grid, compare_with, count_frames,
    default_baseline, default_light, diagnose, event_streams, filter, frame_streams, generate,
    pi_streams, read_clocks, simulated_streams, track_for, variants, white_of,
};
use evrig_analysis::diagnose::DiagnosisOptions;
use evrig_generate::GenerateParameters;
use evrig_session::{Session, StreamKind, StreamName};
use std::sync::atomic::{AtomicU64, Ordering};

/// How the stages are run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ProcessRequest {
    /// The generator; published constants and the session's own where none is chosen.
    pub choice: ModelChoice,
    /// A list of variants to generate beside it.
    pub variants: Option<VariantList>,
    /// Pixels of the diagnosis, at most; its own default where none is stated.
    pub n_pixels: Option<usize>,
    /// Run stages even when their results are fresh.
    pub force: bool,
}

/// Runs the stages. A stage that lacks its inputs is left out, and so is one that its data cannot
/// carry; neither keeps the others from being run.
///
/// # Errors
/// When the request is wrong, a file is damaged, or the disk refuses.
pub fn process(
    session: &Session,
    request: &ProcessRequest,
    progress: &(dyn Fn(PipelineProgress<'_>) + Sync),
) -> Result<Processed, PipelineError> {
    let mut run = ProcessRun { session, request, progress, steps: Vec::new(), n_lost: 0 };
    run.align()?;
    run.generate_from_scene()?;
    run.generate_from_own_frames()?;
    run.generate_from_pi()?;
    run.filter_all()?;
    run.variants();
    run.compare_all()?;
    run.diagnose();
    let losses = session.manifest().losses.clone();
    let n_lost = run.n_lost + losses.len();
    let session = session.manifest().name.clone();
    Ok(Processed { session, steps: run.steps, losses, n_lost })
}

struct ProcessRun<'a> {
    session: &'a Session,
    request: &'a ProcessRequest,
    progress: &'a (dyn Fn(PipelineProgress<'_>) + Sync),
    steps: Vec<ProcessStep>,
    n_lost: usize,
}

impl ProcessRun<'_> {
    fn done(&mut self, result: StageResult) {
        self.steps.push(ProcessStep::Done(Box::new(result)));
    }

    fn skip(&mut self, stage: &'static str, because: impl ToString) {
        self.steps.push(ProcessStep::Skipped(SkippedStage { stage, because: because.to_string() }));
    }

    fn has_real_events(&self) -> bool {
        self.session.stream(StreamKind::Events, "real").is_ok()
    }

    fn align(&mut self) -> Result<(), PipelineError> {
        let total = count_frames(self.session, frame_streams(self.session).iter());
        let (n_tracked, progress) = (AtomicU64::new(0), self.progress);
        let aligned = align(self.session, self.request.force, &|step| match step {
            AlignProgress::Tracked => {
                let done = n_tracked.fetch_add(1, Ordering::Relaxed) + 1;
                progress(PipelineProgress::Stage { stage: "track", stream: "", done, total });
            }
            AlignProgress::Mapped(done, total) => {
                progress(PipelineProgress::Stage { stage: "scene", stream: "", done, total });
            }
        });
        match aligned.clocks {
            None => self.skip("sync", "the session has no frames of the Pi's camera"),
            Some(Ok(synced)) => self.done(StageResult::Sync(Box::new(synced))),
            Some(Err(error @ PipelineError::Clock { .. })) => {
                self.skip("sync", error);
                self.n_lost += 1;
            }
            Some(Err(error)) => return Err(error),
        }
        let tracks = aligned.tracks.unwrap_or_else(|because| {
            self.skip("track", because);
            Vec::new()
        });
        for (request, tracked) in tracks {
            match tracked {
                Ok(tracked) => self.done(StageResult::Track(request, Box::new(tracked))),
                Err(error @ PipelineError::Track { .. }) => {
                    self.skip("track", error);
                    self.n_lost += 1;
                }
                Err(error) => return Err(error),
            }
        }
        match aligned.scene {
            Ok(made) => self.done(StageResult::Scene(made)),
            Err(error @ PipelineError::Missing { .. }) => self.skip("scene", error),
            Err(error @ PipelineError::Scene(_)) => {
                self.skip("scene", error);
                self.n_lost += 1;
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Events from the scene, with constants calibrated on it unless others are chosen.
    fn generate_from_scene(&mut self) -> Result<(), PipelineError> {
        // A missing scene is reported by its own stage.
        if white_of(self.session, SCENE)?.is_none() {
            return Ok(());
        }
        let preset = if self.calibrate(SCENE)? { "tuned" } else { "Raw2DVS346" };
        let choice = self.request.choice.or_preset(preset);
        let parameters = choice.parameters_on(self.session, SCENE)?;
        match self.generate(SCENE, SCENE, parameters) {
            Ok((request, made)) => self.done(StageResult::Generate(request, made)),
            // Calibrated constants may be out of a generator's range.
            Err(error) => self.skip("generate", error),
        }
        Ok(())
    }

    /// Events from frames on the events' own pixel grid, with the published constants and with
    /// those calibrated on the session.
    fn generate_from_own_frames(&mut self) -> Result<(), PipelineError> {
        let session = self.session;
        let Some(signal) = default_light(session) else {
            let because = "the session has no frames on the events' pixel grid";
            self.skip("calibrate", because);
            self.skip("generate", because);
            return Ok(());
        };
        let is_calibrated = self.calibrate(signal)?;
        let choice = &self.request.choice;
        let mut streams = vec![(signal.to_owned(), choice.parameters_on(session, signal)?)];
        if is_calibrated && !choice.is_given() {
            let parameters = choice.or_preset("tuned").parameters_on(session, signal)?;
            // Published constants that predict better are kept; their events are there already.
            if parameters.model != streams[0].1.model {
                streams.push((format!("{signal}-tuned"), parameters));
            }
        }
        for (name, parameters) in streams {
            match self.generate(signal, &name, parameters) {
                Ok((request, made)) => {
                    self.n_lost += usize::from(made.tally.n_frames_not_later > 0);
                    self.done(StageResult::Generate(request, made));
                }
                // Calibrated constants may be out of a generator's range; the published are not.
                Err(error) if name != signal => self.skip("generate", error),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Events from the Pi's frames, each stream with its published constants unless others are
    /// chosen.
    fn generate_from_pi(&mut self) -> Result<(), PipelineError> {
        let session = self.session;
        let has_clock = read_clocks(session)?.is_some();
        for stream in pi_streams(session) {
            if !has_clock {
                self.skip("generate", format!("`{stream}` has no map to the events' clock"));
                continue;
            }
            let published = if stream == "raw" { "Raw2DVS346" } else { "RGB2DVS346" };
            let parameters = self.request.choice.or_preset(published).parameters()?;
            let (request, made) = self.generate(stream, stream, parameters)?;
            self.done(StageResult::Generate(request, made));
        }
        Ok(())
    }

    fn generate(
        &self,
        from: &str,
        name: &str,
        parameters: GenerateParameters,
    ) -> Result<(GenerateRequest, Generated), PipelineError> {
        let request = GenerateRequest {
            from: from.to_owned(),
            name: StreamName::new(name)?,
            parameters,
            conditions: Conditions::default(),
            force: self.request.force,
        };
        let made = generate(self.session, &request, &mut |done, total| {
            (self.progress)(PipelineProgress::Stage {
                stage: "generate",
                stream: name,
                done,
                total,
            });
        })?;
        Ok((request, made))
    }

    /// Whether constants could be calibrated on the signal. Without the search over k: regressions
    /// and the fit of passages take seconds, the search minutes.
    fn calibrate(&mut self, signal: &str) -> Result<bool, PipelineError> {
        if !self.has_real_events() {
            self.skip("calibrate", "the session has no real events");
            return Ok(false);
        }
        let request = CalibrateRequest {
            from: signal.to_owned(),
            real: "real".into(),
            objective: ObjectiveKind::Score,
            n_evaluations: 0,
            seed: self.request.choice.seed,
            force: self.request.force,
        };
        (self.progress)(PipelineProgress::Stage {
            stage: "calibrate",
            stream: signal,
            done: 0,
            total: 1,
        });
        match calibrate(self.session, &request) {
            Ok((calibration, freshness)) => {
                self.done(StageResult::Calibrate(request, calibration, freshness));
                Ok(true)
            }
            Err(PipelineError::Calibrate { source, .. }) => {
                self.skip("calibrate", source);
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }

    fn filter_all(&mut self) -> Result<(), PipelineError> {
        let Some(settings) = common_grid(self.session) else {
            self.skip("filter", "no track of the event camera locates the target");
            return Ok(());
        };
        for stream in event_streams(self.session) {
            if let Err(error) = track_for(self.session, &stream) {
                self.skip("filter", error);
                continue;
            }
            let request = FilterRequest { stream, settings, force: self.request.force };
            let filtered = filter(self.session, &request)?;
            self.done(StageResult::Filter(request, filtered));
        }
        Ok(())
    }

    fn variants(&mut self) {
        let ProcessRequest { choice, variants: Some(list), force, .. } = self.request else {
            return;
        };
        let results = variants(self.session, list, choice.seed, *force, &self.progress);
        match results.and_then(|results| results.require_any(self.session).map(|()| results)) {
            Ok(results) => self.done(StageResult::Variants(results)),
            Err(error) => {
                self.skip("variants", error);
                self.n_lost += 1;
            }
        }
    }

    fn compare_all(&mut self) -> Result<(), PipelineError> {
        let streams = simulated_streams(self.session, "real");
        if !self.has_real_events() {
            self.skip("compare", "the session has no real events");
            return Ok(());
        }
        if streams.is_empty() {
            self.skip("compare", "there is no simulated stream");
        }
        let mut reference = ReferenceStream::new(self.session, "real");
        for simulated in streams {
            let ProcessRequest { choice: ModelChoice { seed, .. }, force, .. } = *self.request;
            let request = CompareRequest { real: "real".into(), simulated, seed, force };
            match compare_with(&mut reference, &request) {
                Ok((comparison, freshness)) => {
                    self.done(StageResult::Compare(request, comparison, freshness));
                }
                // Streams of two cameras that were not cut to the target have no common grid.
                Err(error @ PipelineError::Missing { .. }) => self.skip("compare", error),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// A session that cannot be diagnosed is no failure of the other stages.
    fn diagnose(&mut self) {
        let baseline = default_baseline(self.session).filter(|_| self.has_real_events());
        let Some(baseline) = baseline else {
            self.skip("diagnose", "it takes real events and frames on their pixel grid");
            return;
        };
        let defaults = DiagnosisOptions::default();
        let request = DiagnoseRequest {
            real: "real".into(),
            baseline,
            options: DiagnosisOptions {
                seed: self.request.choice.seed,
                n_pixels: self.request.n_pixels.unwrap_or(defaults.n_pixels),
                ..defaults
            },
            force: self.request.force,
        };
        let progress = self.progress;
        let found = diagnose(self.session, &request, &mut |what| {
            progress(PipelineProgress::Diagnosis(what));
        });
        match found {
            Ok((diagnosis, _)) => self.done(StageResult::Diagnose(diagnosis)),
            Err(error) => self.skip("diagnose", error),
        }
    }
}
