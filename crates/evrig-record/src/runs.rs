//! A series of recordings: a list in their directory that knows which are done.
//!
//! The list, `runs.json`, is written anew after each run, whole or not at all, so a series can be
//! taken up again after a crash. A run that did not end as it should keeps its directory and its
//! place in the list; the run is made again in another.

use evrig_session::rig::Rig;
use evrig_session::trajectory::Trajectory;
use evrig_session::{
    Manifest, SessionError, SessionStatus, Sha256Hex, sha256_of_bytes, write_whole,
};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The list's schema.
pub const RUNS_SCHEMA: &str = "evrig.runs/1";

/// More recordings than anyone makes in a row.
const MAX_RUNS: u32 = 100_000;

/// Why a series cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum RunsError {
    /// There is none.
    #[error("{}: {because}; start a series with --repeat N", path.display())]
    None {
        /// The list.
        path: PathBuf,
        /// The system's or the parser's reason.
        because: String,
    },
    /// There is one already.
    #[error("{} is there already; continue with --resume, or choose another --out", path.display())]
    Received {
        /// The list.
        path: PathBuf,
    },
    /// It is of something else.
    #[error(
        "{}: the series was begun with another {what}; use the same, or choose another --out",
        path.display()
    )]
    Other {
        /// The list.
        path: PathBuf,
        /// Rig or trajectory.
        what: &'static str,
    },
    /// No series is so long.
    #[error("--repeat {n}: expected 1 to {MAX_RUNS}")]
    Number {
        /// What was asked for.
        n: u32,
    },
    /// The disk refused.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// A series of runs of one trajectory on one rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunList {
    path: PathBuf,
    file: RunListFile,
}

/// The contents of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct RunListFile {
    schema: String,
    rig: String,
    rig_sha256: Sha256Hex,
    trajectory: String,
    trajectory_sha256: Sha256Hex,
    n_runs: u32,
    attempts: Vec<RunAttempt>,
}

/// One recording of a series.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunAttempt {
    /// Which run, from 1.
    pub run: u32,
    /// Its directory beside the list.
    pub directory: String,
    /// How it ended; none while it runs, or when the program died.
    pub status: Option<SessionStatus>,
}

impl RunList {
    /// Begins a series of `n_runs` in `directory`.
    ///
    /// # Errors
    /// When there is one already, or the disk refuses.
    pub fn begin(
        directory: &Path,
        n_runs: u32,
        rig: &Rig,
        trajectory: &Trajectory,
    ) -> Result<Self, RunsError> {
        if !(1..=MAX_RUNS).contains(&n_runs) {
            return Err(RunsError::Number { n: n_runs });
        }
        let path = directory.join("runs.json");
        if path.exists() {
            return Err(RunsError::Received { path });
        }
        std::fs::create_dir_all(directory).map_err(SessionError::io(directory))?;
        let file = RunListFile {
            schema: RUNS_SCHEMA.to_owned(),
            rig: rig.name.clone(),
            rig_sha256: sha256_of_bytes(rig.text.as_bytes()),
            trajectory: trajectory.name.clone(),
            trajectory_sha256: sha256_of_bytes(trajectory.text.as_bytes()),
            n_runs,
            attempts: Vec::new(),
        };
        let list = Self { path, file };
        list.write()?;
        Ok(list)
    }

    /// Takes up the series in `directory`, of the same rig and trajectory.
    ///
    /// # Errors
    /// When there is none, it is of something else, or a session of it cannot be read.
    pub fn resume(directory: &Path, rig: &Rig, trajectory: &Trajectory) -> Result<Self, RunsError> {
        let path = directory.join("runs.json");
        let none = |because: String| RunsError::None { path: path.clone(), because };
        let text = std::fs::read_to_string(&path).map_err(|error| none(error.to_string()))?;
        let file: RunListFile =
            serde_json::from_str(&text).map_err(|error| none(error.to_string()))?;
        if file.schema != RUNS_SCHEMA {
            return Err(none(format!("schema is `{}`, expected `{RUNS_SCHEMA}`", file.schema)));
        }
        let same = |sha256: &Sha256Hex, text: &str| *sha256 == sha256_of_bytes(text.as_bytes());
        if !same(&file.rig_sha256, &rig.text) {
            return Err(RunsError::Other { path, what: "rig" });
        }
        if !same(&file.trajectory_sha256, &trajectory.text) {
            return Err(RunsError::Other { path, what: "trajectory" });
        }
        let mut list = Self { path, file };
        list.look_at_unknown(directory);
        Ok(list)
    }

