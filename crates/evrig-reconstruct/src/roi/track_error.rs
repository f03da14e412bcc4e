use super::tag_detector::FAMILIES;

/// Why there is no track.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// The rig names an unsupported tag family.
    #[error("tag family `{0}` is not known; expected one of {known}", known = FAMILIES.join(", "))]
    UnknownFamily(String),
    /// A tag or target image without size, or a lens without focal length.
    #[error("the rig description has {what}; a track needs a positive number")]
    BadRig {
        /// Name and value.
        what: String,
    },
    /// No frame was given.
    #[error("there are no frames to track the tag in")]
    NoFrames,
    /// No frame has a usable detection, or too few are close enough for a path.
    #[error("{tag} cannot be tracked in {seen} frames: {reasons}{also}")]
    NoTag {
        /// Family and id of the tag.
        tag: String,
        /// Frames given.
        seen: u64,
        /// Frames by reason, in words.
        reasons: String,
        /// What was detected instead, in words; empty if nothing.
        also: String,
    },
}
