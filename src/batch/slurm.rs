//! A dataset on Slurm: an array job with one task per session, and a job after it that gathers.
//!
//! Slurm does the scheduling. This module writes two scripts into `batch/slurm`, submits them with
//! `sbatch`, and reads `squeue`. A task writes its session's outcome last, so a task without an
//! outcome was interrupted; the gathering job submits it again up to the given number of attempts.

mod queue;
mod script;

pub use queue::JobState;

use super::BatchError;
use evrig_session::write_whole;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Tasks of one array: Slurm's own limit unless `MaxArraySize` states another.
const MAX_ARRAY: usize = 1000;

/// What a task may use.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resources {
    /// Processors, which are the threads it uses.
    pub cpus: u32,
    /// Memory as `sbatch --mem` takes it.
    pub memory: String,
    /// Time as `sbatch --time` takes it.
    pub time_limit: String,
    /// Tasks that run at once; none for as many as Slurm lets.
    pub max_tasks: Option<u32>,
    /// More options of `sbatch`, as `--partition=long`.
    pub options: Vec<String>,
}

/// What was submitted: `batch/slurm/job.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlurmJob {
    /// `evrig.slurm-job/1`.
    pub schema: String,
    /// The sessions; a task's number is its session's place here.
    pub sessions: Vec<String>,
    /// The arrays, each with the place of its first session.
    pub arrays: Vec<(u64, usize)>,
    /// The job that gathers.
    pub gather: Option<u64>,
    /// Which attempt this is, from 1.
    pub attempt: u32,
    /// How often a task that was cut off is tried.
    pub max_attempts: u32,
    /// The arguments that every task is given.
    pub arguments: Vec<String>,
    /// What a task may use.
    pub resources: Resources,
}

/// A dataset's place on Slurm.
#[derive(Debug, Clone)]
pub struct Slurm {
    root: PathBuf,
    program: PathBuf,
}

impl Slurm {
    /// The dataset at `root`, processed by this very program.
    ///
    /// # Errors
    /// When the dataset or the program cannot be found.
    pub fn new(root: &Path) -> Result<Self, BatchError> {
        let root = root.canonicalize().map_err(BatchError::io(root))?;
        let program = crate::program::program().map_err(BatchError::io(Path::new("evrig")))?;
        Ok(Self { root, program })
    }

    fn folder(&self) -> PathBuf {
        self.root.join("batch/slurm")
    }

    /// Submits the job's sessions and the job that gathers; gives what was submitted, with its
    /// numbers.
    ///
    /// # Errors
    /// When the scripts cannot be written, or `sbatch` refuses.
    pub fn submit(&self, mut job: SlurmJob) -> Result<SlurmJob, BatchError> {
        let logs = self.folder().join("logs");
        std::fs::create_dir_all(&logs).map_err(BatchError::io(&logs))?;
        let tasks = self.folder().join("tasks.sh");
        let gather = self.folder().join("gather.sh");
        write_whole(&tasks, script::tasks(&self.program, &self.root, &job).as_bytes())?;
        write_whole(&gather, script::gather(&self.program, &self.root, &job).as_bytes())?;
        job.arrays.clear();
        job.gather = None;
        // The tasks look their sessions up here, and may start before the numbers are known.
        self.write(&job)?;
        for first in (0..job.sessions.len()).step_by(MAX_ARRAY) {
            let n = (job.sessions.len() - first).min(MAX_ARRAY);
            let mut array = format!("--array=0-{}", n - 1);
            if let Some(max) = job.resources.max_tasks {
                array += &format!("%{max}");
            }
            let log = format!("--output={}", logs.join("%A_%a.log").display());
            let mut arguments = vec!["--parsable".to_owned(), array, log];
            arguments.extend(self.options(&job, "evrig"));
            arguments.extend([tasks.display().to_string(), first.to_string()]);
            let number = sbatch(&arguments)?;
            job.arrays.push((number, first));
            self.write(&job)?;
        }
        let numbers: Vec<String> = job.arrays.iter().map(|(id, _)| id.to_string()).collect();
        let mut arguments = vec![
            "--parsable".to_owned(),
            format!("--dependency=afterany:{}", numbers.join(":")),
            format!("--output={}", logs.join("gather-%j.log").display()),
        ];
        arguments.extend(self.options(&job, "evrig-gather"));
        arguments.push(gather.display().to_string());
        job.gather = Some(sbatch(&arguments)?);
        self.write(&job)?;
        Ok(job)
    }