    /// A run that was sealed just before the program died is known by its session.
    fn look_at_unknown(&mut self, directory: &Path) {
        for attempt in self.file.attempts.iter_mut().filter(|attempt| attempt.status.is_none()) {
            let manifest = directory.join(&attempt.directory).join("session.json");
            attempt.status = Manifest::read(&manifest).ok().map(|manifest| manifest.status);
        }
    }

    /// How many runs there are to be.
    #[must_use]
    pub fn n_runs(&self) -> u32 {
        self.file.n_runs
    }

    /// All recordings so far.
    #[must_use]
    pub fn attempts(&self) -> &[RunAttempt] {
        &self.file.attempts
    }

    /// Number of the first run that no recording has completed.
    #[must_use]
    pub fn next_run(&self) -> Option<u32> {
        let is_complete = |run: u32| {
            let mut attempts = self.file.attempts.iter();
            attempts.any(|attempt| {
                attempt.run == run && attempt.status == Some(SessionStatus::Complete)
            })
        };
        (1..=self.file.n_runs).find(|run| !is_complete(*run))
    }

    /// Enters a new recording of a run; its directory, which is free.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn enter(&mut self, run: u32) -> Result<PathBuf, RunsError> {
        let root = self.path.parent().unwrap_or(Path::new(".")).to_owned();
        let width = self.file.n_runs.to_string().len().max(2);
        let stem = format!("{}-{run:0width$}", self.file.trajectory);
        let names = (1_u32..).map(|attempt| match attempt {
            1 => stem.clone(),
            attempt => format!("{stem}-again-{attempt}"),
        });
        let name = names.into_iter().find(|name| !root.join(name).exists()).unwrap_or(stem.clone());
        self.file.attempts.push(RunAttempt { run, directory: name.clone(), status: None });
        self.write()?;
        Ok(root.join(name))
    }

    /// Notes how the recording that was entered last ended.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn close(&mut self, status: SessionStatus) -> Result<(), RunsError> {
        if let Some(last) = self.file.attempts.last_mut() {
            last.status = Some(status);
        }
        self.write()
    }

    fn write(&self) -> Result<(), RunsError> {
        let text = serde_json::to_string_pretty(&self.file).map_err(|error| RunsError::None {
            path: self.path.clone(),
            because: error.to_string(),
        })?;
        Ok(write_whole(&self.path, text.as_bytes())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described() -> (Rig, Trajectory) {
        (Rig::simulated().unwrap(), Trajectory::find("circle").unwrap())
    }

    #[test]
    fn a_series_is_taken_up_at_the_first_run_that_is_not_complete() {
        let (rig, trajectory) = described();
        let folder = tempfile::tempdir().unwrap();
        let mut list = RunList::begin(folder.path(), 3, &rig, &trajectory).unwrap();
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        let first = list.enter(1).unwrap();
        assert_eq!(name(&first), "circle-01");
        std::fs::create_dir(&first).unwrap();
        list.close(SessionStatus::Complete).unwrap();
        let second = list.enter(2).unwrap();
        std::fs::create_dir(&second).unwrap();
        list.close(SessionStatus::Aborted).unwrap();
        let mut again = RunList::resume(folder.path(), &rig, &trajectory).unwrap();
        assert_eq!(again, list);
        assert_eq!(again.next_run(), Some(2));
        assert_eq!(name(&again.enter(2).unwrap()), "circle-02-again-2");
        again.close(SessionStatus::Complete).unwrap();
        again.enter(3).unwrap();
        // The program dies here; nothing was sealed.
        let again = RunList::resume(folder.path(), &rig, &trajectory).unwrap();
        assert_eq!(again.next_run(), Some(3));
    }

    #[test]
    fn a_series_goes_on_with_the_same_rig_and_trajectory_only() {
        let (rig, trajectory) = described();
        let folder = tempfile::tempdir().unwrap();
        let none = RunList::resume(folder.path(), &rig, &trajectory).unwrap_err();
        assert!(none.to_string().contains("--repeat"), "{none}");
        RunList::begin(folder.path(), 2, &rig, &trajectory).unwrap();
        let taken = RunList::begin(folder.path(), 2, &rig, &trajectory).unwrap_err();
        assert!(taken.to_string().contains("--resume"), "{taken}");
        let line = Trajectory::find("line").unwrap();
        let other = RunList::resume(folder.path(), &rig, &line).unwrap_err();
        assert!(matches!(other, RunsError::Other { what: "trajectory", .. }), "{other}");
    }
}
