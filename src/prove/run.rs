//! Runs trials: make, seal, diagnose blind, open, judge, record.

use super::error::ProveError;
use super::figure::figure;
use super::judge::{Judgement, judge};
use super::make::{SessionMaker, clear};
use super::record::{self, DiagnosisOutcome, ProofFolderError, TrialRecord};
use super::score::ProofScore;
use super::seal::{open, read_seal, seal};
use super::table::markdown;
use super::truth::{ConcealedTrial, Family, SealedTruth};
use evrig_session::Session;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A run of concealed trials.
#[derive(Clone, Copy)]
pub struct ProofRun<'a> {
    /// Where sessions, truths, records and the score go; truths in a folder apart from the
    /// sessions.
    pub out: &'a Path,
    /// Diagnoses the session at a path; it gets nothing else.
    pub ask: &'a dyn Fn(&Path) -> DiagnosisOutcome,
    /// Whether a session is removed after it is judged.
    pub is_tidy: bool,
    /// Heading of the score page.
    pub heading: &'a str,
}

/// All trials of a family, judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proof {
    /// `evrig.proof/2`.
    pub schema: String,
    /// Whose sessions.
    pub family: Family,
    /// Effects found in the unmodified recording; they count neither as right nor as wrong.
    pub known: BTreeSet<String>,
    /// Everything counted.
    pub score: ProofScore,
    /// Trial by trial.
    pub judgements: Vec<Judgement>,
}

/// A trial on disk.
struct TrialJob<'a> {
    name: String,
    session: PathBuf,
    truth: PathBuf,
    /// How its session is made; none when it is there.
    make: Option<(&'a SessionMaker, &'a ConcealedTrial)>,
}

/// The name of the recording without anything hidden in it.
const AS_IT_IS: &str = "as-it-is";

