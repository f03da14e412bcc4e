//! Where a recording is.

use serde::Serialize;

/// Where a recording is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordState {
    /// All devices are checked; nothing moves.
    Preflight,
    /// Cameras are set up, and the arm goes to its start.
    StartPose,
    /// Cameras start; their first samples are awaited.
    Cameras,
    /// Cameras run while the arm rests before the path.
    LeadIn,
    /// The arm moves.
    Trajectory,
    /// Cameras run while the arm rests behind the path.
    Tail,
    /// Samples still under way are written.
    Drain,
    /// The files are counted and the manifest is written.
    Seal,
}

impl std::fmt::Display for RecordState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Preflight => "preflight",
            Self::StartPose => "start pose",
            Self::Cameras => "cameras",
            Self::LeadIn => "lead-in",
            Self::Trajectory => "trajectory",
            Self::Tail => "tail",
            Self::Drain => "drain",
            Self::Seal => "seal",
        })
    }
}