    fn options(&self, job: &SlurmJob, name: &str) -> Vec<String> {
        let Resources { cpus, memory, time_limit, options, .. } = &job.resources;
        let mut all = vec![
            format!("--job-name={name}"),
            format!("--chdir={}", self.root.display()),
            format!("--cpus-per-task={cpus}"),
            format!("--mem={memory}"),
            format!("--time={time_limit}"),
        ];
        all.extend(options.iter().cloned());
        all
    }

    fn write(&self, job: &SlurmJob) -> Result<(), BatchError> {
        let path = self.folder().join("job.json");
        let text = serde_json::to_string_pretty(job)
            .map_err(|e| BatchError::Malformed { path: path.clone(), what: e.to_string() })?;
        Ok(write_whole(&path, text.as_bytes())?)
    }

    /// Replaces the record of a job that Slurm did not accept by the former one.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn withdraw(&self, former: Option<&SlurmJob>) -> Result<(), BatchError> {
        let path = self.folder().join("job.json");
        match former {
            Some(job) => self.write(job),
            None => std::fs::remove_file(&path).map_err(BatchError::io(&path)),
        }
    }

    /// The state of each of a job's sessions, as far as Slurm still knows of it.
    ///
    /// # Errors
    /// When `squeue` does not answer.
    pub fn states(&self, job: &SlurmJob) -> Result<BTreeMap<String, JobState>, BatchError> {
        let mut states = BTreeMap::new();
        for (number, first) in &job.arrays {
            for (task, state) in queue::tasks(*number)? {
                if let Some(session) = job.sessions.get(first + task) {
                    states.insert(session.clone(), state);
                }
            }
        }
        Ok(states)
    }

    /// Whether tasks of the job, or the one that gathers, wait or run.
    ///
    /// # Errors
    /// When `squeue` does not answer.
    pub fn is_under_way(&self, job: &SlurmJob) -> Result<bool, BatchError> {
        if self.states(job)?.values().any(|state| state.is_under_way()) {
            return Ok(true);
        }
        let gather = job.gather.map(queue::job).transpose()?.flatten();
        Ok(gather.is_some_and(|state| state.is_under_way()))
    }
}

/// What was last submitted for a dataset; none when nothing was.
///
/// # Errors
/// When its record cannot be understood.
pub fn read_job(root: &Path) -> Result<Option<SlurmJob>, BatchError> {
    let path = root.join("batch/slurm/job.json");
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(BatchError::io(&path)(error)),
    };
    let job = serde_json::from_str(&text);
    job.map(Some).map_err(|error| BatchError::Malformed {
        path,
        what: format!("not a job's record: {error}; remove it when no job of it runs"),
    })
}

/// Refuses to work on a dataset of which Slurm still runs jobs.
pub(super) fn refuse_if_under_way(root: &Path) -> Result<(), BatchError> {
    let Some(job) = read_job(root)? else { return Ok(()) };
    if !Slurm::new(root)?.is_under_way(&job).unwrap_or(false) {
        return Ok(());
    }
    let numbers = job.arrays.iter().map(|(id, _)| *id).chain(job.gather);
    let jobs: Vec<String> = numbers.map(|id| id.to_string()).collect();
    let whom = format!(
        "Slurm (jobs {}); --status shows them, `scancel {}` ends them",
        jobs.join(", "),
        jobs.join(" ")
    );
    Err(BatchError::Busy { path: root.to_owned(), whom })
}

fn sbatch(arguments: &[String]) -> Result<u64, BatchError> {
    let message = run("sbatch", arguments)?;
    // `--parsable` prints the number, with `;cluster` behind it on a federation.
    let number = message.trim().split(';').next().unwrap_or_default().parse();
    number.map_err(|_| BatchError::Slurm {
        command: "sbatch".into(),
        what: format!("expected a job's number, got `{}`", message.trim()),
    })
}

fn run(program: &str, arguments: &[String]) -> Result<String, BatchError> {
    let failed = |what: String| BatchError::Slurm { command: program.to_owned(), what };
    let output = Command::new(program).args(arguments).output().map_err(|error| {
        failed(format!("{error}; is this a machine from which Slurm jobs can be submitted?"))
    })?;
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(failed(String::from_utf8_lossy(&output.stderr).trim().replace('\n', "; ")))
    }
}
