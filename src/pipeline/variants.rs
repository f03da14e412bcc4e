//! A list of generations of one session, each compared with the real events.

use super::error::missing;
use super::{
    CalibrateRequest, CompareRequest, Conditions, ExternalRequest, ExternalSimulator,
    FilterRequest, Freshness, GenerateRequest, Generated, ModelChoice, ObjectiveKind,
    PipelineError, PipelineProgress, ReferenceStream, calibrate, common_grid, compare_with, filter,
    generate, generate_external, read_calibration,
};
use evrig_analysis::compare::Comparison;
use evrig_generate::effect::EffectSet;
use evrig_generate::input::{Colour, FramePreparation};
use evrig_session::{Session, StreamKind, StreamName};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

const BUNDLED: [(&str, &str); 2] = [
    ("twelve", include_str!("variants/twelve.toml")),
    ("davis", include_str!("variants/davis.toml")),
];

/// A list of variants, bundled or from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct VariantList {
    name: String,
    variants: Vec<VariantEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ListFile {
    variant: Vec<VariantEntry>,
}

/// A variant by a model, or by a command where it states one.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "toml::Table")]
enum VariantEntry {
    Model(Box<VariantDescription>),
    External(Box<ExternalSimulator>),
}

impl TryFrom<toml::Table> for VariantEntry {
    type Error = toml::de::Error;

    fn try_from(table: toml::Table) -> Result<Self, Self::Error> {
        if table.contains_key("command") {
            table.try_into().map(|simulator| Self::External(Box::new(simulator)))
        } else {
            table.try_into().map(|description| Self::Model(Box::new(description)))
        }
    }
}

impl VariantEntry {
    fn names(&self) -> [&String; 2] {
        match self {
            Self::Model(model) => [&model.name, &model.from],
            Self::External(simulator) => [&simulator.name, &simulator.from],
        }
    }
}

/// One stream to generate; what is not given has its default.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct VariantDescription {
    name: String,
    from: String,
    model: Option<String>,
    preset: Option<String>,
    k: Option<String>,
    #[serde(default)]
    knobs: Vec<String>,
    full_scale_dn: Option<f64>,
    law: Option<String>,
    seed: Option<u64>,
    interpolate_us: Option<u32>,
    #[serde(default)]
    in_plane: bool,
    colour: Option<String>,
    #[serde(default)]
    subtract_black: bool,
    #[serde(default)]
    divide_exposure: bool,
    #[serde(default)]
    effects: EffectSet,
}

impl VariantList {
    /// The bundled list `twelve` or `davis`, or a TOML file.
    ///
    /// # Errors
    /// When the file cannot be read or is not such a list.
    pub fn read(list: &str) -> Result<Self, PipelineError> {
        let text = match BUNDLED.iter().find(|(name, _)| *name == list) {
            Some((_, text)) => (*text).to_owned(),
            None => std::fs::read_to_string(list)
                .map_err(|source| PipelineError::Io { path: PathBuf::from(list), source })?,
        };
        let file: ListFile = toml::from_str(&text)
            .map_err(|error| PipelineError::Request(format!("{list}: {error}")))?;
        Ok(Self { name: list.to_owned(), variants: file.variant })
    }

    /// Name of a bundled list, or the file as it was given.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The list as an argument that holds in any working directory.
    ///
    /// # Errors
    /// When the file is gone.
    pub fn argument(&self) -> Result<String, PipelineError> {
        if BUNDLED.iter().any(|(name, _)| *name == self.name) {
            return Ok(self.name.clone());
        }
        let path = std::fs::canonicalize(&self.name)
            .map_err(|source| PipelineError::Io { path: Path::new(&self.name).into(), source })?;
        Ok(path.display().to_string())
    }
}

/// How the events of a variant are made.
#[derive(Debug, Clone, PartialEq)]
pub enum VariantRequest {
    /// By a model.
    Model(Box<GenerateRequest>),
    /// By a simulator of other software.
    External(Box<ExternalRequest>),
}

