//! `completions` and `man`: the program about itself.

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
    /// Directory for evrig.1 and one page a verb; made if it is missing
    pub directory: PathBuf,
}
