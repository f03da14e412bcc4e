//! What `process` takes beside a session: datasets, here or on Slurm.

use clap::{Args, ValueEnum};

/// Where the sessions of a dataset are processed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// Here, one after another
    #[default]
    Local,
    /// On a cluster: an array job, a task a session
    Slurm,
}

/// What no two parts of a dataset share.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum SplitByArg {
    /// A recording
    #[default]
    Recording,
    /// A picture
    Stimulus,
}

/// Where sessions are worked on, and what a task may use.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Datasets")]
pub struct EngineArgs {
    /// Where: here, or on Slurm
    #[arg(long, value_enum, default_value = "local")]
    pub engine: Engine,

    /// Slurm: processors a task
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    pub cpus: u32,

    /// Slurm: memory a task, as sbatch takes it
    #[arg(long, value_name = "SIZE", default_value = "8G")]
    pub memory: String,

    /// Slurm: time a task, as sbatch takes it
    #[arg(long, value_name = "TIME", default_value = "04:00:00")]
    pub time_limit: String,

    /// Slurm: tasks at once
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub max_tasks: Option<u32>,

    /// Slurm: how often a task is tried that a node or a signal cut off
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=10))]
    pub attempts: u32,

    /// Slurm: one more option of sbatch, as --sbatch=--partition=long; may be given several times
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub sbatch: Vec<String>,
}

/// How a dataset is processed.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Datasets")]
pub struct BatchArgs {
    /// Say what became of each session, and what Slurm is doing
    #[arg(long)]
    pub status: bool,

    /// Only the sessions that failed, were cut off, or were never processed
    #[arg(long)]
    pub only_failed: bool,

    /// Parts of the dataset and their shares
    #[arg(long, value_name = "NAME=SHARE,...", default_value = "train=0.8,val=0.1,test=0.1")]
    pub splits: String,

    /// What no two parts share: a recording, or a picture that was shown (all its recordings stay together)
    #[arg(long, value_enum, default_value = "recording")]
    pub split_by: SplitByArg,

    /// Seed of the splits: another one shares out anew
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    pub split_seed: u64,

    /// Where.
    #[command(flatten)]
    pub engine: EngineArgs,

    /// The session of this number; what a task of the array job runs
    #[arg(long, hide = true, value_name = "N", conflicts_with_all = ["gather", "status"])]
    pub task: Option<usize>,

    /// Index, card, comparison and report; what the job behind the array runs
    #[arg(long, hide = true, conflicts_with = "status")]
    pub gather: bool,
}