/// One variant of a session.
#[derive(Debug)]
pub struct VariantResult {
    /// Its name and that of its stream.
    pub name: String,
    /// The generation; none where the variant was left out.
    pub generated: Option<(VariantRequest, Generated)>,
    /// The comparison with the real events.
    pub comparison: Option<Comparison>,
    /// Why it was left out or not compared.
    pub because: Option<String>,
}

/// All variants of a list.
#[derive(Debug)]
pub struct VariantResults {
    /// Name of the session.
    pub session: String,
    /// Name of the list.
    pub list: String,
    /// One entry per variant, in the list's order.
    pub variants: Vec<VariantResult>,
}

impl VariantResults {
    /// Fails when not one variant was generated.
    ///
    /// # Errors
    /// [`PipelineError::Missing`] with the number of variants.
    pub fn require_any(&self, session: &Session) -> Result<(), PipelineError> {
        if self.variants.iter().any(|variant| variant.generated.is_some()) {
            return Ok(());
        }
        let n = self.variants.len();
        Err(missing(session, format!("none of the {n} variants could be generated")))
    }
}

impl VariantResult {
    /// The result in a line.
    fn summary(&self, seconds: f64) -> String {
        let (name, because) = (&self.name, self.because.as_deref());
        let Some((_, made)) = &self.generated else {
            return format!("{name}: left out: {}", because.unwrap_or_default());
        };
        let fresh = if made.freshness == Freshness::Fresh { "fresh, " } else { "" };
        let not_compared = because.map_or(String::new(), |why| format!("; not compared: {why}"));
        format!("{name}: {} events ({fresh}{seconds:.1} s){not_compared}", made.tally.n_events)
    }
}

/// Generates and compares every variant of a list. A variant whose inputs are missing is left out.
///
/// # Errors
/// [`PipelineError::Request`] when a description in the list is wrong.
pub fn variants(
    session: &Session,
    list: &VariantList,
    seed: u64,
    force: bool,
    progress: &dyn Fn(PipelineProgress<'_>),
) -> Result<VariantResults, PipelineError> {
    let mut reference = ReferenceStream::new(session, "real");
    // Absolute, since a command runs in another folder.
    let path = std::path::absolute(&list.name)
        .map_err(|source| PipelineError::Io { path: PathBuf::from(&list.name), source })?;
    let folder = path.parent().unwrap_or(&path);
    let run = VariantRun { session, folder, seed, force, progress };
    let (mut results, n) = (Vec::new(), list.variants.len());
    for (i, variant) in list.variants.iter().enumerate() {
        let began = Instant::now();
        let result = run.one(&mut reference, variant)?;
        let summary = result.summary(began.elapsed().as_secs_f64());
        progress(PipelineProgress::Message(&format!("{:>2} of {n}  {summary}", i + 1)));
        results.push(result);
    }
    let session = session.manifest().name.clone();
    Ok(VariantResults { session, list: list.name.clone(), variants: results })
}

struct VariantRun<'a> {
    session: &'a Session,
    /// Folder of the list.
    folder: &'a Path,
    seed: u64,
    force: bool,
    progress: &'a dyn Fn(PipelineProgress<'_>),
}

