
use evrig_core::geometry::Size;

/// Why no scene was reconstructed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A frame is not of the raw Bayer format that the camera states.
    #[error("Pi frame {index} is {got} of another kind; expected raw mosaic frames of {expected}")]
    NotRaw {
        /// Index of the frame, from 0.
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
        /// Frames covered by the tag's track.
        found: usize,
        /// All frames.
        n: usize,
        /// Fewest frames needed.
        needed: usize,
    },
    /// The target has no texture to align to.
    #[error(
        "the map of the print has nothing that tells of motion; is the print in the picture and in focus?"
    )]
    NoTexture,
    /// The map exceeds the largest supported size.
    #[error(
        "the map of the print would have {cells} cells; the limit is {limit}: is the path of the tag right?"
    )]
    TooLarge {
        /// Cells needed.
        cells: f64,
        /// Most cells.
        limit: usize,
    },
    /// Too few usable observations of the event camera.
    #[error("the DAVIS's {what}: {found} of {n} are usable, at least {needed} are needed")]
    NoDavis {
        /// Kind of observation.
        what: &'static str,
        /// Usable ones.
        found: usize,
        /// All.
        n: usize,
        /// Fewest needed.
        needed: usize,
    },
    /// The event camera's frames do not match the map.
    #[error(
        "the DAVIS's frames lie {left_px:.1} px off the map of the print (root mean square; at most {most_px} px): \
         do both cameras' clocks hold for this recording (`evrig sync`), and does the rig state where they sit?"
    )]
    OffTheMap {
        /// Root-mean-square displacement, pixels.
        left_px: f64,
        /// Greatest accepted displacement, pixels.
        most_px: f64,
    },
    /// The normal equations have no solution.
    #[error("{0} does not converge: the pictures do not fit the geometry that the rig states")]
    NoFit(&'static str),
}
