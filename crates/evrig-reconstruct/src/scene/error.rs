//! Why no scene could be made.

use evrig_core::geometry::Size;

/// Why no scene could be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A frame is not the raw mosaic that the camera was said to give.
    #[error("Pi frame {index} is {got} of another kind; expected raw mosaic frames of {expected}")]
    NotRaw {
        /// Number of the frame, from 0.
        index: usize,
        /// Its size.
        got: Size,
        /// The camera's size.
        expected: Size,
    },
    /// The tag's track covers too few frames.
    #[error(
        "the tag was tracked in {found} of {n} Pi frames; at least {needed} are needed to map the print"
    )]
    TooFewFrames {
        /// Frames at which the tag's track is known.
        found: usize,
        /// All frames.
        n: usize,
        /// At least so many.
        needed: usize,
    },
    /// Nothing on the print stands out.
    #[error(
        "the map of the print has nothing that tells of motion; is the print in the picture and in focus?"
    )]
    NoTexture,
    /// The map would be larger than a print can be.
    #[error(
        "the map of the print would have {cells} cells; the limit is {limit}: is the path of the tag right?"
    )]
    TooLarge {
        /// Cells it would have.
        cells: f64,
        /// Most it may have.
        limit: usize,
    },
    /// The event camera does not see what the Pi saw.
    #[error("the DAVIS's {what}: {found} of {n} are usable, at least {needed} are needed")]
    NoDavis {
        /// Which observations.
        what: &'static str,
        /// Usable ones.
        found: usize,
        /// All.
        n: usize,
        /// At least so many.
        needed: usize,
    },
    /// The event camera's frames do not lie on the map.
    #[error(
        "the DAVIS's frames lie {left_px:.1} px off the map of the print (root mean square; at most {most_px} px): \
         do both cameras' clocks hold for this recording (`evrig sync`), and does the rig state where they sit?"
    )]
    OffTheMap {
        /// How far, root mean square, pixels.
        left_px: f64,
        /// At most so far.
        most_px: f64,
    },
    /// The equations have no solution.
    #[error("{0} does not converge: the pictures do not fit the geometry that the rig states")]
    NoFit(&'static str),
}
