//! Trials made, diagnosed blind, opened and judged.

use super::plasmode::{PlasmodeError, Recording};
use super::seal::{SealError, open, seal};
use super::{Answer, Family, Judgement, Score, Trial, judge};
use crate::device::sim::world::WorldDescription;
use crate::diagnose::Options;
use crate::pipeline::{self, DiagnoseRequest, PipelineError, TrackRequest};
use crate::record::{SimulateError, Simulation, simulate};
use crate::rig::{DescriptionError, Rig};
use crate::session::import::import_aedat4;
use crate::session::{Session, SessionError, StreamKind};
use crate::time::Span;
use crate::trajectory::{Optional, Trajectory};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Why trials cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ProveError {
    /// A seal cannot be set or does not hold.
    #[error(transparent)]
    Seal(#[from] SealError),
    /// A simulated session cannot be made.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// A recording cannot be changed.
    #[error(transparent)]
    Plasmode(#[from] PlasmodeError),
    /// A session cannot be made or read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A stage failed.
    #[error(transparent)]
    Pipeline(Box<PipelineError>),
    /// The rig or the trajectory of the trials is wrong.
    #[error("{what}: {because}")]
    Description {
        /// Which.
        what: String,
        /// Why.
        because: String,
    },
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

impl From<PipelineError> for ProveError {
    fn from(error: PipelineError) -> Self {
        Self::Pipeline(Box::new(error))
    }
}

/// What all trials of a run have in common.
#[derive(Debug, Clone)]
pub struct Bench {
    /// Where sessions, truths and judgements go; truths in a folder apart from the sessions.
    pub out: PathBuf,
    /// How long a simulated session is.
    pub duration: Span,
    /// The recording to which effects are applied, for plasmode trials.
    pub recording: Option<PathBuf>,
    /// How hard the diagnosis looks.
    pub options: Options,
    /// Whether a session is removed once it was judged.
    pub is_tidy: bool,
}

/// All trials of a family, judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proof {
    /// `evrig.proof/1`.
    pub schema: String,
    /// Whose sessions.
    pub family: Family,
    /// Everything counted.
    pub score: Score,
    /// Trial by trial.
    pub judgements: Vec<Judgement>,
}

impl Bench {
    /// Runs trials of one family; `progress` is told what is being done, and how many are done.
    ///
    /// # Errors
    /// When a session cannot be made, a seal does not hold, or the disk refuses. A diagnosis that
    /// fails on its session is an answer: none.
    pub fn run(
        &self,
        family: Family,
        trials: &[Trial],
        progress: &mut dyn FnMut(&str, usize),
    ) -> Result<Proof, ProveError> {
        let known = match (family, &self.recording) {
            (Family::Plasmode, Some(recording)) => self.own_effects(recording, progress)?,
            _ => BTreeSet::new(),
        };
        let mut judgements = Vec::new();
        for (done, trial) in trials.iter().enumerate() {
            progress(&format!("{}: recording", trial.name), done);
            let root = self.out.join("sessions").join(&trial.name);
            self.make(trial, &root)?;
            let (truth, seal_path) = (self.truth(trial), root.join("seal.json"));
            seal(&trial.truth, &truth, &seal_path)?;
            progress(&format!("{}: diagnosing", trial.name), done);
            let answer = answer(&root, &self.options)?;
            // Only now is the truth looked at, and only if it is the one that was sealed.
            let judgement = judge(&trial.name, &open(&truth, &seal_path)?, &answer, &known);
            judgements.push(judgement);
            if self.is_tidy {
                let io = |source| ProveError::Io { path: root.clone(), source };
                std::fs::remove_dir_all(&root).map_err(io)?;
            }
        }
        let score = Score::of(&judgements);
        Ok(Proof { schema: "evrig.proof/1".into(), family, score, judgements })
    }

    fn truth(&self, trial: &Trial) -> PathBuf {
        self.out.join("truth").join(format!("{}.json", trial.name))
    }

    /// The effects that a recording holds before anything is applied to it.
    fn own_effects(
        &self,
        recording: &Path,
        progress: &mut dyn FnMut(&str, usize),
    ) -> Result<BTreeSet<String>, ProveError> {
        progress("the recording as it is: diagnosing", 0);
        let root = self.out.join("sessions").join("plasmode-as-it-is");
        clear(&root)?;
        // Through the same writer as the changed ones, so that nothing but the effect differs.
        self.import(&Recording::read(recording)?, &root)?;
        let answer = answer(&root, &self.options)?;
        let named = answer.effects.into_iter();
        Ok(named.flat_map(|named| std::iter::once(named.id).chain(named.equivalent)).collect())
    }

    fn make(&self, trial: &Trial, root: &Path) -> Result<(), ProveError> {
        clear(root)?;
        match (trial.family, &self.recording) {
            (Family::Plasmode, Some(recording)) => {
                let mut recording = Recording::read(recording)?;
                for effect in &trial.truth.effects {
                    recording.apply(effect, trial.seed)?;
                }
                self.import(&recording, root)
            }
            (Family::World, _) => self.simulate(trial, root),
            (family, _) => Err(ProveError::Description {
                what: format!("trial {}", trial.name),
                because: format!("no session of the family {} can be made here", family.as_str()),
            }),
        }
    }

    fn import(&self, recording: &Recording, root: &Path) -> Result<(), ProveError> {
        let file = self.out.join("changed.aedat4");
        recording.write(&file)?;
        import_aedat4(&file, root, &mut |_| {})?;
        std::fs::remove_file(&file).map_err(|source| ProveError::Io { path: file, source })
    }

    fn simulate(&self, trial: &Trial, root: &Path) -> Result<(), ProveError> {
        let describe = |what: &str, error: &dyn std::fmt::Display| ProveError::Description {
            what: what.to_owned(),
            because: error.to_string(),
        };
        let rig = plain_rig().map_err(|e| describe("rig sim", &e))?;
        let name = trial.trajectory.as_str();
        let trajectory = Trajectory::find(name).map_err(|e| describe(name, &e))?;
        let path = trajectory.path(&rig, Optional::LeftOut).map_err(|e| describe(name, &e))?;
        let world = world(trial).map_err(|e| describe(&trial.name, &e))?;
        let duration = self.duration.min(path.duration());
        simulate(
            &Simulation {
                rig: &rig,
                trajectory: &trajectory,
                path: &path,
                world: &world,
                seed: trial.seed,
                out: root,
                duration: Some(duration),
            },
            &mut |_| {},
        )?;
        Ok(())
    }
}

/// The simulated rig without its RGB path, which no diagnosis looks at.
fn plain_rig() -> Result<Rig, DescriptionError> {
    let rig = Rig::find("sim")?;
    let text: String = rig
        .text
        .lines()
        .map(|line| if line.starts_with("rgb = true") { "rgb = false" } else { line })
        .flat_map(|line| [line, "\n"])
        .collect();
    Rig::parse("the simulated rig without RGB", &text)
}

/// The world of a trial: nominal but for the picture and what is hidden.
fn world(trial: &Trial) -> Result<WorldDescription, serde_json::Error> {
    let effects: serde_json::Map<String, serde_json::Value> =
        trial.truth.effects.iter().map(|c| (c.id.clone(), c.description())).collect();
    let mut effects = serde_json::Value::Object(effects);
    if let Some(region) = &trial.truth.region {
        effects["region"] = json!(region);
    }
    serde_json::from_value(json!({ "print": { "picture": trial.picture }, "effects": effects }))
}

/// What the diagnosis says of a session, of which it knows nothing else. A session that cannot be
/// diagnosed is answered with nothing, which is then judged as such.
fn answer(root: &Path, options: &Options) -> Result<Answer, ProveError> {
    let session = Session::open(root)?;
    let frames = session.manifest().streams.iter().filter(|s| s.kind == StreamKind::Frames);
    for stream in frames.map(|stream| stream.name.clone()) {
        let request = TrackRequest { stream, rig: None, force: false };
        // A tag that is not found is a property of the session, not a failure of the trial.
        let _ = pipeline::track(&session, &request, &mut |_, _| {});
    }
    let _ = pipeline::sync(&session, false);
    // Without a scene the light comes from the camera's own frames.
    let _ = pipeline::scene(&session, false, &mut |_, _| {});
    let Some(baseline) = pipeline::default_baseline(&session) else {
        return Ok(Answer::default());
    };
    let request =
        DiagnoseRequest { real: "real".into(), baseline, options: *options, force: false };
    let diagnosis = match pipeline::diagnose(&session, &request, &mut |_| {}) {
        Ok((diagnosis, _)) => diagnosis,
        Err(PipelineError::Diagnose { .. }) => return Ok(Answer::default()),
        Err(error) => return Err(error.into()),
    };
    let path = root.join("derived/diagnose/diagnosis.json");
    let invalid = |error| ProveError::Io {
        path,
        source: std::io::Error::new(std::io::ErrorKind::InvalidData, error),
    };
    // Through JSON, as any consumer reads it.
    let value = serde_json::to_value(&diagnosis);
    value.and_then(serde_json::from_value).map_err(invalid)
}

fn clear(root: &Path) -> Result<(), ProveError> {
    match std::fs::remove_dir_all(root) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(ProveError::Io { path: root.to_owned(), source: error })
        }
        _ => Ok(()),
    }
}
