//! What is to be recorded, and how it went.

use crate::Finding;
use evrig_session::rig::Rig;
use evrig_session::trajectory::{ToolPath, Trajectory};
use evrig_session::{Manifest, SessionError};
use std::time::Duration;

/// Who answers the prompts of a path.
///
/// Polled with the same text until it returns true; only the arm waits meanwhile.
#[derive(Clone, Copy, Default)]
pub struct Prompts<'a>(pub(super) Option<&'a dyn Fn(&str) -> bool>);

impl<'a> Prompts<'a> {
    /// Asked of this.
    #[must_use]
    pub fn to(ask: &'a dyn Fn(&str) -> bool) -> Self {
        Self(Some(ask))
    }
}

impl std::fmt::Debug for Prompts<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.0.is_some() { "Prompts(asked)" } else { "Prompts(passed over)" })
    }
}

/// Rests before and behind the path, on top of those that the trajectory states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dwells {
    /// Cameras run, the arm has not begun.
    pub lead_in: Duration,
    /// The arm has ended, cameras run on.
    pub tail: Duration,
}

impl Default for Dwells {
    fn default() -> Self {
        Self { lead_in: Duration::from_millis(500), tail: Duration::from_millis(500) }
    }
}

/// What is to be recorded.
#[derive(Debug, Clone, Copy)]
pub struct RecordRequest<'a> {
    /// The rig, for the manifest.
    pub rig: &'a Rig,
    /// The trajectory, for the manifest.
    pub trajectory: &'a Trajectory,
    /// The trajectory on that rig.
    pub path: &'a ToolPath,
    /// The session's directory; it must be missing or empty.
    pub out: &'a std::path::Path,
    /// Rests around the path.
    pub dwells: Dwells,
    /// Who answers the path's prompts; without anybody they are passed over.
    pub prompts: Prompts<'a>,
}

/// How a recording went.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordOutcome {
    /// The sealed manifest.
    pub manifest: Manifest,
    /// Why it ended before its end; none when it did not.
    pub cut_short: Option<String>,
    /// Whether the operator wanted that.
    pub is_asked_for: bool,
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A check failed; nothing moved, no file was made.
    #[error(
        "not ready: {}",
        .0.iter().map(|f| format!("{}: \
            {}", f.subject, f.description)).collect::<Vec<_>>().join("; ")
    )]
    NotReady(Vec<Finding>),
    /// The files cannot be made or sealed.
    #[error(transparent)]
    Session(#[from] SessionError),
}