impl ProofRun<'_> {
    /// Runs trials of one family; `progress` receives the current step, and how many are done.
    /// Trials that have a record are not run again but judged from it.
    ///
    /// # Errors
    /// When a session cannot be made, a seal does not hold, or the disk refuses. A diagnosis that
    /// fails on its session, or does not end in time, is an answer: none.
    pub fn run(
        &self,
        maker: &SessionMaker,
        trials: &[ConcealedTrial],
        progress: &mut dyn FnMut(&str, usize),
    ) -> Result<Proof, ProveError> {
        let family = maker.family();
        let mut known = BTreeSet::new();
        if family == Family::Plasmode {
            // Through the same writer as the changed ones, so that nothing but the effect differs.
            let plain = ConcealedTrial {
                name: format!("{}-{AS_IT_IS}", family.as_str()),
                family,
                image: String::new(),
                trajectory: String::new(),
                seed: 0,
                truth: SealedTruth::nothing(),
            };
            let record =
                self.claim_folder(&self.job(maker, &plain), &mut |what| progress(what, 0))?;
            for named in answer(&record)?.effects {
                known.extend(std::iter::once(named.id).chain(named.indistinguishable));
            }
        }
        let jobs: Vec<TrialJob<'_>> = trials.iter().map(|trial| self.job(maker, trial)).collect();
        self.judge_all(family, known, &jobs, progress)
    }

    /// Judges sealed sessions that were made elsewhere; they are kept.
    ///
    /// # Errors
    /// As [`ProofRun::run`].
    pub fn run_prepared(
        &self,
        ready: &PreparedTrials,
        progress: &mut dyn FnMut(&str, usize),
    ) -> Result<Proof, ProveError> {
        let kept = Self { is_tidy: false, ..*self };
        kept.judge_all(Family::ThirdParty, BTreeSet::new(), &ready.0, progress)
    }

    fn job<'a>(&self, maker: &'a SessionMaker, trial: &'a ConcealedTrial) -> TrialJob<'a> {
        TrialJob {
            name: trial.name.clone(),
            session: self.out.join("sessions").join(&trial.name),
            truth: self.out.join("truth").join(format!("{}.json", trial.name)),
            make: Some((maker, trial)),
        }
    }

    fn judge_all(
        &self,
        family: Family,
        known: BTreeSet<String>,
        jobs: &[TrialJob<'_>],
        progress: &mut dyn FnMut(&str, usize),
    ) -> Result<Proof, ProveError> {
        let mut proof = Proof {
            schema: "evrig.proof/2".into(),
            family,
            known,
            score: ProofScore::default(),
            judgements: Vec::new(),
        };
        for (done, job) in jobs.iter().enumerate() {
            let record = self.claim_folder(job, &mut |what| progress(what, done))?;
            let judgement = judge(&record, &answer(&record)?, &proof.known);
            proof.judgements.push(judgement);
            proof.score = ProofScore::of(&proof.judgements);
            self.write(&proof)?;
        }
        Ok(proof)
    }

    /// The score so far: a run that is broken off has lost the trial it was at and no other.
    fn write(&self, proof: &Proof) -> Result<(), ProofFolderError> {
        let path =
            |suffix: &str| self.out.join(format!("proof-{}.{suffix}", proof.family.as_str()));
        record::write(&path("json"), proof)?;
        if let Some(image) = figure(&proof.score) {
            record::write_text(&path("svg"), &image)?;
        }
        record::write_text(&path("md"), &markdown(self.heading, &proof.score, &proof.judgements))
    }

    /// A trial's record: the one that is there, or a new one.
    fn claim_folder(
        &self,
        job: &TrialJob<'_>,
        progress: &mut dyn FnMut(&str),
    ) -> Result<TrialRecord, ProveError> {
        let path = self.out.join("trials").join(format!("{}.json", job.name));
        if let Some(record) = record::read(&path)? {
            return Ok(record);
        }
        let seal_path = job.session.join("seal.json");
        let begun = Instant::now();
        // A session that was sealed before the run was broken off is not made again.
        if let Some((maker, trial)) = job.make.filter(|_| !seal_path.exists()) {
            progress(&format!("{}: making the session", job.name));
            maker.make(trial, &job.session)?;
            seal(&trial.truth, &job.truth, &seal_path)?;
        }
        let made_s = begun.elapsed().as_secs_f64();
        progress(&format!("{}: diagnosing", job.name));
        let size = Session::open(&job.session)?.size();
        let begun = Instant::now();
        let outcome = (self.ask)(&job.session);
        let diagnosed_s = begun.elapsed().as_secs_f64();
        // Only now is the truth looked at, and only if it is the one that was sealed.
        let truth = open(&job.truth, &seal_path)?;
        let record = TrialRecord {
            schema: "evrig.trial/1".into(),
            trial: job.name.clone(),
            truth,
            truth_sha256: read_seal(&seal_path)?.truth_sha256,
            sensor_px: size.map_or([0, 0], |size| [size.width, size.height]),
            made_s,
            diagnosed_s,
            outcome,
        };
        record::write(&path, &record)?;
        if self.is_tidy {
            clear(&job.session)?;
        }
        Ok(record)
    }
}

fn answer(record: &TrialRecord) -> Result<super::answer::DiagnosisAnswer, ProveError> {
    let answer = record.outcome.answer();
    answer.map_err(|source| ProveError::Answer { trial: record.trial.clone(), source })
}

/// Sealed sessions made elsewhere, by name; at least one.
pub struct PreparedTrials(Vec<TrialJob<'static>>);

impl PreparedTrials {
    /// Those of a folder that holds `sessions/NAME` with a seal in each, and `truth/NAME.json`.
    ///
    /// # Errors
    /// When none is there or the system refuses.
    pub fn find(folder: &Path) -> Result<Self, ProveError> {
        let sessions = folder.join("sessions");
        let io = |source| ProveError::Io { path: sessions.clone(), source };
        let none = || ProveError::NoneReady { path: folder.to_owned() };
        let entries = std::fs::read_dir(&sessions).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => none(),
            _ => io(source),
        })?;
        let mut names = Vec::new();
        for entry in entries {
            let entry = entry.map_err(io)?;
            if entry.path().join("seal.json").exists() {
                names.push(entry.file_name().to_string_lossy().into_owned());
            }
        }
        names.sort();
        if names.is_empty() {
            return Err(none());
        }
        let job = |name: String| TrialJob {
            session: sessions.join(&name),
            truth: folder.join("truth").join(format!("{name}.json")),
            make: None,
            name,
        };
        Ok(Self(names.into_iter().map(job).collect()))
    }

    /// How many.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

#[cfg(test)]
mod tests;