impl VariantRun<'_> {
    fn one(
        &self,
        reference: &mut ReferenceStream<'_>,
        variant: &VariantEntry,
    ) -> Result<VariantResult, PipelineError> {
        let Self { seed, force, .. } = *self;
        let [name, _] = variant.names();
        let mut result =
            VariantResult { name: name.clone(), generated: None, comparison: None, because: None };
        let simulated = StreamName::new(name)
            .map_err(|error| PipelineError::Request(format!("variant `{name}`: {error}")))?;
        match self.generate(variant, &simulated) {
            Ok(generated) => result.generated = Some(generated),
            Err(error @ PipelineError::Request(_)) => return Err(error),
            Err(error) => {
                result.because = Some(error.to_string());
                return Ok(result);
            }
        }
        let compared = self.cut(&simulated).and_then(|()| {
            let real = "real".to_owned();
            compare_with(reference, &CompareRequest { real, simulated, seed, force })
        });
        match compared {
            Ok((comparison, _)) => result.comparison = Some(comparison),
            Err(error) => result.because = Some(error.to_string()),
        }
        Ok(result)
    }

    fn generate(
        &self,
        variant: &VariantEntry,
        name: &StreamName,
    ) -> Result<(VariantRequest, Generated), PipelineError> {
        let Self { session, progress, force, seed, folder } = *self;
        let [_, from] = variant.names();
        if from != "scene" && session.stream(StreamKind::Frames, from).is_err() {
            return Err(missing(session, format!("no frame stream `{from}`")));
        }
        let mut progress = |done, total| {
            let stage = "generate";
            progress(PipelineProgress::Stage { stage, stream: name.as_str(), done, total });
        };
        Ok(match variant {
            VariantEntry::Model(model) => {
                let request = self.request(model, name)?;
                let made = generate(session, &request, &mut progress)?;
                (VariantRequest::Model(Box::new(request)), made)
            }
            VariantEntry::External(simulator) => {
                let (simulator, folder) = (simulator.as_ref().clone(), folder.to_owned());
                let request = ExternalRequest { simulator, folder, seed, force };
                let made = generate_external(session, &request, &mut progress)?;
                (VariantRequest::External(Box::new(request)), made)
            }
        })
    }

    fn request(
        &self,
        variant: &VariantDescription,
        name: &StreamName,
    ) -> Result<GenerateRequest, PipelineError> {
        let (session, from) = (self.session, variant.from.as_str());
        let choice = variant.choice(self.seed);
        self.calibrate(from, &choice)?;
        let parameters = choice.parameters_on(session, from)?;
        let colour = variant.colour.as_deref().map_or(Ok(Colour::default()), str::parse);
        let mut conditions = Conditions {
            preparation: FramePreparation {
                colour: colour.map_err(|error| PipelineError::Request(error.to_string()))?,
                subtract_black: variant.subtract_black,
                divide_exposure: variant.divide_exposure,
            },
            interpolate_us: variant.interpolate_us,
            in_plane: variant.in_plane,
            effects: variant.effects.clone(),
        };
        choice.prepare_on(session, from, &mut conditions)?;
        let (from, name, force) = (from.to_owned(), name.clone(), self.force);
        Ok(GenerateRequest { from, name, parameters, conditions, force })
    }

    /// Calibrates on the signal where the variant takes the session's own constants and there are
    /// none.
    fn calibrate(&self, from: &str, choice: &ModelChoice) -> Result<(), PipelineError> {
        let signal = StreamName::new(from)?;
        if !choice.is_calibrated() || read_calibration(self.session, &signal)?.is_some() {
            return Ok(());
        }
        (self.progress)(PipelineProgress::Stage {
            stage: "calibrate",
            stream: from,
            done: 0,
            total: 1,
        });
        let request = CalibrateRequest {
            from: from.to_owned(),
            real: "real".into(),
            objective: ObjectiveKind::Score,
            n_evaluations: 0,
            seed: self.seed,
            force: false,
        };
        calibrate(self.session, &request).map(drop)
    }

    /// Cuts the real stream and a generated one to the target where a track locates it: streams of
    /// two cameras have no other common grid.
    fn cut(&self, simulated: &StreamName) -> Result<(), PipelineError> {
        let Some(settings) = common_grid(self.session) else { return Ok(()) };
        for (stream, force) in [(StreamName::new("real")?, false), (simulated.clone(), self.force)]
        {
            filter(self.session, &FilterRequest { stream, settings, force })?;
        }
        Ok(())
    }
}

impl VariantDescription {
    fn choice(&self, seed: u64) -> ModelChoice {
        ModelChoice {
            model: self.model.clone(),
            preset: self.preset.clone(),
            k: self.k.clone(),
            knobs: self.knobs.clone(),
            full_scale_dn: self.full_scale_dn,
            law: self.law.clone(),
            seed: self.seed.unwrap_or(seed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_bundled_lists_are_read_and_name_each_stream_once() {
        for (list, n) in [("twelve", 12), ("davis", 6)] {
            let variants = VariantList::read(list).unwrap().variants;
            let names: BTreeSet<_> = variants.iter().map(|v| v.names()[0].clone()).collect();
            assert_eq!((variants.len(), names.len()), (n, n));
            for name in names {
                StreamName::new(&name).unwrap();
            }
        }
    }
}
