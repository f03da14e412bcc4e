//! Why there is no track.

use super::detect::FAMILIES;

/// Why there is no track.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// The rig names a family that the detector does not have.
    #[error("tag family `{0}` is not known; expected one of {known}", known = FAMILIES.join(", "))]
    UnknownFamily(String),
    /// A tag or a picture without size, a lens without focal length.
    #[error("the rig states {what}; a track needs a positive number")]
    BadRig {
        /// What is wrong.
        what: String,
    },
    /// No frame was shown.
    #[error("there are no frames to track the tag in")]
    NoFrames,
    /// No frame has a usable sighting, or too few are near each other for a path.
    #[error("{tag} makes no track in {seen} frames: {reasons}{also}")]
    NoTag {
        /// Family and number that were looked for.
        tag: String,
        /// Frames shown.
        seen: u64,
        /// Frames by reason, in words.
        reasons: String,
        /// What was seen instead, in words; empty if nothing.
        also: String,
    },
}
