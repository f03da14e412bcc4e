//! Why a world cannot be.

/// Why a world cannot be.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// The text is no description.
    #[error("{file}: {what}")]
    Description {
        /// Its name.
        file: String,
        /// What the parser said, with the line.
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
    /// The picture's name is none.
    #[error(
        "`{got}` is no picture; expected leaves-SEED, plain, stripes-PERIOD_MM-ANGLE_DEG or file:PATH"
    )]
    UnknownPicture {
        /// What was asked for.
        got: String,
    },
    /// The picture's file cannot be used.
    #[error("cannot use the picture {path}: {reason}")]
    Picture {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Only one tag can be printed.
    #[error(
        "the simulated print has tag36h11 number 0; the rig's target asks for {family} number {id}"
    )]
    Tag {
        /// The family asked for.
        family: String,
        /// The number asked for.
        id: u32,
    },
    /// The camera does not look at the print.
    #[error(
        "the {camera} does not face the print at the beginning of the path (tool at {tool}): check mount.{camera}.axis and target.centre_mm"
    )]
    LooksAway {
        /// Which.
        camera: &'static str,
        /// Where the tool is.
        tool: String,
    },
    /// The print is too fine for this lens.
    #[error(
        "the print would need {pixels} samples for the {camera}, more than {limit}: check focal_length_mm, pixel_pitch_um and the target's size"
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
