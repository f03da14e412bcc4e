//! States of jobs that run, wait, or ended recently, from `squeue`.

use super::{BatchError, run};

/// The state of a job or a task, as far as it matters here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// It waits for its turn.
    Pending,
    /// It runs.
    Running,
    /// It ended by itself.
    Ended,
    /// Somebody cancelled it.
    Cancelled,
    /// It ran out of time.
    OutOfTime,
    /// It ran out of memory.
    OutOfMemory,
    /// A node or a signal ended it.
    CutOff,
}

impl JobState {
    /// Whether it will still do something.
    #[must_use]
    pub const fn is_under_way(self) -> bool {
        matches!(self, Self::Pending | Self::Running)
    }

    fn parse(word: &str) -> Self {
        match word {
            "PENDING" | "REQUEUED" | "REQUEUE_HOLD" | "REQUEUE_FED" | "RESV_DEL_HOLD"
            | "SPECIAL_EXIT" => Self::Pending,
            "RUNNING" | "CONFIGURING" | "COMPLETING" | "RESIZING" | "SIGNALING" | "STAGE_OUT"
            | "STOPPED" | "SUSPENDED" => Self::Running,
            "COMPLETED" => Self::Ended,
            "CANCELLED" | "REVOKED" => Self::Cancelled,
            "TIMEOUT" | "DEADLINE" => Self::OutOfTime,
            "OUT_OF_MEMORY" => Self::OutOfMemory,
            _ => Self::CutOff,
        }
    }
}

impl std::fmt::Display for JobState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Pending => "waits",
            Self::Running => "runs",
            Self::Ended => "ended",
            Self::Cancelled => "cancelled",
            Self::OutOfTime => "out of time",
            Self::OutOfMemory => "out of memory",
            Self::CutOff => "cut off",
        })
    }
}

/// The tasks of an array with their states; none of one that Slurm has forgotten.
pub(super) fn tasks(array: u64) -> Result<Vec<(usize, JobState)>, BatchError> {
    let message = queue(array)?;
    Ok(message.lines().filter_map(parse).filter_map(|(task, state)| Some((task?, state))).collect())
}

/// The state of a job that is no array.
pub(super) fn job(number: u64) -> Result<Option<JobState>, BatchError> {
    Ok(queue(number)?.lines().find_map(parse).map(|(_, state)| state))
}

fn queue(number: u64) -> Result<String, BatchError> {
    let arguments = [
        "--noheader".to_owned(),
        "--array".into(),
        "--states=all".into(),
        "--format=%K|%T".into(),
        format!("--jobs={number}"),
    ];
    match run("squeue", &arguments) {
        // Slurm forgets a job some minutes after its end.
        Err(BatchError::Slurm { what, .. }) if what.contains("Invalid job id") => Ok(String::new()),
        message => message,
    }
}

/// `3|RUNNING`, or `N/A|PENDING` of a job that is no array.
fn parse(line: &str) -> Option<(Option<usize>, JobState)> {
    let (task, state) = line.trim().split_once('|')?;
    Some((task.parse().ok(), JobState::parse(state)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_squeue_are_read() {
        assert_eq!(parse("3|RUNNING"), Some((Some(3), JobState::Running)));
        assert_eq!(parse("N/A|PENDING"), Some((None, JobState::Pending)));
        assert_eq!(parse("12|NODE_FAIL"), Some((Some(12), JobState::CutOff)));
        assert_eq!(parse(""), None);
    }
}
