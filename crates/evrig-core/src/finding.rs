//! What a check found: of a device before a recording, or of a session's files afterwards.

use serde::{Deserialize, Serialize};

/// How a finding bears on what was checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As it should be.
    Good,
    /// Possibly acceptable; a person should decide.
    Doubt,
    /// A device must not be used, or a session's claim is wrong.
    Bad,
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// What was checked: a file, a stream, or a part of a device (`port`, `identity`, `homed`).
    pub subject: String,
    /// How it bears on what was checked.
    pub verdict: Verdict,
    /// What was expected and found and, unless it is good, what to do.
    pub description: String,
}

impl Finding {
    fn new(subject: impl Into<String>, verdict: Verdict, description: impl Into<String>) -> Self {
        Self { subject: subject.into(), verdict, description: description.into() }
    }

    /// A finding of [`Verdict::Good`].
    #[must_use]
    pub fn good(subject: impl Into<String>, description: impl Into<String>) -> Self {
        Self::new(subject, Verdict::Good, description)
    }

    /// A finding of [`Verdict::Doubt`].
    #[must_use]
    pub fn doubt(subject: impl Into<String>, description: impl Into<String>) -> Self {
        Self::new(subject, Verdict::Doubt, description)
    }

    /// A finding of [`Verdict::Bad`].
    #[must_use]
    pub fn bad(subject: impl Into<String>, description: impl Into<String>) -> Self {
        Self::new(subject, Verdict::Bad, description)
    }

    /// Whether the verdict is not [`Verdict::Bad`].
    #[must_use]
    pub fn holds(&self) -> bool {
        self.verdict != Verdict::Bad
    }
}
