//! `guard`: the process that owns the arm's port; started by evrig itself.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig guard`.
#[derive(Debug, Args)]
pub struct GuardArgs {
    /// The arm's serial port
    pub port: PathBuf,
}
