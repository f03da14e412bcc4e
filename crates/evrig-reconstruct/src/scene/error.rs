use evrig_core::geometry::Size;

/// Why no scene was reconstructed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A frame is not of the raw Bayer format that the camera states.
    #[error("Pi frame {index} of {got} is not usable; expected raw Bayer frames of {expected}")]
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
        "the tag was tracked in {found} of {n} Pi frames; at least {needed} are needed to map the \
         target"
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
        "the map of the target has no texture to align to: check that the target is in view and \
         in focus"
    )]
    NoTexture,
    /// The map exceeds the largest supported size.
    #[error(
        "the map of the target would have {cells} cells, the limit is {limit}: check the track of \
         the tag"
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
        "the DAVIS frames are displaced {residual_px:.1} px from the map of the target (root mean \
         square; at most {max_px} px): check the clocks (`evrig sync`) and the camera mounts in \
         the rig description"
    )]
    OffTheMap {
        /// Root-mean-square displacement, pixels.
        residual_px: f64,
        /// Greatest accepted displacement, pixels.
        max_px: f64,
    },
    /// The normal equations have no solution.
    #[error("{0} does not converge: the frames do not match the geometry in the rig description")]
    NoFit(&'static str),
}
