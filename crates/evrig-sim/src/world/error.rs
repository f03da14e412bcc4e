//! Why a world is refused.

/// Why a world is refused.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// The text is not a description.
    #[error("{file}: {what}")]
    Description {
        /// Its name.
        file: String,
        /// The parser's message, with the line.
        what: String,
    },
    /// A value is out of range.
    #[error("the world's {key} is {got}, expected {expected}")]
    Range {
        /// The key.
        key: String,
        /// Its value.
        got: f64,
        /// What it may be.
        expected: String,
    },
    /// The name of the target image is unknown.
    #[error(
        "`{got}` is no target image; expected leaves-SEED, plain, stripes-PERIOD_MM-ANGLE_DEG or \
         file:PATH"
    )]
    UnknownImage {
        /// What was asked for.
        got: String,
    },
    /// The image file cannot be read.
    #[error("cannot read the target image {path}: {reason}")]
    ImageFile {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Only one tag can be printed.
    #[error(
        "the simulated target has tag36h11 number 0; the rig's target asks for {family} number {id}"
    )]
    Tag {
        /// The family asked for.
        family: String,
        /// The number asked for.
        id: u32,
    },
    /// The target is not in front of the camera.
    #[error(
        "the {camera} does not face the target at the beginning of the path (tool at {tool}): \
         check mount.{camera}.axis and target.centre_mm"
    )]
    LooksAway {
        /// Which.
        camera: &'static str,
        /// Where the tool is.
        tool: String,
    },
    /// The target needs too many samples for this lens.
    #[error(
        "the target would need {pixels} samples for the {camera}, more than {limit}: check \
         focal_length_mm, pixel_pitch_um and the target's size"
    )]
    TooFine {
        /// Which.
        camera: &'static str,
        /// Samples needed.
        pixels: usize,
        /// The most.
        limit: usize,
    },
}
