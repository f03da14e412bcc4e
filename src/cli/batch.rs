//! Options of `process` and `compare` for datasets, on this machine or on Slurm.

use clap::{Args, ValueEnum};

/// Where the sessions of a dataset are processed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// On this machine, one after another
    #[default]
    Local,
    /// On a cluster: an array job with one task per session
    Slurm,
}

/// What no two parts of a dataset have in common.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum SplitByArg {
    /// A recording
    #[default]
    Recording,
    /// An image
    Stimulus,
}

/// Where sessions are processed, and the resources of a task.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Datasets")]
pub struct EngineArgs {
    /// Where: on this machine, or on Slurm
    #[arg(long, value_enum, default_value = "local")]
    pub engine: Engine,

    /// Slurm: processors per task
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    pub cpus: u32,

    /// Slurm: memory per task, in the format of sbatch
    #[arg(long, value_name = "SIZE", default_value = "8G")]
    pub memory: String,

    /// Slurm: time limit per task, in the format of sbatch
    #[arg(long, value_name = "TIME", default_value = "04:00:00")]
    pub time_limit: String,

    /// Slurm: concurrent tasks
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub max_tasks: Option<u32>,

    /// Slurm: attempts for a task that a node failure or a signal ended
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=10))]
    pub attempts: u32,

    /// Slurm: a further option of sbatch, as --sbatch=--partition=long; may be given several times
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub sbatch: Vec<String>,
}

/// How a dataset is processed.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Datasets")]
pub struct BatchArgs {
    /// Show the outcome of each session and the state of its Slurm task
    #[arg(long)]
    pub status: bool,

    /// Only sessions that failed, were interrupted, or were never processed
    #[arg(long)]
    pub only_failed: bool,

    /// Parts of the dataset and their shares
    #[arg(long, value_name = "NAME=SHARE,...", default_value = "train=0.8,val=0.1,test=0.1")]
    pub splits: String,

    /// What no two parts share: a recording, or a displayed image (all its recordings stay in one
    /// part)
    #[arg(long, value_enum, default_value = "recording")]
    pub split_by: SplitByArg,

    /// Seed of the splits
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    pub split_seed: u64,

    /// Where sessions are processed.
    #[command(flatten)]
    pub engine: EngineArgs,

    /// Process the session with this number; run by a task of the array job
    #[arg(long, hide = true, value_name = "N", conflicts_with_all = ["gather", "status"])]
    pub task: Option<usize>,

    /// Write index, card, comparison and report; run by the job after the array
    #[arg(long, hide = true, conflicts_with = "status")]
    pub gather: bool,
}
