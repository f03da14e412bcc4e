//! Output: results on stdout, everything else on stderr.

use crate::cli::GlobalArgs;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::fmt::Display;
use std::io::{IsTerminal, Write};
use std::time::Duration;

/// The output that the user asked for.
#[derive(Debug, Clone, Copy)]
pub struct Output {
    global: GlobalArgs,
}

/// Marks an error as the caller's: wrong arguments or a wrong description file (exit code 2).
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WrongUse(pub String);

/// An error with its causes in a line, each stated once.
#[must_use]
pub fn error_text(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut printed = text.clone();
    for cause in std::iter::successors(error.source(), |cause| cause.source()) {
        let cause = cause.to_string();
        if !printed.contains(&cause) {
            text += &format!(": {cause}");
            printed = cause;
        }
    }
    text
}

// A closed pipe (`evrig info | head`) is the reader's choice, so a failed write is not an error.
impl Output {
    pub(super) fn new(global: GlobalArgs) -> Self {
        Self { global }
    }

    /// Prints a command's result: as JSON when asked for, else as `text` for people.
    ///
    /// # Errors
    /// When the value cannot be written as JSON.
    pub fn result(&self, value: &impl Serialize, text: impl Display) -> anyhow::Result<()> {
        let mut stdout = std::io::stdout().lock();
        let _ = if self.global.json {
            writeln!(stdout, "{}", serde_json::to_string_pretty(value)?)
        } else {
            writeln!(stdout, "{text}")
        };
        Ok(())
    }

    /// A remark on stderr, unless `--quiet`.
    pub fn say(&self, text: impl Display) {
        if !self.global.quiet {
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    }

    /// A remark for those who asked for more (`-v`).
    pub fn detail(&self, text: impl Display) {
        if self.global.verbose > 0 {
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    }

    /// A loss or a doubt; printed even with `--quiet`.
    pub fn warn(&self, text: impl Display) {
        let _ = writeln!(std::io::stderr(), "warning: {text}");
    }

    /// The one error that ends a command, with its causes.
    pub fn error(&self, error: &anyhow::Error) {
        let _ = writeln!(std::io::stderr(), "error: {}", error_text(error.as_ref()));
    }

    /// A progress bar over `total` steps; shown on a terminal only, and only after a moment.
    #[must_use]
    pub fn progress(&self, what: &'static str, total: u64) -> ProgressBar {
        if self.global.quiet || !std::io::stderr().is_terminal() {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::new(total).with_message(what);
        if let Ok(style) =
            ProgressStyle::with_template("{msg:<12} {wide_bar} {percent:>3} % {eta:>5}")
        {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        bar
    }

    /// One line that is redrawn; shown on a terminal only.
    #[must_use]
    pub fn line(&self) -> ProgressBar {
        let bar = self.progress("", 0);
        bar.set_style(ProgressStyle::with_template("{msg}").unwrap_or_else(|_| bar.style()));
        bar
    }
}
