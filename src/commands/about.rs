//! `completions` and `man`: made from the same definitions as `--help`.

use super::{Ending, Output};
use crate::cli::{CompletionsArgs, ManArgs};
use anyhow::Context;
use std::io::Write;

pub(super) fn completions(
    args: &CompletionsArgs,
    cli: &mut clap::Command,
) -> anyhow::Result<Ending> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, cli, "evrig", &mut script);
    // A closed pipe is the reader's choice.
    let _ = std::io::stdout().write_all(&script);
    Ok(Ending::Done)
}

pub(super) fn man(args: &ManArgs, cli: clap::Command, output: &Output) -> anyhow::Result<Ending> {
    let directory = &args.directory;
    std::fs::create_dir_all(directory)
        .and_then(|()| clap_mangen::generate_to(cli, directory))
        .with_context(|| format!("cannot write man pages into {}", directory.display()))?;
    output.say(format_args!("man pages are in {}", directory.display()));
    Ok(Ending::Done)
}
