//! `completions` and `man`: generated documentation of the command line.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `evrig completions`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  evrig completions bash > /etc/bash_completion.d/evrig\n  \
    evrig completions zsh > ~/.zfunc/_evrig")]
pub struct CompletionsArgs {
    /// The shell to complete for
    pub shell: clap_complete::Shell,
}

/// Arguments of `evrig man`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  evrig man ~/.local/share/man/man1")]
pub struct ManArgs {
    /// Directory for evrig.1 and one page per command; created if missing
    pub directory: PathBuf,
}
